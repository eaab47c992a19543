"""The process that reads what was handed in, for the one that must not die of it.

Parsing Python costs, at worst, far more time and memory than the text is long, and may overflow the interpreter's
stack. So a process with limits parses; when a file exhausts it, the file is refused and the next one finds a new
process. It executes nothing of what it reads, and is shut in where the kernel can: a compiler has faults.
"""

import os
import signal
import struct
import subprocess
import sys
import time

from grader.intake import source
from grader.intake.names import one_line
from grader.sandbox import confine, isolation

#: CPU seconds for one file, and address space (Linux): an honest file of the largest size needs a fifth of either.
CPU_SECONDS, MEMORY_BYTES = 10, 2 << 30

_ENDINGS = tuple(source.SIZE_LIMITS)
_READY, _SOURCE, _REFUSED, _OTHER, _EXHAUSTED = range(5)
# Of a request: which ending, and how many bytes follow. Of an answer: one of the above, and how many bytes follow.
_HEADER = struct.Struct("<BQ")


class Reader:
    """Reads programs in another process; a context manager, for one thread.

    Parameters
    ----------
    entry_point : str
    parameters : sequence of str
        What a program must define, and what it is called with.
    """

    def __init__(self, entry_point, parameters):
        self._arguments = [entry_point, *parameters]
        self._process = None

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self._end()

    def read(self, content, ending):
        """Source of the program in one file.

        Parameters
        ----------
        content : bytes
        ending : str
            `.py` or `.ipynb`.

        Returns
        -------
        str

        Raises
        ------
        grader.intake.source.NoEntryPointError, ValueError
            What is wrong with the file, where, and what to do, whatever the file holds.
        RuntimeError
            The process cannot be started: not the file's fault.
        """
        if self._process is None:
            self._start()
        try:
            self._process.stdin.write(_HEADER.pack(_ENDINGS.index(ending), len(content)))
            self._process.stdin.write(content)
            self._process.stdin.flush()
            status, text = self._answer()
        except (BrokenPipeError, EOFError):
            raise ValueError(_obituary(self._end(kill=False), ending)) from None
        if status == _SOURCE:
            return text
        if status == _EXHAUSTED:
            self._end()
        raise (source.NoEntryPointError if status == _OTHER else ValueError)(one_line(text))

    def _start(self):
        kept = ("PATH", "HOME", "LD_LIBRARY_PATH", "VIRTUAL_ENV")
        self._process = subprocess.Popen(
            # -P: a file called ast.py in the instructor's folder is not to be imported.
            [sys.executable, "-P", "-m", "grader.intake.reader", str(CPU_SECONDS), str(MEMORY_BYTES), *self._arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={name: os.environ[name] for name in kept if name in os.environ} | {"LANG": "C.UTF-8"},
            start_new_session=True,
        )
        try:
            self._answer()
        except EOFError:
            raise RuntimeError(f"the process that reads submissions did not start (exit code {self._end()})") from None

    def _answer(self):
        status, length = _HEADER.unpack(self._receive(_HEADER.size))
        return status, self._receive(length).decode("utf-8", "surrogatepass")

    def _receive(self, length):
        data = self._process.stdout.read(length)
        if len(data) < length:
            raise EOFError
        return data

    def _end(self, kill=True):
        """Exit code of the process, or None when there is none; it is killed, or is dying by itself."""
        if self._process is None:
            return None
        process, self._process = self._process, None
        if kill:
            process.kill()
        code = process.wait()
        try:
            process.stdin.close()
        except BrokenPipeError:
            pass  # with part of a request in its buffer
        process.stdout.close()
        return code


def serve(requests, replies, seconds, entry_point, parameters):
    """Answer requests until there are no more; one that takes more CPU time than `seconds` ends the process."""
    _send(replies, _READY, "")
    while header := requests.read(_HEADER.size):
        ending, length = _HEADER.unpack(header)
        content = requests.read(length)
        _allow(seconds)
        try:
            answer = _SOURCE, source.read(content, _ENDINGS[ending], entry_point, parameters)
        except (RecursionError, MemoryError):
            answer = _EXHAUSTED, "is too large or nested too deeply to be read: split its longest expressions or lists"
        except source.NoEntryPointError as error:
            answer = _OTHER, str(error)
        except ValueError as error:
            answer = _REFUSED, str(error)
        _send(replies, *answer)


def _send(replies, status, text):
    data = text.encode("utf-8", "surrogatepass")
    replies.write(_HEADER.pack(status, len(data)))
    replies.write(data)
    replies.flush()


def _allow(seconds):
    """Let the kernel end this process when it has used so much CPU time from now on."""
    if os.name == "posix":
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_CPU)
        soft = int(time.process_time()) + 1 + seconds
        resource.setrlimit(resource.RLIMIT_CPU, (soft if hard == resource.RLIM_INFINITY else min(soft, hard), hard))


def _limit(memory):
    if os.name == "posix":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if sys.platform == "linux":
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))


def _obituary(code, ending):
    """Why a file is refused on which the process died."""
    remedy = "clear its outputs, and split its longest expressions" if ending == ".ipynb" else "simplify it"
    if os.name == "posix" and code == -signal.SIGXCPU:
        return f"takes more than {CPU_SECONDS} s to be read: {remedy}"
    return f"cannot be read, Python's compiler fails on it (exit code {code}): {remedy}"


if __name__ == "__main__":
    cpu, memory, name, *called_with = sys.argv[1:]
    _limit(int(memory))
    if not isolation.kernel()[0]:
        confine.reader(isolation.roots_of_python())
    serve(sys.stdin.buffer, sys.stdout.buffer, int(cpu), name, called_with)
