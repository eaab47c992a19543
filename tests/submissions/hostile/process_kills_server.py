"""Kills the fork server, its parent.

Contained from tier 0.
"""

import os
import signal


def attack():
    if os.getppid() > 1:
        os.kill(os.getppid(), signal.SIGKILL)


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        try:
            attack()
        except OSError:
            pass
    return rng.uniform(0.0, constants.L, (500, 6))
