"""Answers with more particles than may be.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    return np.broadcast_to(0.0, (5_000_000, 6))
