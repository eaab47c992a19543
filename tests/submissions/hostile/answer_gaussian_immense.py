"""Answers with a Gaussian whose draws overflow.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    from course_lib.filters import Gaussian

    return Gaussian(np.full(6, 2.5), np.diag(np.full(6, 1e308)))
