"""The fork server: a process that has imported what every program needs and holds no secret.

It forks one worker per episode (a few milliseconds, where a fresh interpreter would take seconds), and ends and reaps
it when the host says so. When the host hangs up, however it died, the zygote ends all its workers and itself.

Requests and answers are lines of JSON in turn, both ends trusted; a request to fork carries the worker's descriptors.
"""

import ctypes
import gc
import importlib
import json
import os
import shutil
import signal
import socket
import sys
import time
import traceback

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36

#: The worker, and what most programs import and takes long. Imported on request, so that a failure is an answer.
COMMON = (
    "grader.sandbox.worker",
    "numpy",
    "scipy",
    "scipy.stats",
    "course_lib.filters",
    "course_lib.angles",
    "matplotlib.pyplot",
)


def main():
    """Serve the host on the descriptor named in the command line; the second argument is the server's directory."""
    control = socket.socket(fileno=int(sys.argv[1]))
    directory = sys.argv[2]
    workers = set()
    try:
        for request, descriptors in _requests(control):
            try:
                answer = _answer(request, descriptors, workers)
            except Exception as error:
                answer = {"error": f"{type(error).__name__}: {error}"}
            control.sendall(json.dumps({"id": request["id"], **answer}).encode() + b"\n")
    except OSError:
        pass  # the host is gone
    for pid in list(workers):
        _end(pid, 0.0, workers)
    remove(directory)


def remove(directory):
    """Remove a directory in which an untrusted program could write, if it is still there."""
    # What it has closed to us is opened first; links are left alone.
    _open(directory)
    for path, names, _ in os.walk(directory):
        for name in names:
            _open(os.path.join(path, name))
    shutil.rmtree(directory, ignore_errors=True)


def _open(directory):
    try:
        if not os.path.islink(directory):
            os.chmod(directory, 0o700)
    except OSError:
        pass  # not there, or not ours: rmtree does what it can


def _answer(request, descriptors, workers):
    match request["do"]:
        case "import":
            _import(request)
            return {"pid": os.getpid()}
        case "fork":
            return {"pid": _fork(request["directory"], descriptors, workers)}
        case "end":
            return {"status": _end(request["pid"], request["grace"], workers)}


def _requests(control):
    """Yield each request and the descriptors that came with it, until the host hangs up."""
    buffer, descriptors = b"", []
    while True:
        data, received, _, _ = socket.recv_fds(control, 65536, 3)
        if not data:
            return
        buffer += data
        descriptors += received
        while b"\n" in buffer:
            line, buffer = buffer.split(b"\n", 1)
            yield json.loads(line), descriptors
            descriptors = []


def _import(request):
    for name in [*request["modules"], *COMMON]:
        importlib.import_module(name)
    if sys.platform == "linux":
        # Orphans of a worker become children of this process, where _end finds them.
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    # What is here stays: a worker's garbage collector need not touch, and so copy, its pages.
    gc.collect()
    gc.freeze()


def _fork(directory, descriptors, workers):
    parent = os.getpid()
    pid = os.fork()
    if pid == 0:
        try:
            _become_worker(parent, directory, descriptors)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    workers.add(pid)
    for descriptor in descriptors:
        os.close(descriptor)
    return pid


def _become_worker(parent, directory, descriptors):
    """A session of its own, four descriptors, an empty directory; then the program."""
    os.setsid()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(1)
    # Out of the way first, so that none is overwritten before it is in place.
    requests, replies, output = (os.dup2(fd, 100 + index, False) for index, fd in enumerate(descriptors))
    nothing = os.open(os.devnull, os.O_RDONLY)
    for target, fd in enumerate([nothing, output, output, requests, replies]):
        os.dup2(fd, target, inheritable=target < 3)
    # Not a range up to the largest descriptor there may be: that can be a thousand million.
    for fd in map(int, os.listdir("/dev/fd")):
        if fd > 4:
            os.closerange(fd, fd + 1)
    sys.stdout.reconfigure(line_buffering=True)
    os.chdir(directory)
    os.environ.update(HOME=directory, TMPDIR=directory)
    sys.modules["grader.sandbox.worker"].serve(3, 4)


def _end(pid, grace, workers):
    """Kill a worker with all that it started, and reap it.

    Returns
    -------
    int or None
        Its exit status (minus the signal's number, if one killed it) when it ended by itself within `grace` seconds.
    """
    if pid not in workers:
        return None
    deadline = time.monotonic() + grace
    done, status = os.waitpid(pid, os.WNOHANG)
    while not done and time.monotonic() < deadline:
        time.sleep(0.001)
        done, status = os.waitpid(pid, os.WNOHANG)
    _kill(os.killpg, pid)
    if not done:
        _kill(os.kill, pid)
        os.waitpid(pid, 0)
    workers.discard(pid)
    # Whatever left the worker's process group is now a child of this process.
    while orphans := _children() - workers:
        for orphan in orphans:
            _kill(os.kill, orphan)
            os.waitpid(orphan, 0)
    return os.waitstatus_to_exitcode(status) if done else None


def _kill(kill, pid):
    try:
        kill(pid, signal.SIGKILL)
    except OSError:
        pass  # gone already


def _children():
    try:
        with open(f"/proc/self/task/{os.getpid()}/children") as file:
            return {int(pid) for pid in file.read().split()}
    except OSError:
        return set()


if __name__ == "__main__":
    main()
