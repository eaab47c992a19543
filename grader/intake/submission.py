"""What came in: a program to grade, or the reason why there is none."""

import hashlib
from dataclasses import dataclass


@dataclass(frozen=True)
class Submission:
    """A program that can be graded.

    Attributes
    ----------
    name : str
        Whose it is, as tables show it; unique within a class.
    path : str
        The file it came from, as the instructor typed or would type it.
    source : str
        Python source that defines the entry point when executed.
    """

    name: str
    path: str
    source: str

    @property
    def digest(self):
        """SHA-256 of the source, in hexadecimal."""
        return hashlib.sha256(self.source.encode()).hexdigest()


@dataclass(frozen=True)
class Refusal:
    """A file that holds no gradable program.

    Attributes
    ----------
    name, path : str
        As in `Submission`.
    reason : str
        One line: what is wrong, where, and what to do.
    """

    name: str
    path: str
    reason: str
