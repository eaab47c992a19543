"""Waits for orders: a server on a port, for as long as the process lives.

Contained from tier 1.
"""

import socket

import numpy as np


def attack():
    server = socket.create_server(("127.0.0.1", 0))
    server.listen()
    KEPT.append(server)


KEPT = []


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
