"""Raises an exception that never ends to explain itself.

Contained from tier 0.
"""


class Endless(Exception):
    def __str__(self):
        while True:
            pass


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        raise Endless
    return rng.uniform(0.0, constants.L, (500, 6))
