"""Overwrites its own machine code and read-only memory through /proc/self/mem.

Contained from tier 0.
"""

import ctypes


def attack():
    address = ctypes.cast(ctypes.pythonapi.PyFloat_AsDouble, ctypes.c_void_p).value
    with open("/proc/self/mem", "r+b", buffering=0) as memory:
        memory.seek(address)
        memory.write(b"\xcc" * 64)


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        attack()
    return rng.uniform(0.0, constants.L, (500, 6))
