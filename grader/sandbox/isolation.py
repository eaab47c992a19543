"""How well a submission can be shut in on this machine, and what exactly that means for one fork server.

Four tiers, each with everything the one below it has. They are probed, never assumed; the tier in use is recorded with
every result, and nothing lowers it on the way.
"""

import os
import platform
import sys
import sysconfig
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from grader.sandbox import bubblewrap
from grader.sandbox.cgroup import Cgroup

TITLES = (
    "separate processes with limits on memory, output and time; not a security boundary",
    "Landlock, seccomp and limits: no file of others, no network, no process, no signal",
    "namespaces (bubblewrap): its own processes, network and file system, and Landlock and seccomp in them",
    "a control group (memory, number of processes) around the namespaces, Landlock and seccomp",
)
#: A worker of a server run by root becomes one of these users, if it can: fork servers are told apart by theirs.
USERS = range(60_000, 64_000)

_ON_LINUX = "grade on Linux, or in a virtual machine"
_PACKAGES = Path(__file__).parents[2]


@dataclass(frozen=True)
class Tier:
    """What the probe found of one tier.

    Attributes
    ----------
    number : int
    title : str
    available : bool
    reason : str
        Why not; empty if it is available.
    remedy : str
        What would enable it.
    """

    number: int
    title: str
    available: bool
    reason: str = ""
    remedy: str = ""


@lru_cache(maxsize=1)
def probe():
    """Find out which tiers this process can use.

    Returns
    -------
    tuple of Tier
        Tiers 0 to 3.
    """
    findings = [("", "")]
    for number, look in enumerate((kernel, bubblewrap.problem, Cgroup.problem)):
        reason, remedy = look()
        if findings[-1][0] and not reason:
            reason, remedy = f"it needs tier {number}", findings[-1][1]
        findings.append((reason, remedy))
    return tuple(
        Tier(number, title, not reason, reason, remedy if reason else "")
        for number, (title, (reason, remedy)) in enumerate(zip(TITLES, findings, strict=True))
    )


def strongest():
    """The highest tier available here."""
    return max(tier.number for tier in probe() if tier.available)


def describe(tier):
    """One line for a record: the tier and what it consists of."""
    return f"tier {tier}: {TITLES[tier]}"


def policy(tier, withheld, directory):
    """What the processes of one fork server may do; JSON-serialisable.

    Parameters
    ----------
    tier : int
    withheld : sequence of str
        Modules whose files cannot be read.
    directory : str
        In which workers have theirs.

    Returns
    -------
    dict
        "tier"; "withheld"; "readable" and "listable", the files and directories a program may read or at least list,
        and "roots", the few hierarchies that hold them; "user", whom a worker becomes, or None; "search", whether on
        the way to these it passes directories that are closed to that user; "threads", how many its user has already,
        or None when they cannot be limited.
    """
    roots = [root for root in roots_of_python() if os.path.exists(root)]
    readable, listable = [], []
    hidden = _hidden(withheld)
    for root in roots:
        _carve(root, hidden, readable, listable)
    user = _user()
    return {
        "tier": tier,
        "withheld": list(withheld),
        "roots": roots,
        "readable": readable,
        "listable": listable,
        "user": user,
        "search": user is not None and not all(map(_open_to_all, [*roots, directory])),
        # Root's own are not limited by the kernel; in a namespace of users each has a count of its own.
        "threads": 0 if user is not None or (tier >= 2 and os.geteuid()) else _threads() if os.geteuid() else None,
    }


def kernel():
    """Why this machine has no Landlock and seccomp and what to do about it; an empty reason when it has."""
    if sys.platform != "linux":
        return f"Landlock and seccomp are Linux's, this is {platform.system()}", _ON_LINUX
    from grader.sandbox import landlock, seccomp

    if landlock.abi() < landlock.LEAST_ABI:
        found = f"ABI {landlock.abi()}" if landlock.abi() else "none"
        return (
            f"Landlock is too old or switched off (found {found}, needs ABI {landlock.LEAST_ABI})",
            "a kernel of Linux 6.2 or newer, with landlock in its list of security modules (lsm=)",
        )
    return seccomp.problem(), "a kernel with seccomp filters on x86_64 or aarch64"


def roots_of_python():
    """Hierarchies from which Python and its libraries import."""
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    return sorted(
        {
            *(os.path.realpath(sysconfig.get_path(name)) for name in names),
            os.path.join(os.path.realpath(sys.base_prefix), "lib"),
            *("/usr/lib", "/usr/lib64", "/lib", "/lib64", "/usr/share"),
            *("/etc/ld.so.cache", "/etc/localtime", "/etc/fonts"),
            str(_PACKAGES / "course_lib"),
        }
    )


def _hidden(withheld):
    """Files and directories below the roots that hold answers, or how they are graded."""
    hidden = {str(_PACKAGES / "grader")}
    for module in withheld:
        path = _PACKAGES.joinpath(*module.split("."))
        hidden |= {str(path), f"{path}.py"}
        # Its byte code and its kernels.
        hidden |= {str(file) for file in path.parent.glob(f"__pycache__/{path.name}.*")}
    return hidden


def _carve(root, hidden, readable, listable):
    """What is left of a hierarchy without the hidden parts of it."""
    if root in hidden:
        return
    inside = {path for path in hidden if path.startswith(f"{root}{os.sep}")}
    if not inside:
        readable.append(root)
        return
    listable.append(root)
    for entry in os.scandir(root):
        _carve(entry.path, inside, readable, listable)


def _user():
    """A user number to which workers of this process can drop, or None: it is nobody special already, or cannot."""
    if os.geteuid() != 0:
        return None
    user = USERS[os.getpid() % len(USERS)]
    pid = os.fork()
    if pid == 0:
        try:
            os.setgroups([])
            os.setresgid(user, user, user)
            os.setresuid(user, user, user)
        except OSError:
            os._exit(1)
        os._exit(0)
    return user if os.waitpid(pid, 0)[1] == 0 else None


def _open_to_all(path):
    """Whether anybody can reach a path."""
    return all(os.stat(parent).st_mode & 0o001 for parent in Path(path).parents)


def _threads():
    """How many threads this user has, for limits that are the user's and not the process's."""
    count = 0
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            try:
                if entry.stat().st_uid == os.geteuid():
                    count += len(os.listdir(f"/proc/{entry.name}/task"))
            except OSError:
                pass  # it has just ended
    return count
