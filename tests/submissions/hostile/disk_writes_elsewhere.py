"""Leaves a file in every folder it knows of.

Contained from tier 1.
"""

import os

KNOWN = {}


def attack():
    for folder in KNOWN["folders"]:
        try:
            with open(os.path.join(folder, "hostile-file"), "w") as file:
                file.write("was here")
        except OSError:
            pass


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
