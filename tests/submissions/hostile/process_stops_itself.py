"""Stops itself in the middle of a call.

Contained from tier 0.
"""

import os
import signal


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        os.kill(os.getpid(), signal.SIGSTOP)
    return rng.uniform(0.0, constants.L, (500, 6))
