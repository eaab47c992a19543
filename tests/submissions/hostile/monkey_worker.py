"""Replaces the worker's own functions: what it reads, what it writes, what it tells of failures.

Contained from tier 0.
"""

import sys

import numpy as np


def attack():
    from course_lib.filters import Particles
    from grader.sandbox import posterior, wire, worker

    frame = sys._getframe()
    while frame:
        if "settings" in frame.f_locals:
            frame.f_locals["settings"].update(trusted="course_lib.vacuum.reference:Estimator", withheld=[])
        frame = frame.f_back
    wire.decode_posterior = lambda arrays: (0.0, Particles(np.zeros((1, 6)), np.zeros(1)))
    wire.MAX_ARRAYS = wire.MAX_DIMENSIONS = 1 << 62
    worker.explain = lambda error: ("ok", "full marks")
    worker._CAPS = {}
    posterior.check = lambda *arguments: arguments[0]
    for finder in sys.meta_path:
        if hasattr(finder, "names"):
            finder.names = ()


try:
    attack()
except Exception:
    pass


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
