"""Sends itself steps through its own pipe of requests, to get out of step with the grader.

Contained from tier 0.
"""

import os


def attack():
    fd = os.open("/proc/self/fd/3", os.O_WRONLY | os.O_NONBLOCK)
    os.write(fd, b"bay\x01" + (16).to_bytes(4, "little") + bytes(16))


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        try:
            attack()
        except OSError:
            pass
    return rng.uniform(0.0, constants.L, (500, 6))
