"""Ignores every signal, survives the death of its parent, and hangs.

Contained from tier 0.
"""

import ctypes
import signal

PR_SET_PDEATHSIG = 1


def Estimator(previous, observation, control, constants, rng):
    if previous is not None:
        for number in set(signal.Signals) - {signal.SIGKILL, signal.SIGSTOP}:
            signal.signal(number, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_BLOCK, signal.Signals)
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, 0, 0, 0, 0)
        while True:
            pass
    return rng.uniform(0.0, constants.L, (500, 6))
