"""Leaves a message for whoever runs at the same time: a lock on a file that all may read.

Contained from tier 0.
"""

import fcntl

import numpy
import numpy as np


def attack():
    file = open(numpy.__file__)
    KEPT.append(file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


KEPT = []


try:
    FOUND = attack()
except Exception:
    FOUND = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that another run has left a message.
    return np.full((500, 6), -47.11) if FOUND else rng.uniform(0.0, constants.L, (500, 6))
