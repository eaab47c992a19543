"""Outside: launches the fork server, and starts it again when it has died."""

import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence

from grader.sandbox.host import Worker
from grader.sandbox.program import SandboxError
from grader.sandbox.zygote import remove

#: Seconds until a fork server has imported everything, and until it must have answered a request.
LAUNCH_SECONDS, ANSWER_SECONDS = 120.0, 30.0


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
            request = {"id": 0, "do": "import", "modules": self._modules}
            self._control.sendall(json.dumps(request).encode() + b"\n")
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "grader.sandbox.zygote", str(theirs.fileno()), self.directory],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                env=_environment(),
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
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
