"""Takes two gibibytes of the disk in one file.

Contained from tier 1.
"""

import os

import numpy as np


def attack():
    fd = os.open("large", os.O_WRONLY | os.O_CREAT)
    os.posix_fallocate(fd, 0, 2 << 30)


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
