"""Leaves folders nested deeper than paths may be long and Python may recurse.

Contained from tier 0.
"""

import os

for _ in range(1500):
    os.mkdir("deeper")
    os.chdir("deeper")


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
