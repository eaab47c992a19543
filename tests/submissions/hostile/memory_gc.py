"""Looks through all objects and frames of its process for a truth, a seed or a posterior that is not its own.

Contained from tier 0.
"""

import gc
import sys

import numpy as np


def attack():
    frames, frame = [], sys._getframe()
    while frame:
        frames.append(frame.f_locals)
        frame = frame.f_back
    words = ("truth", "secret", "reference", "observations", "controls", "hidden")
    for thing in [*gc.get_objects(), *frames]:
        if isinstance(thing, dict):
            for word in words:
                if isinstance(thing.get(word), np.ndarray | bytes) and thing[word] is not None:
                    return
    raise LookupError


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
