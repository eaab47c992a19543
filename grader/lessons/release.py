"""Make the notebooks from their sources: `solutions/NN_topic.md` becomes two notebooks.

`solutions/NN_topic.ipynb` is worked and executed, `notebooks/NN_topic.ipynb` is what students open. `lesson` says how a
source is written.
"""

import copy
import json
import os
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

from grader.lessons.lesson import METADATA, ReleaseError, missing_equations, read, student_copy, where

__all__ = ["ReleaseError", "missing_equations", "release", "stale"]

#: Bytes a worked notebook may have. Larger ones are slow to open and no code host renders them.
LARGEST = 3_000_000

#: A widget is a model in the kernel, which a file does not hold: its output is a random number.
WIDGET = "application/vnd.jupyter.widget-view+json"

#: Wall seconds one cell may run.
CELL_TIMEOUT = 600


@dataclass(frozen=True)
class _Lesson:
    source: Path  # solutions/NN_topic.md
    worked: Path  # solutions/NN_topic.ipynb
    student: Path  # notebooks/NN_topic.ipynb
    notebook: nbformat.NotebookNode  # worked, not executed


def release(root, execute=True, progress=lambda name, cell, cells: None):
    """Write the worked notebook and the student copy of every lesson.

    Each file is replaced whole or not at all; a lesson that fails leaves both of its products as they were.

    Parameters
    ----------
    root : path
        The folder that holds `solutions` and `notebooks`.
    execute : bool
        Without it the worked notebook takes over the outputs of the last one in cells that are the same.
    progress : callable
        `progress(name, cell, cells)`: cell number `cell` (from 1) of `cells` of this lesson begins.

    Returns
    -------
    list of Path
        The products, in order.

    Raises
    ------
    ReleaseError
        A source is malformed (then nothing is executed), a cell raised, or a notebook became too large.
    """
    products = []
    for lesson in _lessons(root):
        student = _dump(student_copy(lesson.notebook))
        if execute:
            worked = _execute(lesson, root, progress)
        else:
            worked = _with_old_outputs(lesson)
        text = _dump(worked)
        if len(text.encode()) > LARGEST:
            largest = max(range(len(worked.cells)), key=lambda i: len(json.dumps(worked.cells[i])))
            raise ReleaseError(
                f"{where(lesson.source, worked, largest)}: the worked notebook has {len(text.encode()) / 1e6:.1f} MB, "
                f"most of it from this cell; keep it under {LARGEST / 1e6:.0f} MB with fewer frames or dots per inch"
            )
        for path, content in [(lesson.worked, text), (lesson.student, student)]:
            _write(path, content)
            products.append(path)
    return products


def stale(root):
    """What `release` would change, found without executing anything.

    Parameters
    ----------
    root : path

    Returns
    -------
    list of str
        One line per product that is missing, differs from its source, was not executed, or has no source.

    Raises
    ------
    ReleaseError
        A source is malformed.
    """
    root = Path(root)
    lines = []
    products = set()
    for lesson in _lessons(root):
        products |= {lesson.worked, lesson.student}
        for path, difference in [
            (lesson.worked, _difference(lesson.worked, lesson.notebook)),
            (lesson.student, _student_difference(lesson)),
        ]:
            if difference:
                lines.append(f"{path.relative_to(root)}: {difference}; run `grader release`")
    for folder in ("solutions", "notebooks"):
        for path in sorted((root / folder).glob("*.ipynb")):
            if path not in products:
                lines.append(
                    f"{path.relative_to(root)}: has no source solutions/{path.stem}.md; write that, or delete this"
                )
    return lines


def _lessons(root):
    root = Path(root)
    sources = sorted((root / "solutions").glob("*.md"))
    if not sources:
        raise ReleaseError(f"{root / 'solutions'}: holds no lesson (NN_topic.md); is this the course's folder?")
    return [
        _Lesson(path, path.with_suffix(".ipynb"), root / "notebooks" / f"{path.stem}.ipynb", read(path))
        for path in sources
    ]


