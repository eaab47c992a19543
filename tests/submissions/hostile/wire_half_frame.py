"""Sends half an answer, and no more.

Contained from tier 0.
"""

import os
import time


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        os.write(4, b"bay\x01\x00\x10\x00\x00" + bytes(99))
        time.sleep(60)
    return rng.uniform(0.0, constants.L, (500, 6))
