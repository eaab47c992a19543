"""Answers with a list and an array that lie about their length.

Contained from tier 0.
"""

import numpy as np


class Liar(list):
    def __len__(self):
        return 1

    def __iter__(self):
        while True:
            yield np.zeros((1, 6))


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    return Liar([np.zeros((1, 6))] * 3)
