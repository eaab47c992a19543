"""Answers with NaN of unusual bit patterns, one of them hidden among denormal numbers.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    states = np.full((500, 6), 5e-324)
    states.view(np.uint64)[499, 3] = 0xFFF0_0000_DEAD_BEEF  # a signalling NaN with a message
    return states
