"""The lessons: both notebooks run, every figure has words, prose and code agree."""

import ast
import math
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import nbformat
import pytest

from grader.assignments import assignments
from grader.intake import notebook as notebook_intake
from grader.lessons.release import missing_equations

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "solutions").glob("*.md"))
PRODUCTS = [ROOT / folder / f"{source.stem}.ipynb" for source in SOURCES for folder in ("solutions", "notebooks")]

#: Words a minute, as the lessons' tables of reading times say.
READING_SPEED = 130

#: Lessons, and the assignments for which one hands in their notebooks.
HANDED_IN = [
    ("01_beacons", "beacon-ekf"),
    ("01_beacons", "beacon-pf"),
    ("01_beacons", "beacon-rrt"),
    ("02_dr20_localization", "dr20-local"),
    ("02_dr20_localization", "dr20-global"),
    ("02_dr20_localization", "dr20-kidnapped"),
    ("03_vacuum_robots", "vacuum"),
]

every_lesson = pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
every_product = pytest.mark.parametrize("product", PRODUCTS, ids=lambda path: f"{path.parent.name}/{path.stem}")


class _Images(HTMLParser):
    """Collects the attributes of every image."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.found.append(dict(attributes))


def _worked(source):
    return nbformat.read(source.with_suffix(".ipynb"), as_version=4)


def _sections(notebook):
    """Prose of each section, by its title: all headings of the first two levels begin one."""
    sections, title = {}, None
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            for block in filter(None, re.split(r"^(?=##? )", cell.source, flags=re.MULTILINE)):
                heading = re.match(r"##? (.*)\n?", block)
                if heading:
                    title = heading[1]
                sections[title] = sections.get(title, "") + block
    return sections


@every_product
def test_runs_from_top_to_bottom(product):
    # In its own process: a kernel, and figures that must not need a display.
    options = "--nbval-lax --nbval-current-env --nbval-cell-timeout=120 -p no:cacheprovider -p no:xdist".split()
    command = [sys.executable, "-m", "pytest", *options, product]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout[-5000:] + result.stderr[-2000:]


def test_there_is_a_lesson():
    assert SOURCES


@every_lesson
def test_equations_cited_exist(source):
    assert missing_equations(source.read_text(encoding="utf-8")) == []


@every_lesson
def test_equations_are_numbered_in_order(source):
    numbers = re.findall(r"\\tag\{(\d+)\}", source.read_text(encoding="utf-8"))
    assert numbers == [str(i + 1) for i in range(len(numbers))]


@every_lesson
def test_every_figure_has_alt_text(source):
    parser, figures = _Images(), 0
    for cell in _worked(source).cells:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            assert not [kind for kind in data if kind.startswith("image/")], f"a figure without alt text: {cell.source}"
            parser.feed(data.get("text/html", ""))
        figures += "plotting.figure(" in cell.source
    assert figures <= len(parser.found) and parser.found
    assert all(len(image.get("alt", "").split()) >= 8 for image in parser.found)


@every_lesson
def test_no_cell_warns(source):
    errors = [o.text for c in _worked(source).cells for o in c.get("outputs", []) if o.get("name") == "stderr"]
    assert errors == []


@every_lesson
def test_prose_is_plain_markdown(source):
    # JupyterLab shows MyST's directives and roles as they are typed.
    for cell in _worked(source).cells:
        if cell.cell_type == "markdown":
            assert not re.search(r"^(:::|```\{)|\{\w+\}`", cell.source, flags=re.MULTILINE), cell.source


@every_lesson
def test_reading_times_follow_from_the_words(source):
    sections = _sections(_worked(source))
    table = re.findall(r"^\| ([^|]+?) \| (\d+) \| (\d+) \|$", source.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert [title for title, _, _ in table] == list(sections)[1:]
    counted = {title: math.ceil(len(sections[title].split()) / READING_SPEED) for title, _, _ in table}
    assert {title: int(minutes) for title, minutes, _ in table} == counted


@every_product
def test_is_small(product):
    assert product.stat().st_size < 3_000_000


@every_lesson
def test_student_copy_holds_no_solution(source):
    student = nbformat.read(ROOT / "notebooks" / f"{source.stem}.ipynb", as_version=4)
    assert not any("BEGIN SOLUTION" in cell.source or cell.get("outputs") for cell in student.cells)
    assert any("raise NotImplementedError()" in cell.source for cell in student.cells)


@pytest.mark.parametrize(("lesson", "name"), HANDED_IN, ids=[name for _, name in HANDED_IN])
def test_submission_is_the_program_and_nothing_else(lesson, name):
    assignment = assignments()[name]
    notebook = (ROOT / "solutions" / f"{lesson}.ipynb").read_bytes()
    tree = ast.parse(notebook_intake.extract(notebook, assignment.entry_point, 1_000_000))
    imports = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    # Numbers with a name may come along, pictures and runs may not.
    numbers = [node for node in tree.body if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)]
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert len(imports) + len(numbers) + len(functions) == len(tree.body)
    names = {
        f"{node.module}.{alias.name}" for node in imports if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert not [name for name in names if name.startswith(assignment.withheld)]


def test_every_lesson_is_handed_in():
    assert {lesson for lesson, _ in HANDED_IN} == {source.stem for source in SOURCES}
