"""Never returns, in a loop in C that looks at no signal.

Contained from tier 0.
"""

import re


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        re.match(r"(a*)*b", "a" * 64)
    return rng.uniform(0.0, constants.L, (500, 6))
