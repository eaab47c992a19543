"""Raises an exception with 300 megabytes of text.

Contained from tier 0.
"""


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        raise ValueError("x" * 300_000_000)
    return rng.uniform(0.0, constants.L, (500, 6))
