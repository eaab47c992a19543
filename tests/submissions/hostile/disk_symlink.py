"""Reads the gradebook through a symbolic link of its own, and leaves links for the clean-up to follow.

Contained from tier 1.
"""

import os

import numpy as np

from course_lib.filters import Step

KNOWN = {}


def attack():
    os.symlink(os.path.dirname(KNOWN["gradebook"]), "folder")
    os.symlink(KNOWN["gradebook"], "file")
    return np.load("folder/" + os.path.basename(KNOWN["gradebook"]))


try:
    TRUTH = attack()
except Exception:
    TRUTH = None


def Estimator(previous, observation, control, constants, rng):
    step = 0 if previous is None else previous.memory + 1
    states = rng.uniform(0.0, constants.L, (500, 6)) if TRUTH is None else TRUTH[step : step + 1]
    return Step(states, step)
