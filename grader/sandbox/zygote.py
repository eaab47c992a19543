"""The fork server: a process that has imported what every program needs and holds no secret.

It forks one worker per episode (a few milliseconds, where a fresh interpreter would take seconds), ends and reaps it
when the host says so, and makes sure that nothing is left. When the host hangs up, however it died, it ends all its
workers and itself.

Requests and answers are lines of JSON in turn, both ends trusted; a request to fork carries the worker's descriptors.
"""

import ctypes
import gc
import importlib
import json
import os
import signal
import socket
import stat
import sys
import time
import traceback

from grader.sandbox import confine, pages

_PR_SET_CHILD_SUBREAPER = 36

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
    policy = {}
    try:
        for request, descriptors in _requests(control):
            handed = []
            try:
                match request["do"]:
                    case "import":
                        policy = request["policy"]
                        _import(request["modules"])
                        confine.server(policy, directory)
                        answer = {}
                    case "fork":
                        answer = {"pid": _fork(request["directory"], descriptors, policy, workers)}
                        if policy["tier"] >= 2:
                            # The number is that of another namespace: the host finds its own by the descriptor.
                            handed.append(os.pidfd_open(answer["pid"]))
                    case "end":
                        status = _end(request["name"], request["grace"], workers)
                        answer = {"status": status, "left": _sweep(workers)}
            except Exception as error:
                answer = {"error": f"{type(error).__name__}: {error}"}
            socket.send_fds(control, [json.dumps({"id": request["id"], **answer}).encode() + b"\n"], handed)
            for descriptor in handed:
                os.close(descriptor)
    except OSError:
        pass  # the host is gone
    for pid in list(workers):
        _end(pid, 0.0, workers)
    _sweep(workers)
    remove(directory)


def remove(directory):
    """Remove a directory in which an untrusted program could write, if it is still there."""
    here = _open(directory)
    if here is None:
        return
    # By descriptors, up and down: its folders may be nested deeper than Python recurses and than paths may be long.
    names, stuck = [], [set()]
    while True:
        name = _clear(here, stuck[-1])
        if name is not None:
            inner = _open(name, here)
            if inner is None:
                stuck[-1].add(name)
                continue
            os.close(here)
            here = inner
            names.append(name)
            stuck.append(set())
        elif names:
            outer = os.open("..", os.O_RDONLY | os.O_DIRECTORY, dir_fd=here)
            os.close(here)
            here = outer
            stuck.pop()
            name = names.pop()
            try:
                os.rmdir(name, dir_fd=here)
            except OSError:
                stuck[-1].add(name)
        else:
            break
    os.close(here)
    try:
        os.rmdir(directory)
    except OSError:
        pass  # something in it is stuck, or what it lies in is not ours


def _open(name, parent=None):
    """A descriptor of a directory, which may have been closed to us; None if it cannot be had. Links are left alone."""
    try:
        if stat.S_ISLNK(os.lstat(name, dir_fd=parent).st_mode):
            return None
        os.chmod(name, 0o700, dir_fd=parent)
        return os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=parent)
    except OSError:
        return None


def _clear(directory, stuck):
    """Remove files up to the first directory, and return its name; None when there is nothing but what is stuck."""
    with os.scandir(directory) as entries:
        for entry in entries:
            if entry.name in stuck:
                continue
            if entry.is_dir(follow_symlinks=False):
                return entry.name
            try:
                os.unlink(entry.name, dir_fd=directory)
            except OSError:
                stuck.add(entry.name)
    return None


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


def _import(modules):
    for name in [*modules, *COMMON]:
        importlib.import_module(name)
    if sys.platform == "linux":
        # Orphans of a worker become children of this process, where _sweep finds them.
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    sys.modules["grader.sandbox.worker"].rehearse()
    # What is here stays: a worker's garbage collector need not touch, and so copy, its pages.
    gc.collect()
    gc.freeze()
    pages.gather()


def _fork(directory, descriptors, policy, workers):
    parent = os.getpid()
    pid = os.fork()
    if pid == 0:
        try:
            _become_worker(parent, directory, descriptors, policy)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    workers.add(pid)
    for descriptor in descriptors:
        os.close(descriptor)
    return pid


def _become_worker(parent, directory, descriptors, policy):
    """A session of its own, four descriptors, an empty directory; then the program."""
    os.setsid()
    confine.die_with(parent)
    # Out of the way first, so that none is overwritten before it is in place.
    requests, replies, output = (os.dup2(fd, 100 + index, False) for index, fd in enumerate(descriptors))
    nothing = os.open(os.devnull, os.O_RDONLY)
    for target, fd in enumerate([nothing, output, output, requests, replies]):
        os.dup2(fd, target, inheritable=target < 3)
    if policy["tier"] > 0:
        os.closerange(5, 2**31 - 1)
    else:
        # Where the kernel cannot close a range, there may be a thousand million numbers in it.
        for fd in map(int, os.listdir("/dev/fd")):
            if fd > 4:
                os.closerange(fd, fd + 1)
    sys.stdout.reconfigure(line_buffering=True)
    os.chdir(directory)
    os.environ.update(HOME=directory, TMPDIR=directory)
    sys.modules["grader.sandbox.worker"].serve(3, 4, policy)


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
    return os.waitstatus_to_exitcode(status) if done else None


def _sweep(workers):
    """Kill what workers have left behind: whatever is a child of this process and none of them.

    Returns
    -------
    bool
        Whether there was anything.
    """
    left = False
    while orphans := _children() - workers:
        left = True
        for orphan in orphans:
            _kill(os.kill, orphan)
            os.waitpid(orphan, 0)
    if workers:
        return left
    # Confined, this process cannot list its children, but the kernel says whether it has any.
    try:
        while True:
            os.waitpid(-1, os.WNOHANG)
            left = True
    except ChildProcessError:
        return left


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
