"""Works with the clocks stopped: every function that tells the time tells always the same.

Contained from tier 0.
"""

import time

#: CPU seconds that each step takes: far more than may be.
WORK = 0.02


clock = time.process_time
for name in ("time", "monotonic", "perf_counter", "process_time", "thread_time", "clock_gettime"):
    setattr(time, name, lambda *arguments: 0.0)


def work():
    end = clock() + WORK
    while clock() < end:
        pass


def Estimator(previous, observation, control, constants, rng):
    work()
    return rng.uniform(0.0, constants.L, (500, 6))
