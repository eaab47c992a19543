"""Writes a gigabyte to stderr, from a thread.

Contained from tier 0.
"""

import os
import threading


def flood():
    while True:
        os.write(2, b"x" * 1_000_000)


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        threading.Thread(target=flood).start()
    return rng.uniform(0.0, constants.L, (500, 6))
