r"""A lesson's one source, and the two notebooks it stands for.

`solutions/NN_topic.md` (MyST Markdown, read by jupytext) is what an author edits. What an author needs to know:

* A code cell that holds `### BEGIN SOLUTION` / `### END SOLUTION` has its exercise's name: `:name: bounce` as the
  cell's first line, or in its YAML header. Students find nbgrader's stub in place of the region.
* A code cell that calls `check("bounce", ...)` is the graded cell of that exercise: one point, or what the cell's
  `:points:` says. Unless it has hidden tests of its own, it gets `assert check.passed("bounce")` as one, without
  which nbgrader would grant the point to anyone.
* `### BEGIN HIDDEN TESTS` / `### END HIDDEN TESTS` may stand in such a cell only; students do not see the region.
* An equation is numbered by `\tag{3}` and cited as `eq. (3)`, several as `eqs. (3) and (4)` or `eqs. (3) to (5)`.

The worked notebook is what `nbgrader generate_assignment` reads, and the student copy is what it would write.
"""

import copy
import hashlib
import re

import jupytext
import nbformat

STUB = ("# YOUR CODE HERE", "raise NotImplementedError()")

METADATA = {
    "kernelspec": {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
_MARKER = re.compile(r"###\s*(BEGIN|END) (SOLUTION|HIDDEN TESTS)")
_CHECK = re.compile(r"""\bcheck\(\s*["']([^"']+)["']""")


class ReleaseError(ValueError):
    """A source that no notebook can be made of: one line with file, cell and what to do."""


def read(path):
    """The worked notebook without outputs: stable ids, nbgrader's metadata."""
    try:
        source = jupytext.reads(path.read_text(encoding="utf-8"), fmt="md:myst")
    except Exception as error:
        raise ReleaseError(f"{path}: jupytext cannot read it: {error}".splitlines()[0]) from error
    notebook = nbformat.v4.new_notebook(metadata=copy.deepcopy(METADATA), cells=source.cells)
    exercises = {}
    for i, cell in enumerate(notebook.cells):
        fault = _marker_fault(cell)
        name = cell.metadata.get("name")
        if not fault and "BEGIN SOLUTION" in cell.source:
            if not name:
                fault = "holds a solution and has no name; begin the cell with `:name: EXERCISE`"
            elif name in exercises:
                fault = f"is named {name!r}, as is cell {exercises[name] + 1}; each exercise needs its own name"
            elif not re.fullmatch(r"[A-Za-z0-9_-]{1,50}", name):
                fault = f"is named {name!r}; use up to 50 letters, digits and hyphens"
        if fault:
            raise ReleaseError(f"{where(path, notebook, i)}: {fault}")
        if "BEGIN SOLUTION" in cell.source:
            exercises[name] = i
    checked = {}
    for i, cell in enumerate(notebook.cells):
        called = _CHECK.findall(cell.source) if cell.cell_type == "code" else []
        hidden = "BEGIN HIDDEN TESTS" in cell.source
        fault = ""
        if hidden and not called:
            fault = 'has hidden tests and checks no exercise; put them where `check("EXERCISE", ...)` is called'
        elif len(called) > 1:
            fault = f"checks {len(called)} exercises; give each its own cell"
        elif called and called[0] not in exercises:
            fault = f"checks {called[0]!r}, but no cell of that name holds a solution"
        elif called and called[0] in checked:
            fault = f"checks {called[0]!r}, as does cell {checked[called[0]] + 1}"
        elif called and exercises[called[0]] >= i:
            fault = f"checks {called[0]!r} before it is solved; move it behind cell {exercises[called[0]] + 1}"
        if fault:
            raise ReleaseError(f"{where(path, notebook, i)}: {fault}")
        if called:
            checked[called[0]] = i
            if not hidden:
                cell.source += f'\n### BEGIN HIDDEN TESTS\nassert check.passed("{called[0]}")\n### END HIDDEN TESTS'
    for name, i in exercises.items():
        if name not in checked:
            raise ReleaseError(
                f'{where(path, notebook, i)}: nothing checks it; add a cell that calls `check("{name}", ...)`'
            )
        notebook.cells[i].metadata.nbgrader = _nbgrader(name)
        points = notebook.cells[checked[name]].metadata.pop("points", 1)
        notebook.cells[checked[name]].metadata.nbgrader = _nbgrader(f"{name}-check", points)
    _identify(notebook)
    return notebook


def student_copy(worked):
    notebook = copy.deepcopy(worked)
    for cell in notebook.cells:
        cell.source = _without_regions(cell.source)
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
        if "nbgrader" in cell.metadata:
            cell.metadata.deletable = False
            if cell.metadata.nbgrader.locked:
                cell.metadata.editable = False
            cell.metadata.nbgrader.cell_type = cell.cell_type
            cell.metadata.nbgrader.checksum = _checksum(cell)
    return notebook


def missing_equations(text, citing=None):
    r"""Numbers of equations that are cited but not there.

    Parameters
    ----------
    text : str
        A lesson, whose equations carry `\tag{n}`.
    citing : str, optional
        What cites them as `eq. (n)`; the lesson itself when left out.

    Returns
    -------
    list of str
        In order of citation.
    """
    there = set(re.findall(r"\\tag\{([^{}]+)\}", text))
    # "eq. (3)", "eqs. (6) and (7)", "eqs. (6) to (9)"
    citations = re.findall(
        r"\b[Ee]qs?\. (\([^()]+\)(?:(?:, | and | to )\([^()]+\))*)", text if citing is None else citing
    )
    cited = re.findall(r"\(([^()]+)\)", " ".join(citations))
    return [number for number in dict.fromkeys(cited) if number not in there]


def where(path, notebook, index):
    """Names a cell as its author knows it: file, number, name or first line."""
    cell = notebook.cells[index]
    first_line = next((line for line in cell.source.splitlines() if line.strip()), "")
    return f"{path}, cell {index + 1} ({cell.metadata.get('name') or first_line[:60]})"


def _marker_fault(cell):
    """What is wrong with the regions of a cell, or nothing."""
    begun = None
    for line in cell.source.split("\n"):
        marker = _MARKER.search(line)
        if marker is None:
            continue
        begins, region = marker[1] == "BEGIN", marker[2]
        if cell.cell_type != "code":
            return f"has `{marker[0]}` outside of code"
        if begins and begun:
            return f"has BEGIN {region} within {begun}; end that with `### END {begun}` first"
        if not begins and begun != region:
            return f"has END {region} without `### BEGIN {region}`"
        begun = region if begins else None
    return f"has BEGIN {begun} without `### END {begun}`" if begun else ""


def _nbgrader(grade_id, points=None):
    """nbgrader's cell metadata: of a graded cell when it has points, of a solution otherwise."""
    graded = points is not None
    metadata = {
        "schema_version": 3,
        "grade_id": grade_id,
        "grade": graded,
        "solution": not graded,
        "locked": graded,
        "task": False,
    }
    return nbformat.from_dict({**metadata, "points": points} if graded else metadata)


def _identify(notebook):
    """Ids that stay when other cells change: the exercise's name, else a hash of the content."""
    used = set()
    for cell in notebook.cells:
        name = cell.metadata.get("nbgrader", {}).get("grade_id") or cell.metadata.get("name")
        content = f"{cell.cell_type}\n{cell.source}"
        stem = re.sub(r"[^A-Za-z0-9_-]", "-", name)[:60] if name else hashlib.sha256(content.encode()).hexdigest()[:8]
        cell.id, copies = stem, 1
        while cell.id in used:
            copies += 1
            cell.id = f"{stem}-{copies}"
        used.add(cell.id)


def _without_regions(source):
    """The stub instead of each solution, nothing instead of hidden tests."""
    lines, inside = [], False
    for line in source.split("\n"):
        marker = _MARKER.search(line)
        if marker is None:
            if not inside:
                lines.append(line)
            continue
        inside = marker[1] == "BEGIN"
        if inside and marker[2] == "SOLUTION":
            indent = line[: len(line) - len(line.lstrip())]
            lines += [indent + stub for stub in STUB]
    return "\n".join(lines)


def _checksum(cell):
    """MD5 of what nbgrader does not want changed, in its order."""
    metadata = cell.metadata.nbgrader
    parts = [cell.source, cell.cell_type, metadata.grade, metadata.solution, metadata.locked, metadata.grade_id]
    if metadata.grade:
        parts.append(float(metadata.points))
    return hashlib.md5("".join(map(str, parts)).encode()).hexdigest()
