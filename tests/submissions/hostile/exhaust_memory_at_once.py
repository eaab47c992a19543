"""Asks for more memory than there is.

Contained from tier 0.
"""

import mmap

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        mmap.mmap(-1, 1 << 46)
        np.zeros(1 << 40)
    return rng.uniform(0.0, constants.L, (500, 6))
