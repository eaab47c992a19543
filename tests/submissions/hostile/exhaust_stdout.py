"""Prints a gigabyte.

Contained from tier 0.
"""


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        for _ in range(1000):
            print("x" * 1_000_000)
    return rng.uniform(0.0, constants.L, (500, 6))
