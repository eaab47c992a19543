"""Replaces itself by another program that holds its pipes.

Contained from tier 1.
"""

import os
import sys

ANSWER = """
import os, time
os.write(4, b"bay")
time.sleep(60)
"""


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        try:
            os.execv(sys.executable, [sys.executable, "-c", ANSWER])
        except OSError:
            pass
    return rng.uniform(0.0, constants.L, (500, 6))
