"""Slows the reference down: finds other workers and makes them the least important on one core.

Contained from tier 1.
"""

import contextlib
import os

import numpy as np


def attack():
    done = 0
    for name in os.listdir("/proc"):
        if not name.isdigit() or int(name) in (os.getpid(), os.getppid()):
            continue
        with contextlib.suppress(OSError):
            with open(f"/proc/{name}/cmdline") as file:
                if "grader.sandbox" not in file.read():
                    continue
            os.setpriority(os.PRIO_PROCESS, int(name), 19)
            done += 1
    assert done


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