def _execute(lesson, root, progress):
    """The worked notebook with outputs that a second run repeats byte for byte."""
    notebook = copy.deepcopy(lesson.notebook)
    started = 0

    def begins(cell, cell_index):
        nonlocal started
        started = cell_index
        progress(lesson.source.stem, cell_index + 1, len(notebook.cells))

    client = NotebookClient(
        notebook,
        timeout=CELL_TIMEOUT,
        kernel_name="python3",
        resources={"metadata": {"path": str(lesson.source.parent)}},
        record_timing=False,
        coalesce_streams=True,
        # Without its warning that the connection to this very machine is not encrypted.
        extra_arguments=["--log-level=ERROR"],
        on_cell_start=begins,
    )
    try:
        # Sets are printed in the order of their hashes, and SVG figures hold the date, unless told otherwise.
        client.execute(env={**os.environ, "PYTHONHASHSEED": "0", "SOURCE_DATE_EPOCH": "0"})
    except CellExecutionError as error:
        raise ReleaseError(
            f"{where(lesson.source, notebook, started)}: {error.ename}: {error.evalue}".splitlines()[0]
        ) from None
    except CellTimeoutError:
        raise ReleaseError(f"{where(lesson.source, notebook, started)}: ran for more than {CELL_TIMEOUT} s") from None
    except DeadKernelError:
        raise ReleaseError(f"{where(lesson.source, notebook, started)}: the kernel died") from None
    notebook.metadata = nbformat.from_dict(METADATA)
    return _repeatable(notebook, Path(root).resolve())


def _repeatable(notebook, root):
    """The notebook without what differs from run to run or from machine to machine in its outputs."""
    names = {}

    def rename(match):
        return names.setdefault(match[0], f"{len(names) + 1:032x}")

    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type != "code" or not cell.outputs:
            continue
        cell.outputs = [output for output in cell.outputs if WIDGET not in output.get("data", {})]
        text = json.dumps(cell.outputs)
        text = re.sub(r"\bat 0x[0-9a-f]+", "at 0x0", text)
        text = re.sub(r"(?:/[\w.-]+)*/ipykernel_\d+/\d+\.py", "cell.py", text)
        text = re.sub(r"(?<![0-9a-f])[0-9a-f]{32}(?![0-9a-f])", rename, text)
        for path, word in [(sys.prefix, "PYTHON"), (str(root), "COURSE"), (str(Path.home()), "HOME")]:
            text = text.replace(path, word)
        cell.outputs = nbformat.from_dict(json.loads(text))
    return notebook


def _with_old_outputs(lesson):
    notebook = copy.deepcopy(lesson.notebook)
    if lesson.worked.exists():
        old = {cell.id: cell for cell in _load(lesson.worked).cells}
        for cell in notebook.cells:
            before = old.get(cell.id)
            if cell.cell_type == "code" and before is not None and before.source == cell.source:
                cell.outputs, cell.execution_count = before.outputs, before.execution_count
    return notebook


def _difference(path, expected):
    """How the worked notebook on disk differs from what its source says, or nothing."""
    if not path.exists():
        return "is missing"
    try:
        found = _load(path)
    except Exception:
        return "is no notebook"
    if _bare(found.metadata) != METADATA or found.nbformat_minor != expected.nbformat_minor:
        return "has other metadata than its source"
    for i, cell in enumerate(expected.cells):
        if i >= len(found.cells):
            return f"ends before cell {i + 1}"
        other = found.cells[i]
        if any(_bare(cell[key]) != _bare(other.get(key)) for key in ("cell_type", "id", "metadata", "source")):
            return f"differs from its source in cell {i + 1}"
        if cell.cell_type == "code" and cell.source.strip() and other.execution_count is None:
            return f"was not executed in cell {i + 1}"
    return f"goes on after cell {len(expected.cells)}" if len(found.cells) > len(expected.cells) else ""


def _student_difference(lesson):
    if not lesson.student.exists():
        return "is missing"
    expected = _dump(student_copy(lesson.notebook))
    return "" if lesson.student.read_bytes() == expected.encode() else "differs from its source"


def _bare(value):
    return json.loads(json.dumps(value))


def _load(path):
    return nbformat.reads(path.read_text(encoding="utf-8"), as_version=4)


def _dump(notebook):
    nbformat.validate(notebook)
    return nbformat.writes(notebook) + "\n"


def _write(path, text):
    """Replace a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
