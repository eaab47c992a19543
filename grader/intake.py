"""From files to programs: a .py or .ipynb becomes a Submission or a Refusal. Nothing handed in is executed here."""

import ast
import difflib
import io
import os
import tokenize
import warnings
from collections import Counter
from pathlib import Path

from grader import notebook
from grader.submission import Refusal, Submission

#: Most bytes a file may have, by its ending.
SIZE_LIMITS = {".py": 1_000_000, ".ipynb": 100_000_000}

# Their decoders take time quadratic in the length, and nobody writes programs in them.
_NOT_FOR_SOURCE = {"idna", "punycode"}


def gather(paths, assignment):
    """Every program the instructor's files and folders hold.

    Parameters
    ----------
    paths : iterable of str or Path
        Files, or folders to search: hidden names, `__pycache__` and files of other kinds are passed over.
    assignment : Assignment
        Whose entry point a program must define.

    Returns
    -------
    submissions : list of Submission
    refusals : list of Refusal
        One for each file or folder that gives no program. Together the names are unique: the file's stem or,
        where stems are equal, the path below the folder they share.
    """
    found, seen = [], set()
    for path in map(Path, paths):
        for file, problem in _search(path):
            identity = os.path.realpath(file)
            if identity not in seen:
                seen.add(identity)
                found.append((file, problem))
    submissions, refusals = [], []
    for (file, problem), name in zip(found, _unique_names([file for file, _ in found]), strict=True):
        shown = one_line(str(file), limit=1000)
        try:
            if problem:
                raise ValueError(problem)
            submissions.append(Submission(name, shown, read(file, assignment)))
        except ValueError as error:
            refusals.append(Refusal(name, shown, one_line(str(error))))
    return submissions, refusals


def read(path, assignment):
    """Source of the program in one file.

    Parameters
    ----------
    path : Path
    assignment : Assignment

    Returns
    -------
    str
        Source that defines the entry point when executed; of a notebook, only what the entry point needs.

    Raises
    ------
    ValueError
        What is wrong with the file, where, and what to do, whatever the file contains.
    """
    ending = path.suffix.lower()
    if ending not in SIZE_LIMITS:
        raise ValueError(f"unknown file type {ending or '(no ending)'}: hand in a .py or .ipynb file")
    try:
        # A named pipe would wait for its writer for ever.
        if not path.is_file():
            raise ValueError("is not a regular file: hand in the file itself")
        with open(path, "rb") as file:
            content = file.read(SIZE_LIMITS[ending] + 1)
    except OSError as error:
        raise ValueError(f"cannot be read ({error.strerror}): check the file and its permissions") from None
    if len(content) > SIZE_LIMITS[ending]:
        remedy = "clear its outputs" if ending == ".ipynb" else "hand in the program without its data"
        raise ValueError(f"is larger than {SIZE_LIMITS[ending] // 1_000_000} MB: {remedy}")
    try:
        if ending == ".py":
            source = decode(content)
        else:
            source = notebook.extract(content, assignment.entry_point, SIZE_LIMITS[".py"])
        check_program(source, assignment)
    except SyntaxError as error:
        raise ValueError(describe(error)) from None
    except (RecursionError, MemoryError):
        raise ValueError("is nested too deeply to be read: split its longest expressions or lists") from None
    return source


def decode(content):
    """Text of a Python file: UTF-8, with or without byte order mark, or what its first two lines declare.

    Raises
    ------
    ValueError
        The bytes are not text in that encoding.
    """
    try:
        encoding, _ = tokenize.detect_encoding(io.BytesIO(content).readline)
        if encoding in _NOT_FOR_SOURCE:
            raise LookupError(f"unknown encoding: {encoding}")
        return content.decode(encoding)
    except (SyntaxError, LookupError, ValueError) as error:
        raise ValueError(f"is not text in the encoding it claims ({error}): save it as UTF-8") from None


