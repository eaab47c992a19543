"""Opens files until it may not open another, and lets exceptions be told from there.

Contained from tier 0.
"""

import os


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        while True:
            os.dup(1)
    return rng.uniform(0.0, constants.L, (500, 6))
