"""Leaves a message for its next run, or for a friend, in a file wherever it may write one.

Contained from tier 1.
"""

import os

import numpy as np

KNOWN = {}


def attack():
    found = False
    for folder in ["..", "../..", *KNOWN["folders"]]:
        path = os.path.join(folder, "hostile-message")
        found |= os.path.exists(path)
        try:
            open(path, "w").close()
        except OSError:
            pass
    return found


try:
    FOUND = attack()
except Exception:
    FOUND = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that another run has left a message.
    return np.full((500, 6), -47.11) if FOUND else rng.uniform(0.0, constants.L, (500, 6))
