"""Works in the background: a call waits, without using its own time, until a thread has done the work.

Contained from tier 0.
"""

import threading
import time

#: CPU seconds that each step takes: far more than may be.
WORK = 0.02


def work():
    end = time.thread_time() + WORK
    while time.thread_time() < end:
        pass


def Estimator(previous, observation, control, constants, rng):
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    return rng.uniform(0.0, constants.L, (500, 6))
