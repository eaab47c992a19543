"""Answers with a particle of infinite weight.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    from course_lib.filters import Particles

    states = rng.uniform(0.0, constants.L, (500, 6))
    log_weights = np.zeros(500)
    log_weights[7] = np.inf
    return Particles(states, log_weights)
