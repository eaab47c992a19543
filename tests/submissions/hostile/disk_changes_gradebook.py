"""Writes to the gradebook, truncates it, changes its mode, times, owner and attributes.

Contained from tier 1.
"""

import contextlib
import os

KNOWN = {}


def attack():
    path = KNOWN["gradebook"]
    changes = [
        lambda: os.chmod(path, 0o600),
        lambda: os.chown(path, 1, 1),
        lambda: os.utime(path, (1, 1)),
        lambda: os.setxattr(path, "user.grade", b"full"),
        lambda: open(path, "ab").write(b"full marks"),
        lambda: os.truncate(path, 1),
        lambda: os.unlink(path),
    ]
    for change in changes:
        with contextlib.suppress(OSError):
            change()


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
