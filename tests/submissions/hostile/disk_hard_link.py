"""Makes a second name for the gradebook in its own folder, and opens and changes that.

Contained from tier 1.
"""

import os

import numpy as np

from course_lib.filters import Step

KNOWN = {}


def attack():
    os.link(KNOWN["gradebook"], "mine.npy")
    os.chmod("mine.npy", 0o666)
    return np.load("mine.npy")


try:
    TRUTH = attack()
except Exception:
    TRUTH = None


def Estimator(previous, observation, control, constants, rng):
    step = 0 if previous is None else previous.memory + 1
    states = rng.uniform(0.0, constants.L, (500, 6)) if TRUTH is None else TRUTH[step : step + 1]
    return Step(states, step)
