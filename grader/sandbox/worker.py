"""Inside: runs one program for one episode, step by step. Everything here may be broken by the program it runs.

Nothing in this process is trusted once the program's source has been read: it may patch what it likes. All that
it can reach is its own answers.
"""

import importlib
import importlib.abc
import inspect
import json
import linecache
import os
import random
import sys
import traceback
import types

import numpy as np

from grader.sandbox import confine, isolation, seccomp, wire
from grader.sandbox.program import PARAMETERS

FILE = "submission.py"

#: After so many runs the interpreter rewrites a function's code no more.
REHEARSALS = 20

#: What the host may send is not the worker's to limit.
_CAPS = {wire.TEXT: 2**32, wire.ARRAYS: 2**32}
_ENCODE = {"posterior": wire.encode_posterior, "action": wire.encode_action}


class ProgramError(Exception):
    """The program cannot be run; the message is for its author."""


class Withheld(importlib.abc.MetaPathFinder):
    """An import hook that refuses the modules that hold the answer."""

    def __init__(self, names):
        self.names = names

    def find_spec(self, fullname, path=None, target=None):
        """Refuse a withheld module or anything in it; leave all others to the finders after this one."""
        if any(fullname == name or fullname.startswith(f"{name}.") for name in self.names):
            raise ImportError(f"{fullname} holds the answer to this assignment: write your own", name=fullname)


def serve(requests, replies, policy):
    """Read a program's setting, then its source, then answer its steps until the host hangs up. Never returns.

    Parameters
    ----------
    requests, replies : int
        File descriptors, both blocking.
    policy : dict
        As `isolation.policy` describes it.
    """
    settings = json.loads(_read_text(requests))
    try:
        constants, rng = prepare(settings, policy)
    except Exception as error:
        _write(replies, wire.encode_text(f"{type(error).__name__}: {error}"))
        os._exit(1)
    _write(replies, wire.encode_text("ready"))
    try:
        # From here on the process is the student's.
        entry_point = load(settings, _read_text(requests))
        encode = _ENCODE[settings["answer"]]
        previous = None
        while True:
            (token, *present), *arrays = _read_arrays(requests)
            inputs = [arrays.pop(0).copy() if one else None for one in present]
            previous = entry_point(previous, *inputs, constants, rng)
            try:
                frame = encode(token, previous)
            except Exception as error:
                raise _NoAnswer(str(error)) from error
            _write(replies, frame)
    except BaseException as error:
        _write(replies, wire.encode_text("\n".join(explain(error))))
    os._exit(1)


def prepare(settings, policy):
    """Build what the program is given and shut this process in, before a line of its source is read."""
    constants = build(**settings["constants"])
    withheld = policy["withheld"]
    leaked = [name for name in withheld if name in sys.modules]
    if leaked:
        raise ImportError(f"{leaked[0]} is withheld from submissions and yet preloaded in their fork server")
    sys.meta_path.insert(0, Withheld(withheld))
    rng = generator(settings["seed"])
    confine.worker(policy, settings["limits"])
    return constants, rng


def generator(seed):
    """A program's generator; the global ones are seeded, too."""
    # A program that draws from those, against the course's advice, is to repeat as well.
    random.seed(seed)
    np.random.seed(np.random.SeedSequence(seed, spawn_key=(1,)).generate_state(4))  # noqa: NPY002
    return np.random.default_rng(seed)


def rehearse():
    """Do in the fork server what every worker does first: memory that has been written here is not copied by each."""
    for _ in range(REHEARSALS):
        generator(0)
        if not isolation.kernel()[0]:
            seccomp.program(1)
        module = types.ModuleType("submission")
        exec(compile("def Estimator(previous): return previous", FILE, "exec", dont_inherit=True), module.__dict__)
        inspect.signature(module.Estimator).bind(None)
        _, *buffers = wire.encode_posterior(0.0, np.zeros((9, 2)))
        wire.decode_arrays(b"".join(bytes(buffer) for buffer in buffers))


def build(module, name, fields):
    """A dataclass from where it is defined and its fields; lists, and lists in these, become tuples."""
    return getattr(importlib.import_module(module), name)(**{key: _tuples(value) for key, value in fields.items()})


def _tuples(value):
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def load(settings, source):
    """The program's entry point.

    Raises
    ------
    ProgramError
        There is none, or it cannot be called with the contract's arguments.
    """
    name = settings["entry_point"]
    if settings["trusted"]:
        module, _, name = settings["trusted"].partition(":")
        return getattr(importlib.import_module(module), name)
    # The file is for numba, which caches a program's kernels beside it; tracebacks find the lines in the cache, even
    # when the program changes its directory.
    with open(FILE, "w", encoding="utf-8") as file:
        file.write(source)
    linecache.cache[FILE] = (len(source), None, source.splitlines(keepends=True), FILE)
    module = types.ModuleType("submission")
    module.__file__ = FILE
    sys.modules["submission"] = module
    sys.argv = [FILE]
    exec(compile(source, FILE, "exec", dont_inherit=True), module.__dict__)
    function = getattr(module, name, None)
    parameters = PARAMETERS[settings["answer"]]
    expected = f"def {name}({', '.join(parameters)})"
    if not callable(function):
        raise ProgramError(f"the file defines no function {name}: write {expected}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return function
    try:
        signature.bind(*parameters)
    except TypeError as error:
        raise ProgramError(f"expected {expected}, got def {name}{signature}") from error
    return function


class _NoAnswer(Exception):
    pass


def explain(error):
    """Status and one line for the student: what was raised, and the line of their own code where it was."""
    try:
        text = str(error)
    except Exception:
        text = ""
    if isinstance(error, _NoAnswer):
        return "invalid", text
    if isinstance(error, ProgramError):
        return "crashed", text
    what = f"{type(error).__name__}: {text}" if text else type(error).__name__
    if isinstance(error, SyntaxError) and error.filename == FILE:
        line, source = error.lineno, error.text or ""
        what = f"{type(error).__name__}: {error.msg}"
    else:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if frame.filename == FILE] or frames[-1:]
        line, source = own[-1].lineno, own[-1].line or ""
    where = f" (line {line}: {source.strip()[:120]})"
    status = {MemoryError: "memory", SystemExit: "exited"}
    return next((word for kind, word in status.items() if isinstance(error, kind)), "crashed"), what[:300] + where


def _read_text(fd):
    return wire.decode_text(_read_frame(fd))


def _read_arrays(fd):
    return wire.decode_arrays(_read_frame(fd))


def _read_frame(fd):
    _, length = wire.decode_header(_read(fd, wire.HEADER_BYTES), _CAPS)
    return _read(fd, length)


def _read(fd, length):
    data = bytearray(length)
    view = memoryview(data)
    while view:
        count = os.readv(fd, [view])
        if not count:
            os._exit(0)  # the host has hung up
        view = view[count:]
    return data


def _write(fd, buffers):
    buffers = [memoryview(buffer) for buffer in buffers]
    while buffers:
        buffers = wire.after(buffers, os.writev(fd, buffers[:64]))
