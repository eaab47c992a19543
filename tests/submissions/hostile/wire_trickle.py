"""Sends an answer byte by byte, so that something always arrives.

Contained from tier 0.
"""

import os
import time


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        os.write(4, b"bay\x01\x00\x10\x00\x00")
        while True:
            os.write(4, b"\x00")
            time.sleep(0.05)
    return rng.uniform(0.0, constants.L, (500, 6))
