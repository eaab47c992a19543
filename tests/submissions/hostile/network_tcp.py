"""Sends what it sees to a server over TCP.

Contained from tier 1.
"""

import socket

import numpy as np

KNOWN = {}


def attack():
    for address in ("127.0.0.1", "::1", "localhost"):
        try:
            with socket.create_connection((address, KNOWN["port"]), timeout=0.2) as connection:
                return connection.sendall(b"hostile")
        except OSError:
            pass
    raise OSError


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
