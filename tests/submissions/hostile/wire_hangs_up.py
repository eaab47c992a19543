"""Closes its end of the pipes and goes on working.

Contained from tier 0.
"""

import os
import time


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        os.closerange(0, 64)
        time.sleep(60)
    return rng.uniform(0.0, constants.L, (500, 6))