def check_program(source, assignment):
    """Check, without executing anything, that a program compiles and defines the entry point as it is called.

    Raises
    ------
    ValueError, SyntaxError, RecursionError, MemoryError
        As the compiler says it; ValueError in the student's words for the entry point.
    """
    entry, parameters = assignment.entry_point, assignment.parameters
    expected = f"{entry}({', '.join(parameters)})"
    tree = parse(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        compile(tree, "submission", "exec", dont_inherit=True)
    binds = [(statement, notebook.bound_names(statement)) for statement in tree.body]
    binding = next((statement for statement, names in reversed(binds) if entry in names), None)
    if binding is None:
        others = sorted(set().union(*(names for _, names in binds)))
        close = difflib.get_close_matches(entry, others, n=1, cutoff=0.75)
        hint = f"rename {close[0]}, or" if close else "please"
        raise ValueError(f"defines no {entry} at its top level: {hint} define {expected}")
    if isinstance(binding, ast.AsyncFunctionDef):
        raise ValueError(f"line {binding.lineno}: {entry} is an async function: define it with def {expected}")
    # A decorator may change what the name can be called with.
    if isinstance(binding, ast.FunctionDef) and not binding.decorator_list:
        arguments = binding.args
        positional = arguments.posonlyargs + arguments.args
        required = len(positional) - len(arguments.defaults)
        enough = len(positional) >= len(parameters) or arguments.vararg
        if not enough or required > len(parameters) or None in arguments.kw_defaults:
            raise ValueError(f"line {binding.lineno}: defines {entry}({_signature(arguments)}): expected {expected}")


def parse(source):
    """`ast.parse` that warns of nothing and raises SyntaxError where it would raise ValueError."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return ast.parse(source)
        except ValueError as error:
            # Null bytes and lone surrogates.
            raise SyntaxError(str(error)) from None


def describe(error):
    """A syntax error in one line: where, what, and the text."""
    where = f"line {error.lineno}: " if error.lineno else ""
    text = f": {error.text.strip()[:80]}" if error.text and error.text.strip() else ""
    return f"{where}syntax error, {error.msg}{text} (correct it and hand in again)"


def one_line(text, limit=300):
    """Text that stays on one line and in one direction, whatever it holds: what cannot be printed is escaped."""
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return text if len(text) <= limit else text[: limit - 1] + "…"


def _signature(arguments):
    """Parameters as they are written, without defaults' values."""
    positional = arguments.posonlyargs + arguments.args
    plain = len(positional) - len(arguments.defaults)
    words = [a.arg + ("=…" if i >= plain else "") for i, a in enumerate(positional)]
    if arguments.vararg or arguments.kwonlyargs:
        words.append("*" + (arguments.vararg.arg if arguments.vararg else ""))
    words += [a.arg + ("=…" if d else "") for a, d in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)]
    return ", ".join(words + (["**" + arguments.kwarg.arg] if arguments.kwarg else []))


def _search(path):
    """Yield (file, problem or None) for what the instructor named."""
    if not path.is_dir():
        yield path, None if os.path.lexists(path) else "no such file or folder: check the path"
        return
    unreadable, count = [], 0
    for folder, subfolders, files in os.walk(path, onerror=unreadable.append):
        subfolders[:] = sorted(name for name in subfolders if not name.startswith(".") and name != "__pycache__")
        for name in sorted(files):
            file = Path(folder, name)
            if name.startswith(".") or file.suffix.lower() not in SIZE_LIMITS:
                continue
            count += 1
            inside = file.resolve().is_relative_to(path.resolve())
            yield file, None if inside else "is a link that leads out of the folder: put the file itself there"
    for error in unreadable:
        yield Path(error.filename), f"cannot be read ({error.strerror}): check its permissions"
    if not count and not unreadable:
        yield path, "holds no .py or .ipynb file: name the folder that holds the submissions"


def _unique_names(files):
    """Names for tables, as short as they can be and still differ."""
    absolute = [Path(os.path.abspath(file)) for file in files]
    stems = {}
    for file in absolute:
        stems.setdefault(file.stem, []).append(file.parent)
    shared = {stem: os.path.commonpath(parents) for stem, parents in stems.items()}

    def name(file, level):
        below = file.relative_to(shared[file.stem])
        candidates = [file.stem, below.with_suffix("").as_posix(), below.as_posix(), file.as_posix()]
        return one_line(candidates[level], limit=1000)

    levels = [0] * len(files)
    while True:
        names = [name(file, level) for file, level in zip(absolute, levels, strict=True)]
        count = Counter(names)
        clashing = [i for i, each in enumerate(names) if count[each] > 1 and levels[i] < 3]
        if not clashing:
            return names
        for i in clashing:
            levels[i] += 1
