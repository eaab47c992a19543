"""What is run in the sandbox, what it may use, and the two ways in which that fails."""

from dataclasses import dataclass
from typing import Any


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
