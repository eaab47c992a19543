"""What a process of the sandbox gives up, for good: files, identity, capabilities, resources, system calls.

The fork server gives up all files but those its workers may read. A worker gives up what remains, last of all before it
reads its program's source. At tier 0 there are only the limits.
"""

import ctypes
import os
import resource
import signal
import struct
import sys

from grader.sandbox import landlock, seccomp

_PR_SET_PDEATHSIG, _PR_SET_KEEPCAPS = 1, 8
_CAP_DAC_READ_SEARCH = 2
_CAPABILITIES_VERSION = 0x20080522

#: Devices that every program may read.
DEVICES = ("/dev/null", "/dev/zero", "/dev/urandom", "/dev/random")
#: Descriptors a program may have open.
DESCRIPTORS = 64

_libc = ctypes.CDLL(None, use_errno=True)


def server(policy, directory):
    """Confine the fork server, once it has imported everything.

    Parameters
    ----------
    policy : dict
        As `isolation.policy` describes it.
    directory : str
        The only one it may write in.
    """
    if policy["tier"] > 0:
        landlock.restrict([*policy["readable"], *DEVICES], policy["listable"], [directory, os.devnull])


def worker(policy, limits):
    """Confine a worker, in its own directory, before a line of its program's source is read.

    Parameters
    ----------
    policy : dict
        As `isolation.policy` describes it.
    limits : dict
        "memory_bytes", "disk_bytes" and "threads" of `Limits`.
    """
    parent = os.getppid()
    _limit(policy, limits)
    if policy["tier"] == 0:
        return
    if policy["user"] is not None:
        os.chown(".", policy["user"], policy["user"])
        _become(policy["user"])
    _keep_capabilities(1 << _CAP_DAC_READ_SEARCH if policy["search"] else 0)
    # The change of identity has revoked it.
    die_with(parent)
    # Beside what the fork server has left: no directory but its own, nobody else to talk to.
    landlock.restrict([*policy["roots"], *DEVICES], [], [os.getcwd(), os.devnull], alone=True)
    seccomp.restrict()


def reader(roots):
    """Confine a process that only reads what it is sent: it may import from these, write nothing and reach nobody."""
    landlock.restrict(roots, [], [], alone=True)
    seccomp.restrict()


def die_with(parent):
    """Have the kernel kill this process when its parent ends."""
    if sys.platform == "linux":
        _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(1)


def _limit(policy, limits):
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if sys.platform != "linux":
        return
    resource.setrlimit(resource.RLIMIT_AS, (limits["memory_bytes"],) * 2)
    # Ignored, a write beyond the limit is an error that the program sees, not its death.
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limits["disk_bytes"],) * 2)
    resource.setrlimit(resource.RLIMIT_NOFILE, (DESCRIPTORS,) * 2)
    if policy["threads"] is not None:
        resource.setrlimit(resource.RLIMIT_NPROC, (policy["threads"] + limits["threads"],) * 2)


def _become(user):
    """Give up root's identity, but not yet the capabilities."""
    _libc.prctl(_PR_SET_KEEPCAPS, 1, 0, 0, 0)
    os.setgroups([])
    os.setresgid(user, user, user)
    os.setresuid(user, user, user)
    _libc.prctl(_PR_SET_KEEPCAPS, 0, 0, 0, 0)


def _keep_capabilities(mask):
    """Give up all capabilities but these, none of which can be handed on."""
    header = struct.pack("<Ii", _CAPABILITIES_VERSION, 0)
    # Effective, permitted and inheritable; the upper halves follow.
    if _libc.capset(header, struct.pack("<6I", mask, mask, 0, 0, 0, 0)):
        error = ctypes.get_errno()
        raise OSError(error, f"capabilities: {os.strerror(error)}")
