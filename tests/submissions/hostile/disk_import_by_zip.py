"""Packs the package into a zip of its own and imports the reference from there.

Contained from tier 1.
"""

import pathlib
import zipfile
import zipimport

import numpy as np

KNOWN = {}


def attack():
    folder = pathlib.Path(KNOWN["checkout"], "course_lib/vacuum")
    with zipfile.ZipFile("stolen.zip", "w") as file:
        for name in ("models", "reference"):
            file.write(folder / f"{name}.py", f"{name}.py")
    assert "Estimator" in zipimport.zipimporter("stolen.zip").get_source("reference")


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
