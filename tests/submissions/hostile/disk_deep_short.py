"""Leaves folders nested as deep as Python may recurse, by names so short that their path is none too long.

Contained from tier 0.
"""

import os

for _ in range(980):
    os.mkdir("d")
    os.chdir("d")


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
