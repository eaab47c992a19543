"""The host's three pipes to a worker: requests down, replies up, and what the program prints."""

import fcntl
import os
import select
import time

import numpy as np

from grader.sandbox import wire

#: Bytes of what was printed that are kept.
KEPT_BYTES = 4096
#: A posterior of 20 000 particles passes through a pipe of this size in one go.
_PIPE_BYTES = 1 << 20


#: Between two looks at what a program is doing during a call.
WATCH_SECONDS = 0.25
#: A busy machine lengthens deadlines up to so many times: a program can make the machine busy itself.
MOST_PATIENCE = 8.0


def patience():
    """How many times longer than on an idle machine a program may take by the clock on the wall: processes per core."""
    try:
        with open("/proc/loadavg") as file:
            recent, _, _, now, _ = file.read().split()
        load = max(float(recent), float(now.partition("/")[0]))
    except OSError:
        load = os.getloadavg()[0]
    return min(max(load / (os.cpu_count() or 1), 1.0), MOST_PATIENCE)


class Flooded(Exception):
    """More was printed than may be."""


class HungUp(Exception):
    """The other end of the replies has been closed."""


class Channel:
    """Pipes that the host never blocks on.

    Attributes
    ----------
    theirs : list of int
        The worker's ends: requests to read, replies to write, output to write. `close_theirs` once it has them.
    printed : bytes
        The beginning of what was printed.
    """

    def __init__(self, printed_bytes):
        self._most_printed, self._count_printed = printed_bytes, 0
        self.printed = b""
        their_requests, self._requests = os.pipe()
        self._replies, their_replies = os.pipe()
        self._output, their_output = os.pipe()
        self.theirs = [their_requests, their_replies, their_output]
        self._open = [self._requests, self._replies, self._output]
        for fd in self._open:
            os.set_blocking(fd, False)
        if hasattr(fcntl, "F_SETPIPE_SZ"):
            try:
                fcntl.fcntl(self._replies, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
            except OSError:
                pass  # the user has used up what the system grants; smaller pipes are only slower

    def close(self):
        """Close this end; idempotent."""
        self.close_theirs()
        while self._open:
            os.close(self._open.pop())

    def close_theirs(self):
        """Close the worker's ends in this process; idempotent."""
        while self.theirs:
            os.close(self.theirs.pop())

    def has_reply(self):
        """Whether bytes lie in the pipe of replies."""
        poll = select.poll()
        poll.register(self._replies, select.POLLIN)
        return any(event & select.POLLIN for _, event in poll.poll(0))

    def exchange(self, buffers, seconds, caps, watch=None):
        """Write, then read one frame, and collect what is printed meanwhile.

        Parameters
        ----------
        buffers : list of bytes-like
        seconds : float
            Wall time for all of it, on a machine that is not busy.
        caps : dict of int to int
            As in `wire.decode_header`.
        watch : callable, optional
            Called about every `WATCH_SECONDS` meanwhile; what it raises ends the exchange.

        Returns
        -------
        kind : int
        payload : ndarray of uint8
            Aligned, and nobody else's.

        Raises
        ------
        TimeoutError, Flooded, HungUp, WireError
        """
        start = time.monotonic()
        deadline, look = start + seconds, start + WATCH_SECONDS
        pending = [memoryview(buffer) for buffer in buffers]
        kind, data = None, np.empty(wire.HEADER_BYTES, dtype=np.uint8)
        missing = memoryview(data)
        poll = select.poll()
        poll.register(self._requests, select.POLLOUT)
        poll.register(self._replies, select.POLLIN)
        if self._output in self._open:
            poll.register(self._output, select.POLLIN)
        while missing or kind is None:
            if not missing:
                kind, length = wire.decode_header(data, caps)
                data = np.empty(length, dtype=np.uint8)
                missing = memoryview(data)
                continue
            now = time.monotonic()
            if now >= deadline:
                deadline = start + seconds * patience()
                if now >= deadline:
                    raise TimeoutError
            if now >= look and watch is not None:
                watch()
                look = now + WATCH_SECONDS
            for fd, _ in poll.poll(1000 * min(deadline - now, WATCH_SECONDS)):
                if fd == self._requests:
                    pending = self._write(pending)
                    if not pending:
                        poll.unregister(fd)
                elif fd == self._output:
                    if not self._collect_some():
                        poll.unregister(fd)
                elif missing:
                    missing = missing[self._read_into(missing) :]
        self.collect()
        return kind, data

    def collect(self):
        """Read what has been printed, without waiting for more; Flooded if it is too much."""
        while self._output in self._open and self._collect_some():
            pass

    def _collect_some(self):
        """Read a piece of what was printed; False when there is none."""
        try:
            data = os.read(self._output, 1 << 16)
        except BlockingIOError:
            return False
        if not data:
            self._open.remove(self._output)
            os.close(self._output)
            return False
        self.printed += data[: KEPT_BYTES - len(self.printed)]
        self._count_printed += len(data)
        if self._count_printed > self._most_printed:
            raise Flooded
        return True

    def _read_into(self, view):
        try:
            count = os.readv(self._replies, [view])
        except BlockingIOError:
            return 0
        if not count:
            raise HungUp
        return count

    def _write(self, buffers):
        """Write what the pipe takes; the rest."""
        try:
            count = os.writev(self._requests, buffers[:64])
        except BlockingIOError:
            return buffers
        except BrokenPipeError:
            return []  # the pipe of replies will say so
        return wire.after(buffers, count)
