"""Reads the environment and the command line of the grader and of the fork server.

Contained from tier 1.
"""

import os

import numpy as np

KNOWN = {}


def attack():
    for pid in (KNOWN["pid"], os.getppid()):
        for name in ("environ", "cmdline", "maps", "stack", "io", "wchan"):
            try:
                with open(f"/proc/{pid}/{name}", "rb") as file:
                    found = file.read()
            except OSError:
                continue
            assert not found


try:
    attack()
    WORKED = False
except AssertionError:
    WORKED = True


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
