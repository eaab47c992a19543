"""What lies around a submission that attacks: decoys worth stealing, listeners worth calling, and a record of it all.

`Surroundings.tell` tells an attack all about it, so that it need not find it out. `differences` says what has changed
since it was last asked, and puts it right again.
"""

import contextlib
import ctypes
import fcntl
import hashlib
import os
import pty
import re
import resource
import shutil
import signal
import socket
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

CHECKOUT = Path(__file__).parents[1]
#: Everything an attack leaves behind has this in its name, or this key in System V's tables. `Surroundings.tell` makes
#: them this run's own, so that runs side by side do not meet.
NAME, KEY = "hostile", "0x686F7374"
_MARK = os.urandom(16)
_LIBC = ctypes.CDLL(None, use_errno=True)


class Surroundings:
    """Decoys and listeners; a context manager that also gives this process a folder of its own for temporary files.

    Parameters
    ----------
    secret : bytes
        Of the course.
    truth : ndarray, shape (T + 1, 6)
        Of the episode that is graded.
    public : dict of str to list
        The public episodes by the inputs of their first step.
    details : dict
        What else an attack may know.
    """

    def __init__(self, secret, truth, public, **details):
        self._stack = contextlib.ExitStack()
        self._base = Path(tempfile.mkdtemp(prefix="surroundings-"))
        self._name, self._key = NAME + os.urandom(4).hex(), int.from_bytes(os.urandom(4)) >> 1 | 1
        self._stack.callback(shutil.rmtree, self._base, ignore_errors=True)
        # Open for others to pass, as the folder for temporary files is.
        self._base.chmod(0o711)
        self._temp, self._outside = self._base / "temp", self._base / "outside"
        self._gradebook, self._secret = self._base / "gradebook.npy", self._base / "secret"
        for folder in (self._temp, self._outside, self._temp / "grader-neighbour", self._temp / "grader-neighbour/x"):
            folder.mkdir(mode=0o711)
        # Held, as by a server: what nobody holds is cleaned away.
        held = os.open(self._temp / "grader-neighbour", os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_EX)
        self._stack.callback(os.close, held)
        self._neighbour = self._temp / "grader-neighbour/x/submission.py"
        truth = np.ascontiguousarray(truth)
        self._memory = ctypes.create_string_buffer(truth.tobytes(), truth.nbytes)
        np.save(self._gradebook, truth)
        self._decoys = {
            self._gradebook: self._gradebook.read_bytes(),
            self._secret: secret,
            self._neighbour: b"def Estimator(previous, observation, control, constants, rng): return the_answer\n",
        }
        self._put_decoys()
        held = self._stack.enter_context(open(self._gradebook, "rb"))
        self._set(tempfile, "tempdir", str(self._temp))
        self._listen()
        self._terminal, slave = pty.openpty()
        os.set_blocking(self._terminal, False)
        for fd in (self._terminal, slave):
            self._stack.callback(os.close, fd)
        self._signals = 0
        former = signal.signal(signal.SIGURG, self._on_signal)
        self._stack.callback(signal.signal, signal.SIGURG, former)
        self._folders = [
            *(
                self._outside,
                self._base,
                CHECKOUT,
                CHECKOUT / "tests",
                CHECKOUT / "grader",
                CHECKOUT / "grader/sandbox",
            ),
            *(CHECKOUT / "course_lib", CHECKOUT / "course_lib/vacuum", CHECKOUT / "course_lib/vacuum/__pycache__"),
            *(Path(np.__file__).parents[1], Path.home(), Path("/tmp"), Path("/var/tmp"), Path("/dev/shm"), Path("/")),
        ]
        self._known = {
            "checkout": str(CHECKOUT),
            "temp": str(self._temp),
            "folders": [str(folder) for folder in self._folders],
            "gradebook": str(self._gradebook),
            "gradebook_fd": held.fileno(),
            "secret": str(self._secret),
            "truth_address": ctypes.addressof(self._memory),
            "truth_bytes": truth.nbytes,
            "mark_backwards": _MARK[::-1].hex(),
            "pid": os.getpid(),
            "group": os.getpgid(0),
            "port": self._port,
            "unix": str(self._base / "socket"),
            "abstract": self._base.name,
            "terminal": os.ttyname(slave),
            "public": public,
            **details,
        }
        self._blob = _MARK + b"truth"
        self._before = None

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self._tidy()
        self._stack.close()

    def tell(self, source):
        """An attack's source with what an attacker can be expected to find out."""
        source = source.replace("KNOWN = {}", f"KNOWN = {self._known!r}", 1)
        return re.sub(NAME + r"(?!\()", self._name, source).replace(KEY, hex(self._key))

    def differences(self, directories):
        """What has changed since the last call, in words; put right, as far as it can be.

        Parameters
        ----------
        directories : list of str
            Of the fork servers: nothing may lie in them.
        """
        now = self._state(directories)
        before, self._before = self._before or now, now
        changed = [
            f"{name}: {before.get(name)} -> {now.get(name)}"
            for name in sorted({*before, *now})
            if before.get(name) != now.get(name)
        ]
        if changed:
            self._tidy()
            self._before = self._state(directories)
        return changed + self._contacts()

    def _state(self, directories):
        state = {
            f"in the folder of server {number}": os.listdir(directory)
            for number, directory in enumerate(directories)
            if os.path.isdir(directory)
        }
        state["processes"] = _processes(str(self._base))
        for folder in self._folders:
            with contextlib.suppress(OSError):
                for entry in os.scandir(folder):
                    if self._name in entry.name:
                        state[entry.path] = "left there"
        for path in [*(CHECKOUT / "course_lib/vacuum").glob("*.py"), *self._decoys]:
            with contextlib.suppress(OSError):
                status = path.stat()
                state[str(path)] = (
                    (status.st_size, status.st_mtime_ns, status.st_mode, status.st_uid, status.st_nlink, status.st_ino),
                    hashlib.sha256(path.read_bytes()).hexdigest() if path in self._decoys else None,
                    tuple(os.listxattr(path)) if sys.platform == "linux" else (),
                )
        state["limits"] = tuple(resource.getrlimit(kind) for kind in range(resource.RLIMIT_NOFILE, 16))
        state["priority"] = os.getpriority(os.PRIO_PROCESS, 0), os.sched_getaffinity(0), os.sched_getscheduler(0)
        state["memory limit"] = resource.getrlimit(resource.RLIMIT_RSS)
        for name in ("shm", "sem", "msg"):
            with contextlib.suppress(OSError):
                lines = Path("/proc/sysvipc", name).read_text().splitlines()[1:]
                state[f"System V {name}"] = [line for line in lines if int(line.split()[0]) == self._key]
        with contextlib.suppress(OSError):
            state["keys"] = [line for line in Path("/proc/keys").read_text().splitlines() if self._name in line]
        # Asking and tidying up are one here.
        state["message queues"] = _message_queue_is_left(self._name)
        return state

    def _contacts(self):
        """Who has called, typed or signalled."""
        contacts = []
        for what, listener in self._listeners.items():
            with contextlib.suppress(BlockingIOError):
                while True:
                    if listener.type == socket.SOCK_STREAM:
                        listener.accept()[0].close()
                    else:
                        listener.recv(65536)
                    contacts.append(f"{what} was contacted")
        with contextlib.suppress(OSError):
            contacts.append(f"typed into the terminal: {os.read(self._terminal, 4096)}")
        if self._signals:
            contacts.append(f"signalled {self._signals} times")
            self._signals = 0
        return contacts

    def _tidy(self):
        for folder in self._folders:
            for path in folder.glob(f"*{self._name}*"):
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        self._put_decoys()
        for get, remove in (("shmget", "shmctl"), ("msgget", "msgctl")):
            arguments = (0, 0) if get == "shmget" else (0,)
            number = getattr(_LIBC, get)(self._key, *arguments)
            if number >= 0:
                getattr(_LIBC, remove)(number, 0, None)
        number = _LIBC.semget(self._key, 0, 0)
        if number >= 0:
            _LIBC.semctl(number, 0, 0)
        resource.setrlimit(resource.RLIMIT_RSS, (resource.RLIM_INFINITY,) * 2)

    def _put_decoys(self):
        for path, content in self._decoys.items():
            with contextlib.suppress(FileNotFoundError):
                path.chmod(0o644)
            path.write_bytes(content)

    def _listen(self):
        self._listeners = {
            "TCP": socket.create_server(("127.0.0.1", 0)),
            "UDP": socket.socket(socket.AF_INET, socket.SOCK_DGRAM),
            "a socket in the file system": socket.socket(socket.AF_UNIX, socket.SOCK_STREAM),
            "an abstract socket": socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM),
        }
        tcp, udp, named, abstract = self._listeners.values()
        self._port = tcp.getsockname()[1]
        udp.bind(("127.0.0.1", self._port))
        named.bind(str(self._base / "socket"))
        os.chmod(self._base / "socket", 0o777)
        named.listen()
        abstract.bind("\0" + self._base.name)
        for listener in self._listeners.values():
            listener.setblocking(False)
            self._stack.callback(listener.close)

    def _on_signal(self, number, frame):
        self._signals += 1

    def _set(self, thing, name, value):
        self._stack.callback(setattr, thing, name, getattr(thing, name))
        setattr(thing, name, value)


def _processes(folder):
    """What runs below this process, or was started below it and has left: how often which command line."""
    parents, lines, strays = {}, {}, []
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                fields = Path(entry.path, "stat").read_text().rpartition(")")[2].split()
                pid = int(entry.name)
                parents[pid] = int(fields[1])
                lines[pid] = Path(entry.path, "cmdline").read_bytes() if fields[0] != "Z" else b"a zombie"
                if folder.encode() in lines[pid] + Path(entry.path, "environ").read_bytes():
                    strays.append(pid)
    below = {os.getpid()}
    while grown := {pid for pid, parent in parents.items() if parent in below} - below:
        below |= grown
    below = (below | set(strays)) - {os.getpid()}
    return Counter(b" ".join(line.split(b"\0")[:4]).decode(errors="replace") for line in map(lines.get, below))


def _message_queue_is_left(name):
    try:
        library = ctypes.CDLL("librt.so.1", use_errno=True)
    except OSError:
        library = _LIBC
    return library.mq_unlink(f"/{name}".encode()) == 0
