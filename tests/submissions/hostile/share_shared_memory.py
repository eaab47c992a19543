"""Leaves a message for its next run in shared memory of System V.

Contained from tier 1.
"""

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
    try:
        syscall(29, 0x686F7374, 4096, 0o3600)  # IPC_CREAT | IPC_EXCL
    except OSError as error:
        return error.errno == 17  # it exists
    return False


try:
    FOUND = attack()
except Exception:
    FOUND = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that another run has left a message.
    return np.full((500, 6), -47.11) if FOUND else rng.uniform(0.0, constants.L, (500, 6))
