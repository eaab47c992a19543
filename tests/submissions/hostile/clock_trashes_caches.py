"""Slows the reference down: threads stream through memory all the time, to take its caches away.

Contained from tier 0.
"""

import threading
import time

import numpy as np

#: CPU seconds that the threads have before each answer.
WORK = 0.02


def trash():
    array = np.zeros(4_000_000)
    while True:
        array += 1.0


for _ in range(2):
    threading.Thread(target=trash, daemon=True).start()


def Estimator(previous, observation, control, constants, rng):
    end = time.process_time() + WORK
    while time.process_time() < end:
        time.sleep(0.001)
    return rng.uniform(0.0, constants.L, (500, 6))
