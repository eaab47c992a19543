"""Raises an exception whose text cannot be written as UTF-8.

Contained from tier 0.
"""


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        raise ValueError("\ud800 \x00 \U0010ffff")
    return rng.uniform(0.0, constants.L, (500, 6))
