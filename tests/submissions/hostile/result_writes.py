"""Writes results where graders keep them.

Contained from tier 1.
"""

import os

KNOWN = {}


def attack():
    for folder in [".", "..", "/autograder/results", *KNOWN["folders"]]:
        for name in ("hostile-results.json", "hostile.db"):
            try:
                with open(os.path.join(folder, name), "w") as file:
                    file.write('{"submission": "hostile", "status": "graded", "points": 100.0}')
            except OSError:
                pass


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
