"""Answers with an object that runs a command wherever it is unpickled.

Contained from tier 0.
"""

import os

import numpy as np

KNOWN = {}


class Bomb(np.ndarray):
    def __reduce__(self):
        return os.system, ("kill -URG " + str(KNOWN["pid"]) + "; touch " + KNOWN["folders"][0] + "/hostile-pickle",)

    def __reduce_ex__(self, protocol):
        return self.__reduce__()

    __array__ = None
    dtype = np.dtype(object)


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    return Bomb((500, 6))
