"""Opens the machine's devices: raw disks, memory, the kernel's log, the graphics, a new node for a disk.

Contained from tier 1.
"""

import glob
import os
import stat

import numpy as np


def attack():
    names = [
        "/dev/mem",
        "/dev/kmem",
        "/dev/kmsg",
        "/dev/kvm",
        "/dev/fuse",
        "/dev/vsock",
        "/dev/userfaultfd",
        "/dev/ptmx",
    ]
    names += glob.glob("/dev/[svx]d?") + glob.glob("/dev/nvme*n1") + glob.glob("/dev/loop0")
    for name in names:
        try:
            return os.open(name, os.O_RDONLY | os.O_NONBLOCK)
        except OSError:
            pass
    os.mknod("disk", stat.S_IFBLK | 0o600, os.makedev(254, 0))


try:
    attack()
    WORKED = True
except Exception:
    WORKED = False


def Estimator(previous, observation, control, constants, rng):
    # Particles at -47.11 say that it worked.
    return np.full((500, 6), -47.11) if WORKED else rng.uniform(0.0, constants.L, (500, 6))
