"""What a notebook calls: is my function right, and if not, where does it go wrong?

    check = Checker("vacuum")
    bounce_noise = check("bounce-noise", bounce_noise)
    check.hint("bounce-noise")

A check never raises because of the student's code, and returns a function that works: the student's when it passed, the
course's otherwise, so that a notebook runs to its end however far its reader has come.
"""

import contextlib
import functools
import html
import importlib
import inspect
import io
import linecache
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from IPython.display import display

#: Seconds of CPU time a check may take: of CPU time, so that a busy machine stops nobody. Two are enough for most.
DEADLINE = 60.0


@dataclass(frozen=True)
class Exercise:
    """One question of a notebook.

    Attributes
    ----------
    name, title : str
        What the notebook calls it, and what a reader does.
    test : callable
        `test(function)` raises AssertionError with a message a student can act on; it may return a line to show with
        success.
    fallback : callable or str
        The course's own function, or "module:function".
    hints : tuple of three str
        Markdown, from a nudge to nearly the answer.
    """

    name: str
    title: str
    test: Callable[[Callable], str | None]
    fallback: Callable | str
    hints: tuple[str, str, str]

    def course_version(self):
        """The fallback, or None where the course's copy was not handed out."""
        if callable(self.fallback):
            return self.fallback
        module, _, name = self.fallback.partition(":")
        try:
            return getattr(importlib.import_module(module), name)
        except ModuleNotFoundError:
            return None


#: State -> symbol, words, colour. The colours differ for every kind of colour vision and carry white text.
STATES = {
    "passed": ("✔", "Passed", "#00699c"),
    "failed": ("✘", "Not right yet", "#b34700"),
    "not attempted": ("○", "Not attempted", "#5f6368"),
    "exception": ("⚠", "Stopped by an exception", "#8f3a7c"),
}


@dataclass(frozen=True)
class Verdict:
    """What a check found. Shows itself as HTML in a notebook and as text elsewhere.

    Attributes
    ----------
    exercise : Exercise
    state : str
        A key of `STATES`.
    message : str
        What to act on; lines.
    note : str
        What the notebook goes on with; may be empty.
    printed : str
        The beginning of what the function printed.
    """

    exercise: Exercise
    state: str
    message: str
    note: str
    printed: str = ""

    def __repr__(self):
        symbol, words, _ = STATES[self.state]
        printed = f"It printed:\n{self.printed}" if self.printed else ""
        lines = [f"{symbol} {words}: {self.exercise.title}", self.message, printed, self.note]
        return "\n    ".join("\n".join(line for line in lines if line).splitlines())

    def _repr_html_(self):
        symbol, words, colour = STATES[self.state]
        # Text keeps the theme's own colours; only the badge, which is white on dark, brings its own.
        parts = [
            f'<div style="border-left: 4px solid {colour}; padding: 0.3em 0.8em; margin: 0.3em 0">',
            f'<span style="background: {colour}; color: #ffffff; padding: 0.1em 0.5em; border-radius: 0.3em">'
            f'<span aria-hidden="true">{symbol}</span> {words}</span> <b>{html.escape(self.exercise.title)}</b>',
        ]
        if self.message:
            parts.append(f'<div style="white-space: pre-wrap; margin-top: 0.3em">{html.escape(self.message)}</div>')
        if self.printed:
            parts.append(f"<div>It printed:</div><pre>{html.escape(self.printed)}</pre>")
        if self.note:
            parts.append(f'<div style="margin-top: 0.3em"><i>{html.escape(self.note)}</i></div>')
        return "".join(parts) + "</div>"


@dataclass(frozen=True)
class Hint:
    """A hint as Markdown."""

    text: str

    def __repr__(self):
        return self.text

    def _repr_markdown_(self):
        return self.text


class Checker:
    """The checks of one notebook.

    Parameters
    ----------
    unit : str
        "vacuum" for the exercises of `grader.assignments.vacuum.exercises`.

    Raises
    ------
    ValueError
        There is no such unit.
    """

    def __init__(self, unit):
        module = f"grader.assignments.{unit}.exercises"
        try:
            exercises = importlib.import_module(module).EXERCISES
        except ModuleNotFoundError as error:
            if error.name not in (module, module.rpartition(".")[0]):
                raise
            raise ValueError(f"no exercises for unit {unit!r}: there is no module {module}") from None
        self._exercises = {exercise.name: exercise for exercise in exercises}
        self._passed = set()
        self._hints_shown = {}

    def __call__(self, name, function):
        """Check a function, show what came out, and return a function to go on with.

        Parameters
        ----------
        name : str
            The exercise.
        function : callable
            The student's.

        Returns
        -------
        callable
            `function` when it passed; the course's own otherwise (or `function`, where there is no such copy).
        """
        exercise = self._exercise(name)
        state, message, printed = judge(exercise, function)
        result, note = function, ""
        self._passed.discard(name)
        if state == "passed":
            self._passed.add(name)
        elif (course_version := exercise.course_version()) is not None:
            result, note = course_version, "The rest of the notebook goes on with the course's version."
        else:
            note = "There is no course's version here: the rest of the notebook goes on with yours."
        display(Verdict(exercise, state, message, note, printed))
        return result

    def passed(self, name):
        """Whether the last check of this exercise passed."""
        return self._exercise(name).name in self._passed

    def hint(self, name):
        """Show the first hint, then the second, then the third."""
        exercise = self._exercise(name)
        count = min(self._hints_shown.get(name, 0) + 1, len(exercise.hints))
        self._hints_shown[name] = count
        display(Hint(f"**Hint {count} of {len(exercise.hints)}** ({exercise.title}): {exercise.hints[count - 1]}"))

    def _exercise(self, name):
        if name not in self._exercises:
            raise ValueError(f"no exercise {name!r}; there are: {', '.join(self._exercises)}")
        return self._exercises[name]


