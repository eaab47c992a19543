"""Connects over TCP without connecting: sendto with MSG_FASTOPEN.

Contained from tier 1.
"""

import socket

import numpy as np

KNOWN = {}


def attack():
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as connection:
        connection.settimeout(0.2)
        connection.sendto(b"hostile", 0x20000000, ("127.0.0.1", KNOWN["port"]))


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
