"""From the bytes of one file to the source of a program. Nothing is executed.

Python's own compiler needs more time and memory for some texts than anybody has: a few hundred bytes of nested `try`
and `finally` take gigabytes. So this runs in `grader.intake.reader`'s limited process, never where grades are kept.
"""

import ast
import difflib
import io
import tokenize
import warnings

from grader.intake import notebook

#: Most bytes a file may have, by its ending.
SIZE_LIMITS = {".py": 1_000_000, ".ipynb": 100_000_000}

# Their decoders take time quadratic in the length, and nobody writes programs in them.
_NOT_FOR_SOURCE = {"idna", "punycode"}


class NoEntryPointError(ValueError):
    """A sound program of something else: neither the entry point is in it, nor a name that may be meant for it."""


def check_size(size, ending):
    """Refuse, with a ValueError, a file that is too large for what its ending says it is."""
    if size > SIZE_LIMITS[ending]:
        remedy = "clear its outputs" if ending == ".ipynb" else "hand in the program without its data"
        raise ValueError(f"is larger than {SIZE_LIMITS[ending] // 1_000_000} MB: {remedy}")


def read(content, ending, entry_point, parameters):
    """Source of the program in one file.

    Parameters
    ----------
    content : bytes
        The file.
    ending : str
        A key of `SIZE_LIMITS`.
    entry_point : str
        The function it must define.
    parameters : sequence of str
        What that is called with.

    Returns
    -------
    str
        Source that defines the entry point when executed; of a notebook, only what the entry point needs.

    Raises
    ------
    NoEntryPointError, ValueError
        What is wrong with the file, where, and what to do.
    RecursionError, MemoryError
        It is nested too deeply for the compiler, or too large for this process.
    """
    check_size(len(content), ending)
    try:
        if ending == ".py":
            source = decode(content)
        else:
            source = notebook.extract(content, entry_point, SIZE_LIMITS[".py"])
        check_program(source, entry_point, parameters)
    except SyntaxError as error:
        raise ValueError(describe(error)) from None
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


def check_program(source, entry_point, parameters):
    """Check, without executing anything, that a program compiles and defines the entry point as it is called.

    Raises
    ------
    ValueError, SyntaxError, RecursionError, MemoryError
        As the compiler says it; ValueError in the student's words for the entry point.
    """
    expected = f"{entry_point}({', '.join(parameters)})"
    tree = parse(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        compile(tree, "submission", "exec", dont_inherit=True)
    binds = [(statement, notebook.bound_names(statement)) for statement in tree.body]
    binding = next((statement for statement, names in reversed(binds) if entry_point in names), None)
    if binding is None:
        others = sorted(set().union(*(names for _, names in binds)))
        close = difflib.get_close_matches(entry_point, others, n=1, cutoff=0.75)
        kind, hint = (ValueError, f"rename {close[0]}, or") if close else (NoEntryPointError, "please")
        raise kind(f"defines no {entry_point} at its top level: {hint} define {expected}")
    if isinstance(binding, ast.AsyncFunctionDef):
        raise ValueError(f"line {binding.lineno}: {entry_point} is an async function: define it with def {expected}")
    # A decorator may change what the name can be called with.
    if isinstance(binding, ast.FunctionDef) and not binding.decorator_list:
        arguments = binding.args
        positional = arguments.posonlyargs + arguments.args
        required = len(positional) - len(arguments.defaults)
        enough = len(positional) >= len(parameters) or arguments.vararg
        if not enough or required > len(parameters) or None in arguments.kw_defaults:
            raise ValueError(
                f"line {binding.lineno}: defines {entry_point}({_signature(arguments)}): expected {expected}"
            )


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


def _signature(arguments):
    """Parameters as they are written, without defaults' values."""
    positional = arguments.posonlyargs + arguments.args
    plain = len(positional) - len(arguments.defaults)
    words = [a.arg + ("=…" if i >= plain else "") for i, a in enumerate(positional)]
    if arguments.vararg or arguments.kwonlyargs:
        words.append("*" + (arguments.vararg.arg if arguments.vararg else ""))
    words += [a.arg + ("=…" if d else "") for a, d in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)]
    return ", ".join(words + (["**" + arguments.kwarg.arg] if arguments.kwarg else []))
