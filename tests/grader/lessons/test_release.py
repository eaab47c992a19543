"""Of one source come two notebooks, byte for byte the same at every release; drift and faults are named in a line."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import nbformat
import pytest

import grader.lessons.release
from grader.lessons.release import ReleaseError, missing_equations, release, stale

ROOT = Path(__file__).parents[3]

HEADER = """---
jupytext:
  text_representation:
    extension: .md
    format_name: myst
kernelspec:
  display_name: Python 3 (ipykernel)
  language: python
  name: python3
---

"""

LESSON = (
    HEADER
    + r"""# Doubling

$$y = 2x \tag{1}$$

```{code-cell} ipython3
import sys, uuid, warnings
from IPython.display import HTML
from ipywidgets import IntSlider

class Check:
    def __call__(self, name, function):
        return function

    def passed(self, name):
        return True

check = Check()
```

```{code-cell} ipython3
:name: double
:tags: [exercise]

def double(x):
    # eq. (1)
    if x:
        ### BEGIN SOLUTION
        y = 2 * x
        return y
        ### END SOLUTION
    return 0
```

```{code-cell} ipython3
:points: 2
double = check("double", double)
```

Some prose.

+++

Some more.

```{code-cell} ipython3
number = uuid.uuid4().hex
print(object(), {"a", "b", "c"}, sys.prefix)
warnings.warn("mind the gap")
display(IntSlider())
HTML(f"<div id='anim{number}'></div><script>show('{number}')</script>")
```

```{code-cell} ipython3
print("the same")
```

