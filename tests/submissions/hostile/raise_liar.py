"""Raises an exception whose traceback names files of the grader.

Contained from tier 0.
"""


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        exec(compile("raise ValueError('line 1 of the gradebook')", "/etc/passwd", "exec"))
    return rng.uniform(0.0, constants.L, (500, 6))
