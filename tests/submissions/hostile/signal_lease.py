"""Makes the kernel signal the grader for it through a lease or a notification on a folder of its own.

Contained from tier 1.
"""

import contextlib
import fcntl
import os

KNOWN = {}


SIGURG, F_SETSIG = 23, 10


def attack():
    folder = os.open(".", os.O_RDONLY)
    with contextlib.suppress(OSError):
        fcntl.fcntl(folder, F_SETSIG, SIGURG)
        fcntl.fcntl(folder, fcntl.F_NOTIFY, fcntl.DN_CREATE | fcntl.DN_MULTISHOT)
        fcntl.fcntl(folder, fcntl.F_SETOWN, KNOWN["pid"])
        open("new", "w").close()


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
