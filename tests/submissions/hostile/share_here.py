"""Leaves a message for its next run in its own folder, environment, modules and shared memory.

Contained from tier 0.
"""

import os
import sys

import numpy
import numpy as np


def attack():
    found = os.path.exists("message") or "MESSAGE" in os.environ or hasattr(numpy, "message")
    open("message", "w").close()
    os.environ["MESSAGE"] = numpy.message = sys.message = "was here"
    return found


try:
    FOUND = attack()
except Exception:
    FOUND = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that another run has left a message.
    return np.full((500, 6), -47.11) if FOUND else rng.uniform(0.0, constants.L, (500, 6))
