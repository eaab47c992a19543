"""Knows the public episodes by heart: a table from their first inputs to their truths.

Contained from tier 0.
"""

import numpy as np

from course_lib.filters import Step

KNOWN = {}


def attack(inputs):
    return np.array(KNOWN["public"][inputs.tobytes().hex()])


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return Step(rng.uniform(0.0, constants.L, (500, 6)), (0, None))
    step, truth = previous.memory[0] + 1, previous.memory[1]
    if step == 1:
        truth = KNOWN["public"].get(np.concatenate([observation, control]).tobytes().hex())
    states = rng.uniform(0.0, constants.L, (500, 6)) if truth is None else np.array(truth[step])[None]
    return Step(states, (step, truth))
