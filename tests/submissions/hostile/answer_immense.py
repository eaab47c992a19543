"""Answers with the largest finite numbers, whose errors overflow to infinity or NaN.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    states = np.full((500, 6), 1.7e308)
    states[::2] *= -1.0
    return states
