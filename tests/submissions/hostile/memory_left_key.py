"""Leaves a key in the keyrings of the user, which outlive the process.

Contained from tier 1.
"""

import contextlib
import ctypes

import numpy as np

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.syscall.restype = ctypes.c_long


def syscall(*arguments):
    result = LIBC.syscall(*map(ctypes.c_long, arguments))
    if result < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return result


def attack():
    kind, name, value = (ctypes.create_string_buffer(word) for word in (b"user", b"hostile", b"was here"))
    for ring in (-4, -3, -5):
        with contextlib.suppress(OSError):
            return syscall(248, *map(ctypes.addressof, (kind, name, value)), 8, ring)
    raise OSError


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
