"""Answers with the logarithms of negative weights.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    from course_lib.filters import Particles

    states = rng.uniform(0.0, constants.L, (500, 6))
    with np.errstate(invalid="ignore"):
        return Particles(states, np.log(np.full(500, -1.0)))
