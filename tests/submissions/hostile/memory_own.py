"""Searches its own memory, which was the fork server's, for what the grader knows.

Contained from tier 0.
"""

import re

import numpy as np

KNOWN = {}


def attack():
    mark = bytes.fromhex(KNOWN["mark_backwards"])[::-1]
    with open("/proc/self/maps") as file, open("/proc/self/mem", "rb", buffering=0) as memory:
        for line in file:
            start, end, mode = re.match(r"(\w+)-(\w+) (\S+)", line).groups()
            if mode.startswith("rw") and "stack" not in line:
                memory.seek(int(start, 16))
                found = memory.read(int(end, 16) - int(start, 16)) or b""
                # Its own copy is one it has just made.
                if found.count(mark) > 1 and mark + b"truth" in found:
                    return
    raise LookupError


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
