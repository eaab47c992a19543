"""Signals the grader in every way there is: kill, its group, its thread, queued, by pidfd.

Contained from tier 1.
"""

import contextlib
import ctypes
import os

KNOWN = {}

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.syscall.restype = ctypes.c_long


def syscall(*arguments):
    result = LIBC.syscall(*map(ctypes.c_long, arguments))
    if result < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return result


SIGURG = 23  # harmless to whom does not expect it


def attack():
    pid = KNOWN["pid"]
    info = (ctypes.c_int32 * 32)(SIGURG, 0, -1)
    ways = [
        lambda: os.kill(pid, SIGURG),
        lambda: os.killpg(KNOWN["group"], SIGURG),
        lambda: syscall(234, pid, pid, SIGURG),  # tgkill
        lambda: syscall(200, pid, SIGURG),  # tkill
        lambda: syscall(129, pid, SIGURG, ctypes.addressof(info)),  # rt_sigqueueinfo
        lambda: syscall(297, pid, pid, SIGURG, ctypes.addressof(info)),  # rt_tgsigqueueinfo
        lambda: syscall(424, syscall(434, pid, 0), SIGURG, 0, 0),  # pidfd_send_signal
    ]
    for way in ways:
        with contextlib.suppress(OSError):
            way()


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
