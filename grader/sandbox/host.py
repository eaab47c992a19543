"""Outside: runs a program step by step in a worker, and trusts nothing that comes back.

Deadlines, CPU time, the shape of an answer and its values are all measured or checked in this process.
"""

import json
import os
import secrets
import signal
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import fields

import numpy as np

from grader.sandbox import wire
from grader.sandbox.answer import AnswerError, check_action, check_posterior
from grader.sandbox.channel import WATCH_SECONDS, Channel, Flooded, HungUp
from grader.sandbox.program import Escape, SandboxError, StudentError
from grader.sandbox.zygote import remove

#: Characters that are kept of what a program says of its own failure.
KEPT_CHARACTERS = 500
#: Seconds until a worker must be ready for its program's source.
READY_SECONDS = 30.0
#: Seconds a worker that hung up has to end, so that its exit status is its own.
GRACE_SECONDS = 1.0
_TEXT_BYTES = 4096


class _Filled(Exception):
    pass


class Worker:
    """One program in one process for one episode; a context manager. `Server.start` makes it."""

    def __init__(self, server, program, limits, dimension):
        self._server, self._program, self._limits, self._dimension = server, program, limits, dimension
        self._step = 0
        self._name, self._pid, self._cpu_seconds = None, None, 0.0
        self._waited, self._looked = 0.0, time.monotonic()
        self._directory = tempfile.mkdtemp(dir=server.directory)
        self._channel = Channel(limits.printed_bytes)
        try:
            self._name, self._pid = server.fork(self._channel.theirs, self._directory)
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

    def step(self, *inputs):
        """Send one step and return the answer that comes back.

        Parameters
        ----------
        *inputs : array_like or None
            Two: an estimator's observation and control, both None first, when the prior is asked for; or a planner's
            belief and state.

        Returns
        -------
        Particles, Gaussian or list of these; or ndarray
            A posterior, checked, and normalised here; or an action, checked.

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
            self.close()
            raise StudentError(self._invalid, f"step {self._step}: an answer came before the step was sent")
        arrays = [np.asarray(part, dtype=float) for part in inputs if part is not None]
        # The answer must repeat the token, which nobody can know before the request is there.
        token = float(secrets.randbits(52))
        buffers = wire.encode_arrays([[token, *(part is not None for part in inputs)], *arrays])
        seconds = min(self._limits.call, max(self._limits.episode - self._waited, 0.0))
        if self._step == 0:
            seconds = self._limits.first_call
            buffers = wire.encode_text(self._program.source or "") + buffers
        start = time.monotonic()
        answer = self._exchange(buffers, seconds, token)
        if self._step > 0:
            self._waited += time.monotonic() - start
        self._step += 1
        return answer

    def cpu_seconds(self):
        """CPU time the process has used since it was forked, its threads included; read from the kernel."""
        if self._pid is not None:
            try:
                self._cpu_seconds = _process_cpu_seconds(self._pid)
            except OSError:
                pass  # gone with its fork server: what was read last stands
        return self._cpu_seconds

    def pin(self, core):
        """Keep the program on one core, where the system can."""
        if self._pid is not None and hasattr(os, "sched_setaffinity"):
            try:
                os.sched_setaffinity(self._pid, {core})
            except OSError:
                pass  # not ours to choose: it is only measured less sharply

    def stop(self):
        """Halt the program and its process group until `cont`."""
        self._signal(signal.SIGSTOP)

    def cont(self):
        """Let it go on."""
        self._signal(signal.SIGCONT)

    def close(self):
        """Kill the process and all that it started, and remove its directory; idempotent.

        Raises
        ------
        Escape
        """
        try:
            self._end(0.0)
        except Escape:
            raise
        except SandboxError:
            pass  # a fork server that is gone has taken its workers with it

    def _signal(self, number):
        if self._pid is None:
            return
        # While the fork server lives, the process stays at least a zombie until `_end`: its number is nobody else's.
        try:
            os.killpg(self._pid, number)
        except OSError:
            pass  # gone with its fork server: the next step says so

    def _end(self, grace):
        """Close; exit status, if the process ended by itself within `grace` seconds, and whether it was starved."""
        directory, self._directory = self._directory, None
        if directory is None:
            return None, False
        try:
            if self._pid is None:
                return None, False
            self.cpu_seconds()
            self._pid = None
            return self._server.end(self._name, grace)
        finally:
            self._channel.close()
            remove(directory)

    def _prepare(self):
        """Hand over all but the source: until it reads that, the worker is ours and its failures are, too."""
        program = self._program
        settings = {
            "entry_point": program.entry_point,
            "trusted": program.trusted,
            "answer": program.answer,
            "constants": _describe(program.constants),
            "seed": program.seed,
            "limits": {name: getattr(self._limits, name) for name in ("memory_bytes", "disk_bytes", "threads")},
        }
        try:
            _, payload = self._channel.exchange(
                wire.encode_text(json.dumps(settings)), READY_SECONDS, {wire.TEXT: _TEXT_BYTES}
            )
            answer = wire.decode_text(payload)
        except (TimeoutError, Flooded, HungUp, wire.WireError) as error:
            self._channel.collect()
            raise SandboxError(f"the worker did not get ready ({type(error).__name__}): {self.printed}") from error
        if answer != "ready":
            raise SandboxError(f"the worker did not get ready: {answer}")

    def _exchange(self, buffers, seconds, token):
        """Send a step and make of what happens an answer or a StudentError."""
        program, limits, step = self._program, self._limits, self._step
        # A target's particles and their weights; several targets share the room. An action of the wrong shape is to be
        # told its shape.
        most = limits.particles * (self._dimension + 1) if program.answer == "posterior" else 1000 + self._dimension
        caps = {wire.ARRAYS: min(8 * most + 4096, 2**32 - 1), wire.TEXT: _TEXT_BYTES}
        try:
            kind, payload = self._channel.exchange(buffers, seconds, caps, self._watch)
            if time.monotonic() > self._looked + WATCH_SECONDS:
                self._watch()
            if kind == wire.ARRAYS:
                decode = wire.decode_posterior if program.answer == "posterior" else wire.decode_action
                answered, answer = decode(wire.decode_arrays(payload))
                if answered != token:
                    raise wire.WireError("an answer to another step")
                if program.answer == "posterior":
                    return check_posterior(answer, self._dimension, limits.particles)
                return check_action(answer, self._dimension)
            status, message = self._confession(wire.decode_text(payload))
        except TimeoutError:
            what = "loading the file and the first call" if step == 0 else "the call"
            if 0 < step and seconds < limits.call:
                what, seconds = "all calls up to this one", limits.episode
            status, message = "timeout", f"step {step}: {what} took longer than {seconds:g} s"
        except Flooded:
            status, message = "flooded", f"printed over {limits.printed_bytes / 1e6:g} MB; remove the print calls"
        except _Filled as error:
            status, message = "disk", f"step {step}: {error}"
        except HungUp:
            status, message = self._obituary()
        except AnswerError as error:
            status, message = self._invalid, f"step {step}: {error}"
        except wire.WireError as error:
            status, message = self._invalid, f"step {step}: expected {program.wanted}, got {error}"
        self.close()
        raise StudentError(status, message)

    def _watch(self):
        """Raise _Filled if the program keeps more files than it may."""
        self._looked = time.monotonic()
        limits, used, files = self._limits, 0, 0
        try:
            for path, directories, names in os.walk(self._directory, onerror=_raise):
                files += len(directories) + len(names)
                if files > limits.files:
                    raise _Filled(f"keeps over {limits.files} files")
                for name in names:
                    with suppress(FileNotFoundError):  # it has just removed one
                        used += os.lstat(os.path.join(path, name)).st_blocks * 512
        except OSError as error:
            raise _Filled("keeps a directory that cannot be looked into") from error
        except RecursionError as error:
            raise _Filled("nests its directories too deep") from error
        if used > limits.disk_bytes:
            raise _Filled(f"keeps over {limits.disk_bytes >> 20} MB of files")

    def _confession(self, text):
        """Status and message of a failure as the worker tells it: untrusted, so made one printable line."""
        name = self._program.entry_point
        openings = {
            "crashed": f"{name} crashed at step",
            "exited": f"{name} ended the process at step",
            "memory": f"{name} ran out of memory at step",
            "invalid": "step",
        }
        status, _, message = text.partition("\n")
        if status not in openings:
            raise wire.WireError("a failure of unknown kind")
        printable = "".join(letter if letter.isprintable() else " " for letter in message)
        message = " ".join(printable.split())[:KEPT_CHARACTERS]
        line = f"{openings[status]} {self._step}: {message}"
        return self._invalid if status == "invalid" else status, line

    @property
    def _invalid(self):
        """The status of an answer that is none."""
        return f"invalid {self._program.answer}"

    def _obituary(self):
        """Status and message of a process that hung up without a word."""
        where = f"at step {self._step}"
        name = self._program.entry_point
        code, starved = self._end(GRACE_SECONDS)
        if starved:
            return "memory", f"{name} ran out of memory {where} and was killed"
        if code is None:
            return "exited", f"{name} closed its connection {where}: leave file descriptors alone"
        if code < 0:
            return "crashed", f"{name} was killed {where} by {signal.Signals(-code).name}"
        return (
            "exited",
            f"{name} ended the process {where} with exit status {code}: return {self._program.wanted} instead",
        )


def _raise(error):
    if not isinstance(error, FileNotFoundError):
        raise error


def _describe(constants):
    """What `worker.build` rebuilds constants from."""
    kind = type(constants)
    return {
        "module": kind.__module__,
        "name": kind.__qualname__,
        "fields": {field.name: getattr(constants, field.name) for field in fields(constants)},
    }


def _process_cpu_seconds(pid):
    if sys.platform == "linux":
        # The clock of another process, as clock_getcpuclockid(3) computes it.
        return time.clock_gettime((~pid << 3) | 2)
    import psutil

    try:
        used = psutil.Process(pid).cpu_times()
    except psutil.Error as error:
        raise ProcessLookupError(str(error)) from error
    return used.user + used.system
