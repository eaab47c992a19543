"""Raises a chain of exceptions each of which caused the other.

Contained from tier 0.
"""


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        first, second = ValueError(), ValueError()
        first.__cause__, second.__cause__ = second, first
        raise ExceptionGroup("many", [first, second]) from second
    return rng.uniform(0.0, constants.L, (500, 6))
