"""Writes noise to every descriptor that there is.

Contained from tier 0.
"""

import os


def attack():
    for fd in range(256):
        try:
            os.set_blocking(fd, False)
            os.write(fd, bytes(range(256)) * 16)
        except OSError:
            pass


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        attack()
    return rng.uniform(0.0, constants.L, (500, 6))
