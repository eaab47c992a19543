"""Overflows the C stack.

Contained from tier 0.
"""

import sys


def fall():
    return sorted([1], key=lambda _: fall())


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        sys.setrecursionlimit(10**9)
        fall()
    return rng.uniform(0.0, constants.L, (500, 6))