```{code-cell} ipython3
print("the same")
```
"""
)


def course(folder, text=LESSON):
    (folder / "solutions").mkdir()
    (folder / "solutions" / "01_doubling.md").write_text(text)
    return folder


def products(root):
    return [(root / folder / "01_doubling.ipynb") for folder in ("solutions", "notebooks")]


@pytest.fixture(scope="module")
def released(tmp_path_factory):
    """A course released twice, with what the first release wrote."""
    root = course(tmp_path_factory.mktemp("course"))
    release(root)
    first = [path.read_bytes() for path in products(root)]
    release(root)
    return root, first


@pytest.fixture
def copied(released, tmp_path):
    """A released course to spoil."""
    return shutil.copytree(released[0], tmp_path / "course")


def load(path):
    return nbformat.read(path, as_version=4)


def test_two_releases_are_byte_identical(released):
    root, first = released
    assert [path.read_bytes() for path in products(root)] == first
    assert stale(root) == []
    assert sorted(path.name for path in root.rglob("*") if path.is_file()) == ["01_doubling.ipynb"] * 2 + [
        "01_doubling.md"
    ]


def test_outputs_hold_nothing_of_the_machine_or_the_moment(released):
    worked = load(products(released[0])[0])
    assert [cell.execution_count for cell in worked.cells if cell.cell_type == "code"] == [1, 2, 3, 4, 5, 6]
    stdout, stderr, page = worked.cells[6].outputs
    assert re.fullmatch(r"<object object at 0x0> \{.*\} PYTHON\n", stdout.text)
    assert stderr.text.startswith("cell.py:3: UserWarning: mind the gap")
    number = f"{1:032x}"
    assert page.data["text/html"] == f"<div id='anim{number}'></div><script>show('{number}')</script>"
    # Nothing of the widget: neither its output nor, in the metadata, its model.
    assert worked.metadata == grader.lessons.release.METADATA
    assert "jupytext" not in json.dumps(worked)


def test_ids_come_from_names_and_content(released):
    worked, student = (load(path) for path in products(released[0]))
    ids = [cell.id for cell in worked.cells]
    assert ids == [cell.id for cell in student.cells]
    assert ids[2:4] == ["double", "double-check"]
    assert ids[8] == f"{ids[7]}-2"


def test_a_cell_keeps_its_id_when_others_come_and_go(released, tmp_path):
    root = course(tmp_path, LESSON.replace("# Doubling", "# Doubling\n\nNew.\n\n+++\n\nNewer."))
    release(root, execute=False)
    before, after = (
        {cell.source: cell.id for cell in load(products(r)[1]).cells if cell.cell_type == "code"}
        for r in (released[0], root)
    )
    assert before == after


def test_the_student_copy_has_stubs_and_no_outputs(released):
    worked, student = (load(path) for path in products(released[0]))
    assert student.cells[2].source == (
        "def double(x):\n    # eq. (1)\n    if x:\n"
        "        # YOUR CODE HERE\n        raise NotImplementedError()\n    return 0"
    )
    assert student.cells[3].source == 'double = check("double", double)'
    assert worked.cells[3].source == (
        'double = check("double", double)\n### BEGIN HIDDEN TESTS\nassert check.passed("double")\n### END HIDDEN TESTS'
    )
    for cell in student.cells:
        if cell.cell_type == "code":
            assert cell.outputs == [] and cell.execution_count is None
            assert "SOLUTION" not in cell.source and "HIDDEN" not in cell.source


def test_nbgraders_metadata(released):
    """Checked against nbgrader 0.9.6, whose generate_assignment makes the same student copy."""
    worked, student = (load(path) for path in products(released[0]))
    solution = {
        "schema_version": 3,
        "grade_id": "double",
        "grade": False,
        "solution": True,
        "locked": False,
        "task": False,
    }
    test = {**solution, "grade_id": "double-check", "grade": True, "solution": False, "locked": True, "points": 2}
    assert worked.cells[2].metadata.nbgrader == solution
    assert worked.cells[3].metadata.nbgrader == test
    assert [i for i, cell in enumerate(worked.cells) if "nbgrader" in cell.metadata] == [2, 3]
    text = student.cells[2].source + "codeFalseTrueFalsedouble"
    checksum = hashlib.md5(text.encode()).hexdigest()
    assert student.cells[2].metadata.nbgrader == {**solution, "cell_type": "code", "checksum": checksum}
    text = student.cells[3].source + "codeTrueFalseTruedouble-check2.0"
    checksum = hashlib.md5(text.encode()).hexdigest()
    assert student.cells[3].metadata.nbgrader == {**test, "cell_type": "code", "checksum": checksum}
    assert (student.cells[3].metadata.editable, student.cells[3].metadata.deletable) == (False, False)


def spoil(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_drift_is_seen_in_every_product(copied):
    worked, student = products(copied)
    spoil(copied / "solutions" / "01_doubling.md", "Some prose.", "Other prose.")
    assert stale(copied) == [
        "solutions/01_doubling.ipynb: differs from its source in cell 5; run `grader release`",
        "notebooks/01_doubling.ipynb: differs from its source; run `grader release`",
    ]
    release(copied, execute=False)
    assert stale(copied) == []
    student.write_text(student.read_text() + "\n")
    assert stale(copied) == ["notebooks/01_doubling.ipynb: differs from its source; run `grader release`"]
    student.unlink()
    worked.write_text("{}")
    shutil.copy(copied / "solutions" / "01_doubling.md", copied / "notebooks" / "99_orphan.ipynb")
    assert stale(copied) == [
        "solutions/01_doubling.ipynb: is no notebook; run `grader release`",
        "notebooks/01_doubling.ipynb: is missing; run `grader release`",
        "notebooks/99_orphan.ipynb: has no source solutions/99_orphan.md; write that, or delete this",
    ]


def test_outputs_are_not_compared_but_must_be_there(copied):
    worked, _ = products(copied)
    spoil(worked, '"the same\\n"', '"another\\n"')
    assert stale(copied) == []
    spoil(worked, '"execution_count": 4', '"execution_count": null')
    assert stale(copied) == ["solutions/01_doubling.ipynb: was not executed in cell 7; run `grader release`"]


def test_without_execution_unchanged_cells_keep_their_outputs(copied):
    spoil(copied / "solutions" / "01_doubling.md", 'print("the same")\n```\n\n', 'print("changed")\n```\n\n')
    release(copied, execute=False)
    cells = load(products(copied)[0]).cells
    assert [len(cell.get("outputs", [])) for cell in cells] == [0, 0, 0, 0, 0, 0, 3, 0, 1]
    assert stale(copied) == ["solutions/01_doubling.ipynb: was not executed in cell 8; run `grader release`"]


SOLUTION = "### BEGIN SOLUTION\n        y = 2 * x\n        return y\n        ### END SOLUTION"
CHECK_CELL = '```{code-cell} ipython3\n:points: 2\ndouble = check("double", double)\n```\n'


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("### END SOLUTION", "", "cell 3 (double): has BEGIN SOLUTION without `### END SOLUTION`"),
        ("### BEGIN SOLUTION", "", "cell 3 (double): has END SOLUTION without `### BEGIN SOLUTION`"),
        ("y = 2 * x", "### BEGIN SOLUTION", "cell 3 (double): has BEGIN SOLUTION within SOLUTION"),
        ("Some prose.", "### BEGIN SOLUTION", "cell 5 (### BEGIN SOLUTION): has `### BEGIN SOLUTION` outside of code"),
        (":name: double\n", "", "cell 3 (def double(x):): holds a solution and has no name"),
        (":name: double\n", ":name: dou ble\n", "cell 3 (dou ble): is named 'dou ble'; use up to 50 letters"),
        (
            CHECK_CELL,
            f"```{{code-cell}} ipython3\n:name: double\nif x:\n        {SOLUTION}\n```\n",
            "cell 4 (double): is named 'double', as is cell 3",
        ),
        (CHECK_CELL, "", 'cell 3 (double): nothing checks it; add a cell that calls `check("double", ...)`'),
        (CHECK_CELL, CHECK_CELL + CHECK_CELL, "cell 5 (double = check"),
        ('check("double"', 'check("treble"', "checks 'treble', but no cell of that name holds a solution"),
        (
            "number = uuid",
            "### BEGIN HIDDEN TESTS\n### END HIDDEN TESTS\nn = uuid",
            "has hidden tests and checks no exercise",
        ),
    ],
)
def test_a_malformed_source_is_refused_in_one_line(tmp_path, old, new, words):
    assert old in LESSON
    root = course(tmp_path, LESSON.replace(old, new))
    for action in (release, stale):
        with pytest.raises(ReleaseError) as raised:
            action(root)
        message = str(raised.value)
        assert "01_doubling.md, cell " in message and words in message
        assert "\n" not in message
    assert not any(path.exists() for path in products(root))


def test_a_folder_without_lessons_is_refused(tmp_path):
    with pytest.raises(ReleaseError, match="holds no lesson"):
        release(tmp_path)


def test_a_cell_that_raises_is_named_and_nothing_is_written(copied):
    before = [path.read_bytes() for path in products(copied)]
    spoil(copied / "solutions" / "01_doubling.md", "number = uuid.uuid4().hex", "number = 1 / 0")
    begun = []
    with pytest.raises(ReleaseError) as raised:
        release(copied, progress=lambda name, cell, cells: begun.append((name, cell, cells)))
    assert str(raised.value).endswith("01_doubling.md, cell 7 (number = 1 / 0): ZeroDivisionError: division by zero")
    assert [path.read_bytes() for path in products(copied)] == before
    assert begun[-1] == ("01_doubling", 7, 9)


def test_a_notebook_that_is_too_large_is_refused(copied, monkeypatch):
    before = [path.read_bytes() for path in products(copied)]
    monkeypatch.setattr(grader.lessons.release, "LARGEST", 1000)
    with pytest.raises(
        ReleaseError, match=r"cell \d+ \(.*\): the worked notebook has 0.0 MB, most of it from this cell"
    ):
        release(copied, execute=False)
    assert [path.read_bytes() for path in products(copied)] == before


def test_a_cited_equation_must_exist():
    text = r"$$a \tag{1}$$ $$b \tag{2a}$$ by eq. (1) and eq. (2a), # eq. (4); see (7) and eq. (4)"
    assert missing_equations(text) == ["4"]
    assert missing_equations(text + " eqs. (1) and (5), eqs. (6) to (8)") == ["4", "5", "6", "8"]
    assert missing_equations(text, citing="# eq. (9)\n# eq. (1)") == ["9"]


LESSONS = sorted((ROOT / "solutions").glob("*.md"))


@pytest.mark.parametrize("lesson", LESSONS, ids=lambda path: path.stem)
def test_the_courses_code_cites_equations_that_exist(lesson):
    text = lesson.read_text()
    assert missing_equations(text) == []
    for module in sorted((ROOT / "course_lib").rglob("*.py")):
        code = module.read_text()
        if f"solutions/{lesson.name}" in code:
            assert missing_equations(text, citing=code) == [], module.relative_to(ROOT)


@pytest.mark.parametrize("lesson", LESSONS, ids=lambda path: path.stem)
def test_each_equation_is_numbered_once(lesson):
    tags = re.findall(r"\\tag\{([^{}]+)\}", lesson.read_text())
    assert len(tags) == len(set(tags))


def test_the_courses_notebooks_are_up_to_date():
    assert stale(ROOT) == []
