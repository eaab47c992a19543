"""Writes to address zero.

Contained from tier 0.
"""

import ctypes


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        ctypes.memset(0, 1, 1)
    return rng.uniform(0.0, constants.L, (500, 6))