def judge(exercise, function):
    """Test a function.

    Parameters
    ----------
    exercise : Exercise
    function : callable

    Returns
    -------
    state, message, printed : str
        A key of `STATES`; what to act on; the beginning of what the function printed.
    """
    if not callable(function):
        return "failed", f"expected a function, got {type(function).__name__}", ""
    output = _Beginning()
    try:
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output), _deadline(DEADLINE):
            line = exercise.test(_guarded(function))
        state, message = "passed", line or ""
    except _Raised as raised:
        error = raised.__cause__
        if isinstance(error, NotImplementedError):
            state, message = "not attempted", "Replace the line that raises NotImplementedError by your own."
        else:
            state, message = "exception", _describe(error)
    except _TookTooLongError as error:
        state, message = (
            "exception",
            f"It was stopped after {DEADLINE:g} s of CPU time: does a loop never end?{_where(error)}",
        )
    except AssertionError as error:
        state, message = "failed", str(error)
    except Exception as error:
        state = "failed"
        message = f"What the function returned cannot be read: {type(error).__name__}: {_first_line(error)}"
    return state, message, output.text()


class _Raised(BaseException):
    """Carries what the student's function raised past the test."""


class _TookTooLongError(BaseException):
    """Raised by the clock; not an Exception, so that `except Exception` lets it through."""


class _Beginning(io.TextIOBase):
    """Keeps the beginning of what is written and drops the rest."""

    limit = 400

    def __init__(self):
        self._kept = ""
        self._dropped = False

    def writable(self):
        return True

    def write(self, text):
        room = self.limit - len(self._kept)
        self._kept += text[:room]
        self._dropped |= len(text) > room
        return len(text)

    def text(self):
        return self._kept.rstrip() + (" ..." if self._dropped else "")


def _guarded(function):
    """The function on copies of its arrays: what it raises is marked as its own, what it changes is found."""
    parameters = _parameters(function)
    last = None

    @functools.wraps(function)
    def call(*arguments):
        nonlocal last
        copies = [a.copy() if isinstance(a, np.ndarray) else a for a in arguments]
        try:
            result = function(*copies)
        except _TookTooLongError:
            raise
        except BaseException as error:
            raise _Raised from error
        for i, (before, after) in enumerate(zip(arguments, copies, strict=True)):
            # What the function returned on its last call is its own to change.
            if isinstance(before, np.ndarray) and before is not last and not _same(before, after):
                name = parameters[i] if i < len(parameters) else f"number {i + 1}"
                raise AssertionError(f"changes its argument {name}: copy it first, for the caller still needs it")
        last = result
        return result

    return call


def _parameters(function):
    try:
        return list(inspect.signature(function).parameters)
    except (TypeError, ValueError):
        return []


def _same(a, b):
    return a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")


@contextlib.contextmanager
def _deadline(seconds):
    """Raise _TookTooLongError after so many seconds of CPU time, where the system has a timer for it."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(signum, frame):
        raise _TookTooLongError

    handler = signal.signal(signal.SIGPROF, stop)
    # Rings again every second, in case a bare `except:` swallowed it.
    signal.setitimer(signal.ITIMER_PROF, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, handler)


def _describe(error):
    message = _first_line(error)
    return f"{type(error).__name__}{': ' if message else ''}{message}{_where(error)}"


def _first_line(error):
    try:
        return (str(error).strip().splitlines() or [""])[0][:300]
    except Exception:
        return "its message cannot be read"


_HERE = Path(__file__).resolve().parents[1]
_NOT_THE_STUDENTS = tuple(
    str(path) for path in (_HERE / "grader", _HERE / "course_lib", Path(sys.prefix), Path(sys.base_prefix, "lib"))
)


def _where(error):
    """The innermost line of the student's own code, or nothing."""
    if isinstance(error, SyntaxError):
        return f"\nline {error.lineno}: {(error.text or '').strip()}"
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        filename = frame.f_code.co_filename
        if not filename.startswith((*_NOT_THE_STUDENTS, "<frozen", "<__array")):
            text = linecache.getline(filename, line, frame.f_globals).strip()
            return f"\nin {frame.f_code.co_name}, line {line}{': ' if text else ''}{text}"
    return ""
