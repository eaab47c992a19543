"""Answers with an array of a class whose methods and operators claim perfection.

Contained from tier 0.
"""

import numpy as np


class Perfect(np.ndarray):
    def __array_ufunc__(self, ufunc, method, *inputs, **keywords):
        return np.zeros(self.shape)

    def __array_function__(self, function, types, args, kwargs):
        return 0.0

    def __array_finalize__(self, made_from):
        pass

    def all(self, *arguments, **keywords):
        return True

    mean = sum = max = min = lambda self, *arguments, **keywords: 0.0


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    return rng.uniform(0.0, constants.L, (500, 6)).view(Perfect)
