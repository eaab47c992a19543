"""Answers with infinities that cancel on average.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    states = rng.uniform(0.0, constants.L, (500, 6))
    states[0], states[1] = np.inf, -np.inf
    return states
