"""What is run in the sandbox, what it may use, and the two ways in which that fails."""

from dataclasses import dataclass
from typing import Any

#: What an entry point is called with, by what it answers.
PARAMETERS = {
    "posterior": ("previous", "observation", "control", "constants", "rng"),
    "action": ("previous", "belief", "state", "constants", "rng"),
}


class SandboxError(Exception):
    """The sandbox itself does not work: the instructor's problem, not the student's."""


class Escape(SandboxError):
    """Something outlived a program that its isolation should not have let begin."""


class StudentError(Exception):
    """A program failed.

    Attributes
    ----------
    status : str
        "crashed", "timeout", "invalid posterior" (or "action"), "flooded", "exited", "memory" or "disk".
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
        Its module must be importable and its fields numbers, strings or tuples of these, however nested.
    seed : int
        Of the program's generator.
    trusted : str or None
        `module:function`, the instructor's own.
    answer : str
        A key of `PARAMETERS`: what it is called with and must return.
    """

    source: str | None
    entry_point: str
    constants: Any
    seed: int
    trusted: str | None = None
    answer: str = "posterior"

    @property
    def wanted(self):
        """What it must return, in words."""
        return f"{'an' if self.answer[0] in 'aeiou' else 'a'} {self.answer}"


@dataclass(frozen=True)
class Limits:
    """What a worker may use.

    Wall times are deadlines after which it is killed, not grades: on a busy machine they are longer (`host.patience`).

    Attributes
    ----------
    first_call, call : float
        Wall seconds for loading the source and the first call together, and for every later call.
    episode : float
        Wall seconds for all later calls together.
    memory_bytes : int
        Address space; in a control group, memory (Linux only).
    disk_bytes : int
        Of all files it keeps.
    files : int
    printed_bytes : int
    particles : int
        Of each target in a posterior.
    threads : int
    """

    first_call: float = 60.0
    call: float = 5.0
    episode: float = 120.0
    memory_bytes: int = 4 << 30
    disk_bytes: int = 16 << 20
    files: int = 1000
    printed_bytes: int = 1_000_000
    particles: int = 1_000_000
    threads: int = 64
