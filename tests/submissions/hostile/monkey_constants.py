"""Makes the world small, so that every error is: writes into the frozen constants and their class.

Contained from tier 0.
"""

import numpy as np


def attack(constants):
    object.__setattr__(constants, "L", 0.001)
    type(constants).room = type(constants).sensors = property(lambda self: np.zeros((4, 2)))
    np.float64.__sub__ = None


def Estimator(previous, observation, control, constants, rng):
    try:
        attack(constants)
    except TypeError:
        pass
    return rng.uniform(0.0, constants.L, (500, 6))
