"""Outside: starts workers, sends them steps, and trusts nothing that comes back.

Deadlines, CPU time, the shape of a posterior and its values are all measured or checked in this process.
"""

import json
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from grader.sandbox import wire
from grader.sandbox.channel import Channel, Flooded, HungUp
from grader.sandbox.posterior import PosteriorError, check
from grader.sandbox.zygote import remove

#: Characters that are kept of what a program says of its own failure.
KEPT_CHARACTERS = 500
#: Seconds until a fork server has imported everything, and until it must have answered a request.
LAUNCH_SECONDS, ANSWER_SECONDS = 120.0, 30.0
#: Seconds a worker that hung up has to end, so that its exit status is its own.
GRACE_SECONDS = 1.0
_TEXT_BYTES = 4096


class SandboxError(Exception):
    """The sandbox itself does not work: the instructor's problem, not the student's."""


class StudentError(Exception):
    """A program failed.

    Attributes
    ----------
    status : str
        "crashed", "timeout", "invalid posterior", "flooded", "exited" or "memory".
    message : str
        One line for the student.
    """

    def __init__(self, status, message):
        super().__init__(f"{status}: {message}")
        self.status, self.message = status, message


@dataclass(frozen=True)
class Program:
    """What a worker runs.

    Attributes
    ----------
    source : str or None
        Untrusted text; None when `trusted` says what to run.
    entry_point : str
        The function that the source defines.
    constants : dataclass
        Its module must be importable and its fields numbers, strings or tuples of these.
    seed : int
        Of the estimator's generator.
    withheld : tuple of str
        Modules that the source must not import.
    trusted : str or None
        `module:function`, the instructor's own.
    """

    source: str | None
    entry_point: str
    constants: Any
    seed: int
    withheld: tuple[str, ...] = ()
    trusted: str | None = None


@dataclass(frozen=True)
class Limits:
    """What a worker may use.

    Attributes
    ----------
    first_call, call : float
        Wall seconds for loading the source and the first call together, and for every later call.
    memory_bytes : int
        Address space (Linux only).
    printed_bytes : int
    particles : int
        Of each target.
    """

    first_call: float = 60.0
    call: float = 5.0
    memory_bytes: int = 4 << 30
    printed_bytes: int = 1_000_000
    particles: int = 1_000_000


class Server:
    """A fork server that has imported what programs need; a context manager, for one thread.

    Parameters
    ----------
    preload : sequence of str
        Modules to import beside the common ones, such as that of the constants. None may be withheld from a program.
    trusted : str, optional
        `module:function` of a reference that this server's workers run: imported before they are forked, so that
        they begin with their kernels loaded.
    """

    def __init__(self, preload: Sequence[str] = (), trusted: str | None = None):
        self._modules = [*preload, *([trusted.partition(":")[0]] if trusted else [])]
        self._process = None

    def __enter__(self):
        self._launch()
        return self

    def __exit__(self, *exception):
        self.close()

    def start(self, program, limits=Limits(), *, dimension):
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
        remove(self.directory)

    def ask(self, do, descriptors=(), **details):
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
        self.directory = tempfile.mkdtemp(prefix="grader-")
        self._log = tempfile.TemporaryFile()
        self._control, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "grader.sandbox.zygote", str(theirs.fileno()), self.directory],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                env=_environment(),
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        request = {"id": 0, "do": "import", "modules": self._modules}
        self._control.sendall(json.dumps(request).encode() + b"\n")
        self._count, self._buffer, self._imported = 0, b"", False

    def _answer(self, number, seconds):
        self._control.settimeout(seconds)
        while True:
            while b"\n" not in self._buffer:
                data = self._control.recv(65536)
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


