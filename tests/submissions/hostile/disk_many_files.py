"""Leaves ten thousand files for the clean-up.

Contained from tier 0.
"""

import contextlib

with contextlib.suppress(OSError):
    for number in range(10_000):
        open(str(number), "w").close()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
