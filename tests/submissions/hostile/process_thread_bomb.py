"""Starts threads until it may not start another.

Contained from tier 0.
"""

import contextlib
import threading
import time


def attack():
    with contextlib.suppress(RuntimeError):
        for _ in range(5000):
            threading.Thread(target=time.sleep, args=(60,), daemon=True).start()


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
