"""Stops the fork server, its parent, so that the grader waits for it.

Contained from tier 1.
"""

import os
import signal

import numpy as np


def attack():
    os.kill(os.getppid(), signal.SIGSTOP)


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
