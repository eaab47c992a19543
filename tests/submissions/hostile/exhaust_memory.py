"""Takes memory piece by piece, and touches it.

Contained from tier 0.
"""

import numpy as np


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        pieces = []
        while len(pieces) < 100:  # 6.4 GB
            pieces.append(np.ones(8_000_000))
    return rng.uniform(0.0, constants.L, (500, 6))
