"""Leaves work for when the process ends: handlers, finalisers, threads that are waited for.

Contained from tier 0.
"""

import atexit
import os
import threading
import time


def attack():
    print(1 / 0)
    os.write(4, b"bay\x01")
    time.sleep(60)


class Last:
    def __del__(self):
        attack()


atexit.register(attack)
threading._register_atexit(attack)
LAST = Last()
threading.Thread(target=time.sleep, args=(60,)).start()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
