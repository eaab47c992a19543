"""The sample class of the vacuum robots: complete, self-contained, each specimen another program.

That each fault costs points is for the grader to show; here the specimens only have to be what they claim to be.
"""

import ast
import json
from pathlib import Path

import numpy as np
import pytest

from course_lib.filters import Particles, Step
from course_lib.recording import replay
from course_lib.vacuum.constants import Constants, Hidden
from course_lib.vacuum.world import World

CLASS = Path(__file__).parent / "submissions" / "vacuum"
PROGRAMS = sorted(CLASS.glob("*.py"))
NOTEBOOK = CLASS / "good_notebook.ipynb"
MAY_IMPORT = {"math", "numpy", "course_lib.angles", "course_lib.filters"}
NO_PARTICLES = {"heading_unwound_in_a_loop", "zero_weights_crash", "returns_nan", "wrong_shape"}


def imports(tree):
    """Modules a program imports, wherever it does."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


def entry_points(tree):
    """Parameters of every function called Estimator at the top level."""
    return [
        [argument.arg for argument in node.args.args]
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name == "Estimator"
    ]


def notebook_source():
    """Code cells of the notebook without its magics."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    lines = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code").splitlines()
    return "\n".join(line for line in lines if not line.startswith("%"))


def estimator(path):
    namespace = {}
    exec(compile(path.read_text(encoding="utf-8"), path.name, "exec"), namespace)
    return namespace["Estimator"]


def states(posterior):
    if isinstance(posterior, Step):
        posterior = posterior.posterior
    return posterior.states if isinstance(posterior, Particles) else posterior


@pytest.fixture(scope="module")
def run():
    return World(Constants(), Hidden(steps=20)).simulate(np.random.default_rng(3))


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_specimen_is_a_self_contained_program(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree), "the first line says what the specimen is"
    assert path.read_text(encoding="utf-8").splitlines()[0].endswith('."""')
    assert entry_points(tree) == [["previous", "observation", "control", "constants", "rng"]]
    assert set(imports(tree)) <= MAY_IMPORT


def test_specimens_are_different_programs():
    def without_docstring(path):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        return ast.dump(ast.Module(tree.body[1:], []))

    programs = {without_docstring(path): path.stem for path in PROGRAMS}
    assert len(programs) == len(PROGRAMS)


def test_notebook_holds_the_program_of_good_plain():
    # Same functions in another order: it has to be graded like good_plain.
    def functions(source):
        return {node.name: ast.dump(node) for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}

    assert functions(notebook_source()) == functions((CLASS / "good_plain.py").read_text(encoding="utf-8"))
    assert set(imports(ast.parse(notebook_source()))) <= MAY_IMPORT | {"matplotlib.pyplot"}


@pytest.mark.parametrize("path", [p for p in PROGRAMS if p.stem not in NO_PARTICLES], ids=lambda path: path.stem)
def test_specimen_returns_finite_particles(path, run):
    for posterior in replay(estimator(path), run, Constants(), np.random.default_rng(4)):
        cloud = states(posterior)
        assert cloud.ndim == 2 and cloud.shape[1] == 6 and np.all(np.isfinite(cloud))


def test_faulty_output_is_what_the_name_says(run):
    rng = np.random.default_rng(4)
    shapes = {states(p).shape for p in replay(estimator(CLASS / "wrong_shape.py"), run, Constants(), rng)}
    assert shapes == {(6, 2000)}
    with np.errstate(invalid="ignore"):
        *_, last = replay(estimator(CLASS / "returns_nan.py"), run, Constants(), rng)
    assert np.isnan(last).any()


def test_zero_weights_crash_crashes_on_a_reading_nobody_explains():
    crashing = estimator(CLASS / "zero_weights_crash.py")
    rng = np.random.default_rng(4)
    prior = crashing(None, None, None, Constants(), rng)
    with np.errstate(invalid="ignore"), pytest.raises(ValueError, match="weights must be finite"):
        crashing(prior, np.array([100.0, np.inf, np.inf, np.inf]), np.array([1.0, 1.0]), Constants(), rng)
