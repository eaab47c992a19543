"""Changes the resource limits of the grader, which may end it.

Contained from tier 1.
"""

import resource

import numpy as np

KNOWN = {}


def attack():
    # The one limit that Linux does not enforce.
    resource.prlimit(KNOWN["pid"], resource.RLIMIT_RSS, (123 << 20, resource.RLIM_INFINITY))


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
