"""Names that come from untrusted files, made safe for a line, a table and a file system: here and nowhere else."""

import hashlib
import os
import unicodedata
from collections import Counter
from pathlib import Path

#: Bytes of a record's file name, without its ending.
FILE_NAME_BYTES = 120

# Separators, what some file system forbids, and what marks an escaped or shortened name.
_ESCAPED = frozenset('%/\\<>:"|?*~')


def one_line(text, limit=300):
    """Text that stays on one line and in one direction, whatever it holds: what cannot be printed is escaped."""
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return text if len(text) <= limit else text[: limit - 1] + "…"


def same(name):
    """What two names share when some file system or some reader would take one for the other."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def unique(files):
    """Names for tables, as short as they can be and still differ, also without regard to case.

    Parameters
    ----------
    files : list of Path
        Where each came from; need not exist.

    Returns
    -------
    list of str
        The stem or, where stems are equal, the path below the folder they share; one line each.
    """
    absolute = [Path(os.path.abspath(file)) for file in files]
    parents = {}
    for file in absolute:
        parents.setdefault(same(file.stem), []).append(file.parent)
    shared = {stem: os.path.commonpath(folders) for stem, folders in parents.items()}

    def name(file, level):
        below = file.relative_to(shared[same(file.stem)])
        candidates = [file.stem, below.with_suffix("").as_posix(), below.as_posix(), file.as_posix()]
        return one_line(candidates[level], limit=1000)

    levels = [0] * len(files)
    while True:
        names = [name(file, level) for file, level in zip(absolute, levels, strict=True)]
        count = Counter(map(same, names))
        clashing = [i for i, each in enumerate(names) if count[same(each)] > 1 and levels[i] < 3]
        if not clashing:
            return _numbered(names)
        for i in clashing:
            levels[i] += 1


def file_name(name):
    """A name as a file name: of any file system, never hidden, and another one for every other name.

    Parameters
    ----------
    name : str
        As `unique` gives it.

    Returns
    -------
    str
        The name itself where that will do. Otherwise escaped as in an address and, where it is too long, cut and told
        apart by a digest.
    """
    safe = "".join(c if c.isprintable() and c not in _ESCAPED else _percent(c) for c in name)
    if safe[:1] in (".", " "):
        safe = _percent(safe[0]) + safe[1:]
    if len(safe.encode()) <= FILE_NAME_BYTES:
        return safe
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return safe.encode()[: FILE_NAME_BYTES - 17].decode(errors="ignore") + "~" + digest


def _percent(character):
    return "".join(f"%{byte:02X}" for byte in character.encode("utf-8", "surrogatepass"))


def _numbered(names):
    """Names of which those that are still equal, because what sets them apart cannot be printed, bear a number."""
    taken, last, result = set(), Counter(), []
    for name in names:
        candidate = name
        while same(candidate) in taken:
            last[same(name)] += 1
            candidate = f"{name} ({last[same(name)] + 1})"
        taken.add(same(candidate))
        result.append(candidate)
    return result
