"""Outside: launches the fork server, and starts it again when it has died."""

import fcntl
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from grader.sandbox import bubblewrap, isolation
from grader.sandbox.cgroup import Cgroup
from grader.sandbox.host import Worker
from grader.sandbox.program import Escape, Limits, SandboxError
from grader.sandbox.zygote import remove

#: Seconds until a fork server has imported everything, and until it must have answered a request.
LAUNCH_SECONDS, ANSWER_SECONDS = 120.0, 30.0
#: What a control group may hold beside the limits of one worker: the fork server, and what shuts it in.
SHARED_BYTES, SHARED_PROCESSES = 1 << 30, 32


_PREFIX = "grader-"


class Server:
    """A fork server that has imported what programs need; a context manager, for one thread.

    Parameters
    ----------
    preload : sequence of str
        Modules to import beside the common ones, such as that of the constants. None may be withheld from a program.
    trusted : str, optional
        `module:function` of a reference that this server's workers run: imported before they are forked, so that
        they begin with their kernels loaded.
    withheld : sequence of str, optional
        Modules that programs can neither import nor, from tier 1 on, read.
    tier : int, optional
        Of isolation; the strongest available when left out.

    Attributes
    ----------
    tier : int
    directory : str
        Where its workers have theirs, while it runs.
    """

    def __init__(
        self,
        preload: Sequence[str] = (),
        trusted: str | None = None,
        *,
        withheld: Sequence[str] = (),
        tier: int | None = None,
    ):
        self._modules = [*preload, *([trusted.partition(":")[0]] if trusted else [])]
        self._withheld = withheld
        self.tier = isolation.strongest() if tier is None else tier
        self._process, self._cgroup = None, None

    def __enter__(self):
        self._launch()
        return self

    def __exit__(self, *exception):
        self.close()

    def start(self, program, limits, *, dimension):
        """Fork a worker for one episode.

        Parameters
        ----------
        program : Program
        limits : Limits
        dimension : int
            Columns of a state that its posteriors must have.

        Returns
        -------
        Worker

        Raises
        ------
        SandboxError
        """
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._launch()
        return Worker(self, program, limits, dimension)

    def close(self):
        """End the server and every worker it has; idempotent."""
        if self._process is None:
            return
        process, self._process = self._process, None
        self._control.close()
        try:
            process.wait(ANSWER_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._log.close()
        if self._cgroup is not None:
            self._cgroup.remove()
            self._cgroup = None
        remove(self.directory)
        os.close(self._lock)

    def fork(self, descriptors, directory):
        """Fork a worker.

        Parameters
        ----------
        descriptors : list of int
            What it reads requests from and writes replies and output to.
        directory : str
            Its own.

        Returns
        -------
        name, pid : int
            What the fork server calls it, and its process number here: the same but in a namespace.
        """
        name = pid = self._ask("fork", descriptors, directory=directory)["pid"]
        if self._received:
            *stale, descriptor = self._received
            pid = _process_number(descriptor)
            for each in (*stale, descriptor):
                os.close(each)
            self._received = []
        self._workers.add(name)
        return name, pid

    def end(self, name, grace):
        """End a worker with all that it started, and make sure of it.

        Returns
        -------
        status : int or None
            Its exit status if it ended by itself within `grace` seconds; minus the signal's number, if one killed it.
        starved : bool
            Whether the kernel has killed it for want of memory.

        Raises
        ------
        SandboxError
            An Escape when something has outlived it that its isolation should not have let begin.
        """
        answer = self._ask("end", name=name, grace=grace)
        self._workers.discard(name)
        if not self._cgroup:
            beyond = int(answer["left"] and self.tier > 0)
            starved = False
        else:
            beyond = len(self._cgroup.processes()) - self._own - len(self._workers)
            before, self._starved = self._starved, self._cgroup.out_of_memory()
            starved = self._starved > before
        if beyond > 0:
            self.close()
            raise Escape("a program had started processes, which its isolation should not have allowed")
        return answer["status"], starved

    def _ask(self, do, descriptors=(), **details):
        """Send the fork server a request and return its answer; without one, close and raise SandboxError."""
        if self._process is None:
            raise SandboxError("the fork server is closed")
        self._count += 1
        request = json.dumps({"id": self._count, "do": do, **details}).encode() + b"\n"
        try:
            if not self._imported:
                # Nothing else may be under way: a socket hands descriptors over with whatever it reads at once.
                self._answer(0, LAUNCH_SECONDS)
                self._imported = True
                self._own = len(self._cgroup.processes()) if self._cgroup else 0
            socket.send_fds(self._control, [request], list(descriptors))
            return self._answer(self._count, ANSWER_SECONDS)
        except OSError as error:
            message = f"the fork server did not answer ({error}){self._last_words()}"
            self.close()
            raise SandboxError(message) from error
        except SandboxError:
            self.close()
            raise

    def _launch(self):
        """Start the process; the modules are imported while the caller goes on."""
        _remove_stale()
        self.directory, self._lock = _new_directory()
        # Its workers pass through on the way to their own, and can do no more.
        os.chmod(self.directory, 0o711)
        self._log = tempfile.TemporaryFile()
        self._count, self._buffer, self._received, self._imported = 0, b"", [], False
        self._workers, self._own, self._starved = set(), 0, 0
        policy = isolation.policy(self.tier, self._withheld, self.directory)
        request = {"id": 0, "do": "import", "modules": self._modules, "policy": policy}
        words = [sys.executable, "-P", "-m", "grader.sandbox.zygote"]
        if self.tier >= 2:
            words = bubblewrap.command(self.directory) + words
        if self.tier >= 3:
            limits = Limits()
            try:
                self._cgroup = Cgroup(limits.memory_bytes + SHARED_BYTES, limits.threads + SHARED_PROCESSES)
            except OSError as error:
                self._log.close()
                remove(self.directory)
                os.close(self._lock)
                raise SandboxError(f"no control group can be made any more: {error}") from error
            words = self._cgroup.entering() + words
        self._control, theirs = socket.socketpair()
        with theirs:
            self._control.sendall(json.dumps(request).encode() + b"\n")
            self._process = subprocess.Popen(
                [*words, str(theirs.fileno()), self.directory],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                env=_environment(),
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )

    def _answer(self, number, seconds):
        self._control.settimeout(seconds)
        while True:
            while b"\n" not in self._buffer:
                data, received, _, _ = socket.recv_fds(self._control, 65536, 1)
                self._received += received
                if not data:
                    raise SandboxError(f"the fork server died{self._last_words()}")
                self._buffer += data
            line, self._buffer = self._buffer.split(b"\n", 1)
            answer = json.loads(line)
            # An answer to a request that was interrupted is passed over.
            if answer["id"] == number:
                if "error" in answer:
                    raise SandboxError(f"the fork server failed: {answer['error']}")
                return answer

    def _last_words(self):
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return f": {lines[-1]}" if lines else ""


def _new_directory():
    """A new directory and a descriptor that holds it."""
    while True:
        directory = tempfile.mkdtemp(prefix=_PREFIX)
        descriptor = _lock(directory)
        # In between, another server may have taken it for one of the dead.
        if descriptor is not None and os.path.exists(directory):
            return directory, descriptor


def _lock(directory):
    """A descriptor that holds a directory; None if somebody else does, or it is gone."""
    try:
        descriptor = os.open(directory, os.O_RDONLY | os.O_NOFOLLOW | os.O_DIRECTORY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _remove_stale():
    """Remove the directories of servers that could not: they were killed, and with them whoever held the lock."""
    for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        descriptor = _lock(path)
        if descriptor is not None:
            if os.fstat(descriptor).st_uid == os.geteuid():
                remove(path)
            os.close(descriptor)


def _process_number(descriptor):
    """The number here of the process a descriptor stands for, whatever it is called in its own namespace."""
    with open(f"/proc/self/fdinfo/{descriptor}") as file:
        return int(next(line.split()[1] for line in file if line.startswith("Pid:")))


def _environment():
    """What the fork server needs of this process's environment, and threads and hashing that do not vary."""
    kept = ("PATH", "HOME", "LD_LIBRARY_PATH", "VIRTUAL_ENV", "XDG_CACHE_HOME")
    return {
        **{name: os.environ[name] for name in kept if name in os.environ},
        **{f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM")},
        "LANG": "C.UTF-8",
        "MPLBACKEND": "Agg",
        "PYTHONHASHSEED": "0",
    }