class Worker:
    """One program in one process for one episode; a context manager. `Server.start` makes it."""

    def __init__(self, server, program, limits, dimension):
        self._server, self._program, self._limits, self._dimension = server, program, limits, dimension
        self._step = 0
        self._pid, self._cpu_seconds = None, 0.0
        self._directory = tempfile.mkdtemp(dir=server.directory)
        self._channel = Channel(limits.printed_bytes)
        try:
            self._pid = server.ask("fork", self._channel.theirs, directory=self._directory)["pid"]
            self._channel.close_theirs()
            self._prepare()
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    @property
    def printed(self):
        """The beginning of what the program has printed."""
        return self._channel.printed.decode(errors="replace")

    def step(self, observation, control):
        """Send one step and return the posterior that comes back.

        Parameters
        ----------
        observation, control : array_like or None
            Both None first: the prior is asked for.

        Returns
        -------
        Particles, Gaussian or list of these
            Checked, and normalised here.

        Raises
        ------
        StudentError
            The program failed; its process is gone.
        SandboxError
        """
        if self._pid is None:
            raise SandboxError("this worker has ended")
        if self._channel.has_reply():
            # Whatever lies there answers nothing that was asked.
            self._fail("invalid posterior", f"step {self._step}: an answer came before the step was sent")
        inputs = [np.asarray(part, dtype=float) for part in (observation, control) if part is not None]
        # The answer must repeat the token, which nobody can know before the request is there.
        token = float(secrets.randbits(52))
        buffers = wire.encode_arrays([[token, observation is not None, control is not None], *inputs])
        seconds = self._limits.call
        if self._step == 0:
            seconds = self._limits.first_call
            buffers = wire.encode_text(self._program.source or "") + buffers
        posterior = self._exchange(buffers, seconds, token)
        self._step += 1
        return posterior

    def cpu_seconds(self):
        """CPU time the process has used since it was forked, its threads included; read from the kernel."""
        if self._pid is not None:
            self._cpu_seconds = _process_cpu_seconds(self._pid)
        return self._cpu_seconds

    def stop(self):
        """Halt the program and its process group until `cont`."""
        self._signal(signal.SIGSTOP)

    def cont(self):
        """Let it go on."""
        self._signal(signal.SIGCONT)

    def close(self):
        """Kill the process and all that it started, and remove its directory; idempotent."""
        try:
            self._end(0.0)
        except SandboxError:
            pass  # a fork server that is gone has taken its workers with it

    def _signal(self, number):
        # The process stays at least a zombie until `_end`, so that its number is nobody else's.
        if self._pid is not None:
            os.killpg(self._pid, number)

    def _end(self, grace):
        """Close; the exit status, if the process ended by itself within `grace` seconds."""
        directory, self._directory = self._directory, None
        if directory is None:
            return None
        try:
            if self._pid is None:
                return None
            self.cpu_seconds()
            pid, self._pid = self._pid, None
            return self._server.ask("end", pid=pid, grace=grace)["status"]
        finally:
            self._channel.close()
            remove(directory)

    def _fail(self, status, message):
        self.close()
        raise StudentError(status, message)

    def _prepare(self):
        """Hand over all but the source: until it reads that, the worker is ours and its failures are, too."""
        program = self._program
        settings = {
            "entry_point": program.entry_point,
            "trusted": program.trusted,
            "constants": _describe(program.constants),
            "seed": program.seed,
            "withheld": [] if program.trusted else program.withheld,
            "memory_bytes": self._limits.memory_bytes,
        }
        try:
            _, payload = self._channel.exchange(
                wire.encode_text(json.dumps(settings)), ANSWER_SECONDS, {wire.TEXT: _TEXT_BYTES}
            )
            answer = wire.decode_text(payload)
        except (TimeoutError, Flooded, HungUp, wire.WireError) as error:
            self._channel.collect()
            raise SandboxError(f"the worker did not get ready ({type(error).__name__}): {self.printed}") from error
        if answer != "ready":
            raise SandboxError(f"the worker did not get ready: {answer}")

    def _exchange(self, buffers, seconds, token):
        """Send a step and make of what happens a posterior or a StudentError."""
        limits, name, step = self._limits, self._program.entry_point, self._step
        # A target's particles and their weights; several targets share the room.
        caps = {
            wire.ARRAYS: min(8 * limits.particles * (self._dimension + 1) + 4096, 2**32 - 1),
            wire.TEXT: _TEXT_BYTES,
        }
        try:
            kind, payload = self._channel.exchange(buffers, seconds, caps)
            if kind == wire.ARRAYS:
                answered, posterior = wire.decode_posterior(wire.decode_arrays(payload))
                if answered != token:
                    raise wire.WireError("an answer to another step")
                return check(posterior, self._dimension, limits.particles)
            status, message = _confession(wire.decode_text(payload))
        except TimeoutError:
            loading = "loading the file and the first call" if step == 0 else "the call"
            self._fail("timeout", f"step {step}: {loading} took longer than {seconds:g} s")
        except Flooded:
            self._fail("flooded", f"printed over {limits.printed_bytes / 1e6:g} MB; remove the print calls")
        except HungUp:
            self._fail(*self._obituary())
        except PosteriorError as error:
            self._fail("invalid posterior", f"step {step}: {error}")
        except wire.WireError as error:
            self._fail("invalid posterior", f"step {step}: expected a posterior, got {error}")
        verbs = {"crashed": "crashed", "exited": "ended the process", "memory": "ran out of memory"}
        if status in verbs:
            self._fail(status, f"{name} {verbs[status]} at step {step}: {message}")
        self._fail(status, f"step {step}: {message}")

    def _obituary(self):
        """Status and message of a process that hung up without a word."""
        where = f"at step {self._step}"
        name = self._program.entry_point
        code = self._end(GRACE_SECONDS)
        if code is None:
            return "exited", f"{name} closed its connection {where}: leave file descriptors alone"
        if code < 0:
            return "crashed", f"{name} was killed {where} by {signal.Signals(-code).name}"
        return "exited", f"{name} ended the process {where} with exit status {code}: return a posterior instead"


def _confession(text):
    """Status and message of a failure as the worker tells it: untrusted, so made one printable line."""
    status, _, message = text.partition("\n")
    if status not in ("crashed", "exited", "memory", "invalid posterior"):
        raise wire.WireError("a failure of unknown kind")
    message = "".join(letter if letter.isprintable() else " " for letter in message)
    return status, " ".join(message.split())[:KEPT_CHARACTERS]


def _describe(constants):
    """What `worker.build` rebuilds constants from."""
    kind = type(constants)
    return {
        "module": kind.__module__,
        "name": kind.__qualname__,
        "fields": {field.name: getattr(constants, field.name) for field in fields(constants)},
    }


def _environment():
    """What the fork server needs of this process's environment, and threads and hashing that do not vary."""
    kept = ("PATH", "HOME", "LD_LIBRARY_PATH", "VIRTUAL_ENV")
    return {
        **{name: os.environ[name] for name in kept if name in os.environ},
        **{f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM")},
        "LANG": "C.UTF-8",
        "MPLBACKEND": "Agg",
        "PYTHONHASHSEED": "0",
    }


def _process_cpu_seconds(pid):
    if sys.platform == "linux":
        # The clock of another process, as clock_getcpuclockid(3) computes it.
        return time.clock_gettime((~pid << 3) | 2)
    import psutil

    used = psutil.Process(pid).cpu_times()
    return used.user + used.system
