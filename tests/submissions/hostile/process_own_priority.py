"""Takes the machine for itself: real-time scheduling, or a priority over all others.

Contained from tier 1.
"""

import contextlib
import os

import numpy as np


def attack():
    for change in [
        lambda: os.setpriority(os.PRIO_PROCESS, 0, -20),
        lambda: os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(50)),
    ]:
        with contextlib.suppress(OSError):
            return change()
    raise OSError


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
