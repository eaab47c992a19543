"""From files to programs: a .py, an .ipynb or a .zip of them becomes Submissions or Refusals. Nothing is executed."""

import os
from pathlib import Path
from typing import NamedTuple

from grader.intake import archive
from grader.intake.names import one_line, unique
from grader.intake.reader import Reader
from grader.intake.source import SIZE_LIMITS, NoEntryPointError, check_size
from grader.intake.submission import Refusal, Submission


class _Outcome(NamedTuple):
    """What became of one file: its source, or the reason why there is none.

    `path` tells submissions apart and is shown; of a zip's member it is the zip's, continued. `unrelated` is a sound
    program of something else, such as a module of helpers.
    """

    path: Path
    source: str | None
    reason: str = ""
    unrelated: bool = False


def gather(paths, assignment):
    """Every program the instructor's files, zips and folders hold.

    Parameters
    ----------
    paths : iterable of str or Path
        Files, or folders to search: hidden names, `__pycache__` and files of other kinds are passed over, there and in
        zips. A zip found in a folder is one student's. A zip named here is a class's when more than one of its programs
        is, or may be meant as, a submission.
    assignment : Assignment
        Whose entry point a program must define.

    Returns
    -------
    submissions : list of Submission
    refusals : list of Refusal
        One for each file, zip or folder that gives no program. Together the names are unique: the file's stem or,
        where stems are equal, the path below the folder they share. One student's zip counts as a file, a class's as
        a folder.
    """
    found, seen = [], set()
    for path in map(Path, paths):
        for file, problem in _search(path):
            identity = os.path.realpath(file)
            if identity not in seen:
                seen.add(identity)
                found.append((file, problem, file != path))
    outcomes = []
    with Reader(assignment.entry_point, assignment.parameters) as reader:
        for file, problem, one_student in found:
            if problem:
                outcomes.append(_Outcome(file, None, problem))
            elif file.suffix.lower() == ".zip":
                outcomes += _from_zip(file, reader, one_student)
            else:
                outcomes.append(_from_file(file, reader))
    submissions, refusals = [], []
    for outcome, name in zip(outcomes, unique([outcome.path for outcome in outcomes]), strict=True):
        shown = one_line(str(outcome.path), limit=1000)
        if outcome.source is not None:
            submissions.append(Submission(name, shown, outcome.source))
        else:
            refusals.append(Refusal(name, shown, one_line(outcome.reason)))
    return submissions, refusals


def _outcome(path, content, ending, reader):
    """What becomes of a program's bytes."""
    try:
        return _Outcome(path, reader.read(content, ending))
    except NoEntryPointError as error:
        return _Outcome(path, None, str(error), unrelated=True)
    except ValueError as error:
        return _Outcome(path, None, str(error))


def _content(path):
    """A file's bytes; ValueError says why it has none."""
    ending = path.suffix.lower()
    if ending not in SIZE_LIMITS:
        raise ValueError(f"unknown file type {ending or '(no ending)'}: hand in a .py, .ipynb or .zip file")
    try:
        # A named pipe would wait for its writer for ever.
        if not path.is_file():
            raise ValueError("is not a regular file: hand in the file itself")
        with open(path, "rb") as file:
            content = file.read(SIZE_LIMITS[ending] + 1)
    except OSError as error:
        raise ValueError(f"cannot be read ({error.strerror}): check the file and its permissions") from None
    check_size(len(content), ending)
    return content


def _from_file(file, reader):
    try:
        return _outcome(file, _content(file), file.suffix.lower(), reader)
    except ValueError as error:
        return _Outcome(file, None, str(error))


def _from_zip(file, reader, one_student):
    """Outcomes of a zip's members, or one for the zip."""
    try:
        members, problems = archive.inspect(file)
    except ValueError as error:
        return [_Outcome(file, None, str(error))]
    read, refused = [], [_Outcome(_inside(file, name), None, reason) for name, reason in problems]
    for member in members:
        path = _inside(file, member.name)
        try:
            content = archive.read(file, member)
        except ValueError as error:
            refused.append(_Outcome(path, None, str(error)))
        else:
            read.append(_outcome(path, content, member.ending, reader))
    related = [outcome for outcome in read if not outcome.unrelated]
    if not one_student and members and len(related) + len(refused) > 1:
        return read + refused
    # One student's. Its helpers and drafts do not matter beside one program; anything wrong with the zip does.
    good = [outcome for outcome in related if outcome.source is not None]
    if len(good) == 1 and not refused:
        return [_Outcome(file, good[0].source)]
    if len(good) > 1 and not refused:
        names = ", ".join(_below(outcome.path, file) for outcome in good[:3])
        reason = f"holds {len(good)} programs ({names}{', …' if len(good) > 3 else ''}): leave one"
        return [_Outcome(file, None, f"{reason}, or name the zip itself if it is a class's")]
    if worst := refused or related or read:
        return [_Outcome(file, None, f"{_below(worst[0].path, file)}: {worst[0].reason}")]
    return [_Outcome(file, None, "holds no .py or .ipynb file: zip the program")]


def _inside(file, name):
    """The path of a zip's member, for people: below the zip, whatever its name claims."""
    parts = [one_line(part) for part in name.split("/") if part not in ("", ".", "..")]
    return file.joinpath(*(parts or ["(no name)"]))


def _below(path, file):
    """The name of a zip's member within a line."""
    return one_line(path.relative_to(file).as_posix(), limit=80)


def _search(path):
    """Yield (file, problem or None) for what the instructor named."""
    if not path.is_dir():
        yield path, None if os.path.lexists(path) else "no such file or folder: check the path"
        return
    unreadable, count = [], 0
    for folder, subfolders, files in os.walk(path, onerror=unreadable.append):
        subfolders[:] = sorted(name for name in subfolders if not archive.passed_over(name))
        for name in sorted(files):
            file = Path(folder, name)
            if archive.passed_over(name) or file.suffix.lower() not in {*SIZE_LIMITS, ".zip"}:
                continue
            count += 1
            inside = file.resolve().is_relative_to(path.resolve())
            yield file, None if inside else "is a link that leads out of the folder: put the file itself there"
    for error in unreadable:
        yield Path(error.filename), f"cannot be read ({error.strerror}): check its permissions"
    if not count and not unreadable:
        yield path, "holds no .py, .ipynb or .zip file: name the folder that holds the submissions"
