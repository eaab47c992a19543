"""The sample classes of the DR20 unit: complete, self-contained, each specimen another program.

That each fault costs points is for the grader to show; here the specimens only have to be what they claim to be.
"""

import ast
from pathlib import Path

import pytest

from grader.assignments import assignments

FOLDER = Path(__file__).parent / "submissions"
CLASSES = ("dr20-local", "dr20-global", "dr20-kidnapped")
PROGRAMS = [path for name in CLASSES for path in sorted((FOLDER / name).glob("*.py"))]
MAY_IMPORT = {"numpy", "course_lib.angles", "course_lib.filters", "course_lib.geometry.polygons"}


def imports(tree):
    """Modules a program imports, wherever it does."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_specimen_is_a_self_contained_program(path):
    tree, assignment = parsed(path), assignments()[path.parent.name]
    assert ast.get_docstring(tree), "the first line says what the specimen is"
    assert path.read_text(encoding="utf-8").splitlines()[0].endswith('."""')
    defined = {node.name: [a.arg for a in node.args.args] for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert defined[assignment.entry_point] == list(assignment.parameters)
    assert set(imports(tree)) <= MAY_IMPORT and not set(imports(tree)) & set(assignment.withheld)


@pytest.mark.parametrize("name", CLASSES)
def test_specimens_are_different_programs(name):
    paths = [path for path in PROGRAMS if path.parent.name == name]
    assert len({ast.dump(ast.Module(parsed(path).body[1:], [])) for path in paths}) == len(paths)
