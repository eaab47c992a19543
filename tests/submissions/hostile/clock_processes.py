"""Works in a process of its own, whose time is not on this one's clock.

Contained from tier 1.
"""

import os
import time

#: CPU seconds that each step takes: far more than may be.
WORK = 0.02


def work():
    end = time.process_time() + WORK
    while time.process_time() < end:
        pass


def Estimator(previous, observation, control, constants, rng):
    try:
        pid = os.fork()
    except OSError:
        work()
    else:
        if pid == 0:
            os.setsid()
            work()
            os._exit(0)
        os.waitpid(pid, 0)
    return rng.uniform(0.0, constants.L, (500, 6))
