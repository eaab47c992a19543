"""Answers with views: of one number, of memory turned around, of memory that is not its own.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    one = np.lib.stride_tricks.as_strided(np.zeros(1), (500, 6), (0, 0))
    beyond = np.lib.stride_tricks.as_strided(np.zeros(1), (100_000, 6), (48, 8))
    return one[::-1] if np.isfinite(observation[0]) else beyond
