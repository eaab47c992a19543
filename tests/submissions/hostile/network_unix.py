"""Connects to a socket in the file system and passes its files on to whoever listens.

Contained from tier 1.
"""

import socket

import numpy as np

KNOWN = {}


def attack():
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.connect(KNOWN["unix"])
        socket.send_fds(connection, [b"hostile"], [0, 1])


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
