"""Reads the truth from the grader's memory with process_vm_readv.

Contained from tier 1.
"""

import ctypes

import numpy as np

from course_lib.filters import Step

KNOWN = {}

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.syscall.restype = ctypes.c_long


def syscall(*arguments):
    result = LIBC.syscall(*map(ctypes.c_long, arguments))
    if result < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return result


def attack():
    length = KNOWN["truth_bytes"]
    data = ctypes.create_string_buffer(length)
    here = (ctypes.c_uint64 * 2)(ctypes.addressof(data), length)
    there = (ctypes.c_uint64 * 2)(KNOWN["truth_address"], length)
    assert syscall(310, KNOWN["pid"], ctypes.addressof(here), 1, ctypes.addressof(there), 1, 0) == length
    return np.frombuffer(data.raw).reshape(-1, 6)


try:
    TRUTH = attack()
except Exception:
    TRUTH = None


def Estimator(previous, observation, control, constants, rng):
    step = 0 if previous is None else previous.memory + 1
    states = rng.uniform(0.0, constants.L, (500, 6)) if TRUTH is None else TRUTH[step : step + 1]
    return Step(states, step)
