"""Sends as many empty arrays as a frame may hold, and then one more.

Contained from tier 0.
"""

import os
import struct


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        words = struct.pack("<Q", 10_001) + struct.pack("<QQ", 1, 0) * 10_001
        os.write(4, b"bay\x01" + struct.pack("<I", len(words)) + words)
    return rng.uniform(0.0, constants.L, (500, 6))
