"""Opens for writing what steers the kernel: core_pattern, sysrq, the out-of-memory scores of others, cgroups.

Contained from tier 1.
"""

import os

import numpy as np

KNOWN = {}


def attack():
    names = [
        "/proc/sys/kernel/core_pattern",
        "/proc/sys/kernel/modprobe",
        "/proc/sysrq-trigger",
        "/proc/sys/fs/pipe-max-size",
    ]
    names += [
        f"/proc/{pid}/{name}" for pid in (KNOWN["pid"], os.getppid()) for name in ("oom_score_adj", "coredump_filter")
    ]
    names += ["/sys/fs/cgroup/cgroup.procs", "/sys/fs/cgroup/memory/cgroup.procs", "/sys/power/state"]
    for name in names:
        try:
            return os.open(name, os.O_WRONLY)
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
