"""Two other autograders on a five-point task, in an environment of their own that is made for this and then removed."""

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console

#: What is installed there; never a dependency of this project.
VERSIONS = ("nbgrader==0.9.6", "otter-grader==7.0.0")
SUBMISSIONS = 3

_ANSWER = "def double(x):\n    return 2 * x"
_CHECKS = [f"double({i}) == {2 * i}" for i in range(5)]


class Unavailable(Exception):
    """An autograder cannot be run here."""


def measured(console: Console):
    """CPU seconds per submission, of all processes, as (name, seconds); empty when they cannot be installed.

    An autograder that takes a class at once is charged for each further submission, one that is started for each
    submission for its start, too.
    """
    with tempfile.TemporaryDirectory(prefix="autograders-") as folder:
        folder = Path(folder)
        try:
            with console.status(f"installing {' and '.join(VERSIONS)} in {folder}"):
                _run([sys.executable, "-m", "venv", folder / "venv"], folder)
                pip = [folder / "venv/bin/python", "-m", "pip", "install", "--disable-pip-version-check", "--quiet"]
                _run([*pip, *VERSIONS], folder)
            with console.status("grading with them"):
                return [(VERSIONS[0], _nbgrader(folder)), (VERSIONS[1], _otter(folder))]
        except (Unavailable, OSError) as error:
            console.print(f"overhead: the other autograders are left out: {error}", markup=False)
            return []


def _nbgrader(folder):
    course = folder / "course"
    (course / "source/task").mkdir(parents=True)
    (course / "nbgrader_config.py").write_text("c = get_config()\n")
    cells = [_cell(f"### BEGIN SOLUTION\n{_ANSWER}\n### END SOLUTION", _nbgrader_cell("answer", solution=True))]
    cells += [_cell(f"assert {check}", _nbgrader_cell(f"t{i}", points=1)) for i, check in enumerate(_CHECKS)]
    (course / "source/task/task.ipynb").write_text(_notebook(cells))
    command = [folder / "venv/bin/python", "-m", "nbgrader"]
    _run([*command, "generate_assignment", "task"], course)
    released = json.loads((course / "release/task/task.ipynb").read_text())
    released["cells"][0]["source"] = _ANSWER
    for student in range(1 + SUBMISSIONS):
        place = course / f"submitted/student{student}/task"
        place.mkdir(parents=True)
        (place / "task.ipynb").write_text(json.dumps(released))
    _run([*command, "autograde", "task", "--student=student0"], course)
    # Once more with nothing to do but start: what is graded already is passed over.
    start = _run([*command, "autograde", "task", "--student=student0"], course)
    return (_run([*command, "autograde", "task"], course) - start) / SUBMISSIONS


def _otter(folder):
    place = folder / "otter"
    (place / "tests").mkdir(parents=True)
    for i, check in enumerate(_CHECKS):
        case = {"code": f">>> {check}\nTrue", "hidden": False, "locked": False}
        suite = {"cases": [case], "scored": True, "setup": "", "teardown": "", "type": "doctest"}
        test = {"name": f"q{i}", "points": 1, "suites": [suite]}
        (place / f"tests/q{i}.py").write_text(f"OK_FORMAT = True\ntest = {test!r}\n")
    cells = ["import otter\ngrader = otter.Notebook()", _ANSWER, *(f"grader.check('q{i}')" for i in range(5))]
    (place / "task.ipynb").write_text(_notebook([_cell(source, {}) for source in cells]))
    command = [folder / "venv/bin/python", "-m", "otter"]
    _run([*command, "generate"], place)
    run = [*command, "run", "-a", "autograder.zip", "-o", ".", "task.ipynb"]
    seconds = sum(_run(run, place) for _ in range(SUBMISSIONS)) / SUBMISSIONS
    scores = [test["score"] for test in json.loads((place / "results.json").read_text())["tests"] if "score" in test]
    if sum(scores) != 5.0:
        raise Unavailable(f"{VERSIONS[1]} gave {scores} where all is right")
    return seconds


def _run(command, folder):
    """Run a command there; the CPU seconds it and all it started took."""
    environment = {**os.environ, "PATH": f"{Path(command[0]).parent}{os.pathsep}{os.environ.get('PATH', '')}"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [*map(str, command)],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if done.returncode:
        last = (done.stdout.strip().splitlines() or [""])[-1]
        raise Unavailable(f"{' '.join(map(str, command[1:4]))} failed: {last}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _notebook(cells):
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    for number, cell in enumerate(cells):
        cell["id"] = f"cell{number}"
    return json.dumps({"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5})


def _cell(source, metadata):
    return {"cell_type": "code", "source": source, "metadata": metadata, "execution_count": None, "outputs": []}


def _nbgrader_cell(name, solution=False, points=None):
    words = {"schema_version": 3, "grade_id": name, "solution": solution, "locked": not solution, "task": False}
    return {"nbgrader": {**words, "grade": points is not None, **({"points": points} if points else {})}}
