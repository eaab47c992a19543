"""Answers with an object that turns into another array whenever somebody looks.

Contained from tier 0.
"""

import numpy as np


class Chameleon:
    looks = 0

    def __array__(self, dtype=None, copy=None):
        Chameleon.looks += 1
        return np.full((500, 6) if Chameleon.looks % 2 else (1, 6), np.nan if Chameleon.looks % 3 else 0.0)

    def __getattr__(self, name):
        return lambda *arguments, **keywords: True


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    return Chameleon()
