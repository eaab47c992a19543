"""Sends a small answer with an array of 2**63 rows, and one of no rows and 2**64 - 1 columns.

Contained from tier 0.
"""

import os
import struct


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        words = struct.pack("<QQQQQQQ", 2, 2, 2**63, 6, 2, 0, 2**64 - 1)
        os.write(4, b"bay\x01" + struct.pack("<I", len(words)) + words)
    return rng.uniform(0.0, constants.L, (500, 6))
