"""Asks the loader of a module it may have for the data of one it may not.

Contained from tier 1.
"""

import pathlib

import numpy as np

import course_lib.vacuum.constants


def attack():
    constants = course_lib.vacuum.constants
    path = pathlib.Path(constants.__file__).with_name("reference.py")
    assert b"def Estimator" in constants.__loader__.get_data(str(path))


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
