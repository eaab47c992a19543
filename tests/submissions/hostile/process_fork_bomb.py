"""Forks as often as it can, and so does each child.

Contained from tier 1.
"""

import os
import time

import numpy as np


def attack():
    first = os.getpid()
    for _ in range(7):  # at most 128 processes in all, should nothing hold it
        os.fork()
    if os.getpid() != first:
        time.sleep(60)
        os._exit(0)


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
