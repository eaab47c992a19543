"""No attack: the same wrong answer with the work that the attacks on the clock try to hide; none may score more."""

import time

#: CPU seconds that each step takes: far more than may be.
WORK = 0.02


def Estimator(previous, observation, control, constants, rng):
    end = time.process_time() + WORK
    while time.process_time() < end:
        pass
    return rng.uniform(0.0, constants.L, (500, 6))
