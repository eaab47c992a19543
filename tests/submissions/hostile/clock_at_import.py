"""Works while it is loaded, and leaves a thread that goes on from there.

Contained from tier 0.
"""

import threading
import time


def work(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


work(0.05)
threading.Thread(target=work, args=(600,), daemon=True).start()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
