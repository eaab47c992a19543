"""Reads the reference's compiled kernels from numba's cache.

Contained from tier 1.
"""

import pathlib

import numpy as np

KNOWN = {}


def attack():
    folder = pathlib.Path(KNOWN["checkout"], "course_lib/vacuum/__pycache__")
    caches = [*folder.glob("reference.*.nb?")]
    assert caches and all(path.read_bytes() for path in caches)


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
