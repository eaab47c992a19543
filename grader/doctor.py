"""What this machine can promise: isolation, shown by attempts to break out; timing, by the reference against itself."""

import os
import platform
import sys
from importlib.metadata import version

from grader.assignment import PUBLIC_SECRET
from grader.grading.timing import measure_speed
from grader.sandbox import isolation
from grader.sandbox.program import Limits, Program
from grader.sandbox.server import Server

#: What a program tries, and from which tier on it must fail.
ATTEMPTS = {
    "read a file of others": 1,
    "read the reference": 1,
    "write outside its directory": 1,
    "change a file's mode": 1,
    "list processes": 1,
    "signal its parent": 1,
    "start a process": 1,
    "open a network socket": 1,
    "open a local socket": 1,
    "see another process": 2,
}

_SOURCE = """
import os, socket
import numpy as np
import course_lib

def read_others(): open("/etc/passwd").read()
def read_reference(): open(os.path.join(os.path.dirname(course_lib.__file__), REFERENCE)).read()
def write_outside():
    path = os.path.join(os.path.dirname(os.getcwd()), "outside")
    open(path, "w").close()
    os.remove(path)
def change_mode(): os.chmod(".", 0o700)
def list_processes(): os.listdir("/proc")
def signal_parent(): os.kill(os.getppid(), 0)
def start_process():
    if os.fork() == 0: os._exit(0)
def network_socket(): socket.socket(socket.AF_INET, socket.SOCK_DGRAM).close()
def local_socket(): socket.socketpair()[0].close()
def another_process(): assert os.getppid() > 2

def succeeds(attempt):
    try:
        attempt()
    except (OSError, AssertionError):
        return 0.0
    return 1.0

def Estimator(previous, observation, control, constants, rng):
    attempts = (read_others, read_reference, write_outside, change_mode, list_processes, signal_parent, start_process,
                network_socket, local_socket, another_process)
    return np.array([[succeeds(attempt)] for attempt in attempts])
"""


def attempt(tier, assignment):
    """Run a program that tries to get out.

    Parameters
    ----------
    tier : int
    assignment : Assignment
        Whose reference it tries to read.

    Returns
    -------
    list of str
        The attempts that succeeded though they must not.

    Raises
    ------
    SandboxError, StudentError
        The tier does not work at all.
    """
    constants = assignment.variants[0].constants
    reference = assignment.reference.partition(":")[0].partition(".")[2].replace(".", "/") + ".py"
    task = Program(f"REFERENCE = {reference!r}\n{_SOURCE}", "Estimator", constants, 0)
    with (
        Server((type(constants).__module__,), withheld=assignment.withheld, tier=tier) as server,
        server.start(task, Limits(), dimension=1) as worker,
    ):
        succeeded = worker.step(None, None).states[:, 0] > 0
    return [name for (name, least), done in zip(ATTEMPTS.items(), succeeded, strict=True) if done and tier >= least]


def time_reference(assignment, tier):
    """Ratios of the reference's CPU time to its own, as submissions are timed."""
    with Server(trusted=assignment.reference, tier=tier) as server:
        return measure_speed(server, server, assignment, PUBLIC_SECRET, None).ratios


def facts():
    """Name and value of what else matters, in words."""
    user = isolation.policy(0, (), os.sep)["user"]
    names = ("numpy", "scipy", "numba")
    return {
        "machine": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "cores": f"{os.cpu_count()}, {os.getloadavg()[0]:.1f} of them busy in the last minute",
        "Python": f"{platform.python_version()} in {sys.prefix}",
        "libraries": ", ".join(f"{name} {version(name)}" for name in names),
        "submissions run as": f"user {os.geteuid() if user is None else user}",
    }
