"""Tries the system calls that open the kernel: bpf, perf events, userfaultfd, kcmp, modules, reboot, swap, time.

Contained from tier 1.
"""

import ctypes
import os

import numpy as np

KNOWN = {}

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.syscall.restype = ctypes.c_long


def syscall(*arguments):
    result = LIBC.syscall(*map(ctypes.c_long, arguments))
    if result < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return result


def attack():
    pid, attr = KNOWN["pid"], (ctypes.c_uint32 * 32)(1, 128)
    empty = ctypes.create_string_buffer(256)
    attempts = {
        "bpf": lambda: syscall(321, 0, ctypes.addressof(attr), 72),
        "perf_event_open": lambda: syscall(298, ctypes.addressof(attr), pid, -1, -1, 0),
        "userfaultfd": lambda: syscall(323, 0),
        "kcmp": lambda: syscall(312, os.getpid(), pid, 1, 0, 0),
        "acct": lambda: syscall(163, 0),
        "sethostname": lambda: syscall(170, ctypes.addressof(empty), 0) if os.uname().nodename == "" else 1 / 0,
        "syslog": lambda: syscall(103, 3, ctypes.addressof(empty), 256),
        "fanotify_init": lambda: syscall(300, 0, 0),
        "process_madvise": lambda: syscall(440, syscall(434, pid, 0), 0, 0, 4, 0),
        "move_pages": lambda: syscall(279, pid, 0, 0, 0, 0, 0),
        "ioperm": lambda: syscall(173, 0x80, 1, 1),
        "add a user id": lambda: os.setuid(12345) if os.getuid() else 1 / 0,
    }
    for attempt in attempts.values():
        try:
            return attempt()
        except (OSError, ZeroDivisionError):
            pass
    raise OSError


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
