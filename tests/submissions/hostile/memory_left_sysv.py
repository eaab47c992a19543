"""Leaves a shared memory segment, a semaphore and a message queue of System V.

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


KEY = 0x686F7374


def attack():
    made = 0
    for arguments in [(29, KEY, 4096, 0o1666), (64, KEY, 1, 0o1666), (68, KEY, 0o1666)]:
        with contextlib.suppress(OSError):
            syscall(*arguments)
            made += 1
    assert made


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
