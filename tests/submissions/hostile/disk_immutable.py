"""Leaves a file that even root cannot remove, as long as it carries the immutable attribute.

Contained from tier 1.
"""

import fcntl
import os
import struct

import numpy as np


def attack():
    with open("hostile-immutable", "w") as file:
        fcntl.ioctl(file, 0x40086602, struct.pack("i", 0x10))
    os.chmod(".", 0o500)


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
