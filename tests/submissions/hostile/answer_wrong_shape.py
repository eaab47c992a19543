"""Answers with one particle less column, and with none.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    return np.zeros((0, 6)) if observation[0] > 0 else np.zeros((500, 5))
