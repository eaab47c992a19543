"""Leaves folders, links, pipes and sockets in every folder it knows of.

Contained from tier 1.
"""

import contextlib
import os
import socket

KNOWN = {}


def attack():
    for folder in KNOWN["folders"]:
        path = os.path.join(folder, "hostile-")
        with contextlib.suppress(OSError):
            os.mkdir(path + "folder")
        with contextlib.suppress(OSError):
            os.symlink("/etc/passwd", path + "link")
        with contextlib.suppress(OSError):
            os.mkfifo(path + "pipe")
        with contextlib.suppress(OSError):
            socket.socket(socket.AF_UNIX).bind(path + "socket")


attack()


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
