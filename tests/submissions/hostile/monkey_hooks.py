"""Hangs itself into whatever has a hook: tracing, profiling, exceptions, imports, audits, garbage.

Contained from tier 0.
"""

import gc
import os
import signal
import sys
import threading
import types


def hook(*arguments):
    return hook


sys.settrace(hook)
sys.setprofile(hook)
threading.settrace(hook)
sys.addaudithook(hook)
sys.excepthook = sys.unraisablehook = threading.excepthook = hook
sys.meta_path.insert(0, types.SimpleNamespace(find_spec=lambda *arguments: None))
sys.path_hooks.insert(0, hook)
gc.callbacks.append(hook)
os.register_at_fork(before=hook, after_in_parent=hook, after_in_child=hook)
signal.signal(signal.SIGALRM, hook)
signal.setitimer(signal.ITIMER_REAL, 0.001, 0.001)


def Estimator(previous, observation, control, constants, rng):
    return rng.uniform(0.0, constants.L, (500, 6))
