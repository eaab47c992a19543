"""Opens a socket of any other kind: raw, packets, netlink, the hypervisor's, the kernel's ciphers.

Contained from tier 1.
"""

import socket

import numpy as np


def attack():
    kinds = [
        (2, 3, 1),
        (2, 3, 255),
        (17, 3, 3),
        (16, 3, 0),
        (40, 1, 0),
        (38, 5, 0),
        (29, 3, 1),
        (31, 3, 1),
        (2, 1, 262),
        (44, 3, 0),
    ]
    for kind in kinds:
        try:
            return socket.socket(*kind)
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
