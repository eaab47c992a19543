"""Takes six gibibytes in files that lie in memory and are no part of its address space.

Contained from tier 3.
"""

import os

import numpy as np


def attack():
    for _ in range(12):
        os.posix_fallocate(os.memfd_create("memory"), 0, 512 << 20)


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
