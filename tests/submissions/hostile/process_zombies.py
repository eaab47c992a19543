"""Leaves thirty children that have ended and that nobody has waited for.

Contained from tier 0.
"""

import os


def attack():
    for _ in range(30):
        if os.fork() == 0:
            os._exit(0)


try:
    attack()
except OSError:
    pass


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
