"""Leaves a daemon: a session of its own, an orphan, deaf to signals, in a loop.

Contained from tier 0.
"""

import os
import signal
import time


def attack():
    if os.fork() == 0:
        os.setsid()
        if os.fork():
            os._exit(0)
        for number in range(1, 32):
            if number not in (signal.SIGKILL, signal.SIGSTOP):
                signal.signal(number, signal.SIG_IGN)
        time.sleep(600)
        os._exit(0)
    os.wait()


try:
    attack()
except OSError:
    pass


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
