"""Exits with an object that claims to be zero.

Contained from tier 0.
"""


class Zero:
    def __eq__(self, other):
        return True

    def __str__(self):
        raise SystemExit(0)


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        raise SystemExit(Zero())
    return rng.uniform(0.0, constants.L, (500, 6))
