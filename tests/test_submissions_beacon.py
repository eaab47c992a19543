"""The sample classes of the beacon unit: complete, self-contained, each specimen another program.

That each fault costs points is for the grader to show; here the specimens only have to be what they claim to be.
"""

import ast
from pathlib import Path

import numpy as np
import pytest

from course_lib.beacon.constants import Constants, Hidden
from course_lib.beacon.planning.obstacles import Scene
from course_lib.beacon.quadrotor import fly_to
from course_lib.beacon.world import World
from course_lib.filters import Gaussian, Step, equally_weighted
from course_lib.recording import replay
from grader.assignments import assignments

FOLDER = Path(__file__).parent / "submissions"
CLASSES = ("beacon-ekf", "beacon-pf", "beacon-rrt")
PROGRAMS = [path for name in CLASSES for path in sorted((FOLDER / name).glob("*.py"))]
LIBRARIES = {"math", "numpy", "scipy.linalg", "filterpy.kalman"}

#: What breaks, in the first steps of any run.
BREAKS = {
    "covariance_multiplied_backwards",
    "joseph_minus",
    "returns_none",
    "missing_as_reading",
    "gain_without_its_denominator",
    "jacobian_sign_far_corners",
    "wrong_shape",
}

every_program = pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: f"{path.parent.name}/{path.stem}")
of_estimators = pytest.mark.parametrize(
    "path",
    [path for path in PROGRAMS if path.parent.name != "beacon-rrt" and path.stem not in BREAKS],
    ids=lambda path: f"{path.parent.name}/{path.stem}",
)


def imports(tree):
    """Modules a program imports, wherever it does."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            yield from names & {"course_lib.beacon.quadrotor"} or {"." * node.level + (node.module or "")}


def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def entry_point(path):
    namespace = {}
    exec(compile(path.read_text(encoding="utf-8"), path.name, "exec"), namespace)
    return namespace[assignments()[path.parent.name].entry_point]


@pytest.fixture(scope="module")
def run():
    return World(Constants(), Hidden(steps=6)).simulate(np.random.default_rng(3))


@every_program
def test_specimen_is_a_self_contained_program(path):
    tree, assignment = parsed(path), assignments()[path.parent.name]
    assert ast.get_docstring(tree), "the first line says what the specimen is"
    assert path.read_text(encoding="utf-8").splitlines()[0].endswith('."""')
    defined = {node.name: [a.arg for a in node.args.args] for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert defined[assignment.entry_point] == list(assignment.parameters)
    shared = {"course_lib.angles", "course_lib.filters", "course_lib.beacon.constants", "course_lib.beacon.quadrotor"}
    assert set(imports(tree)) <= LIBRARIES | shared | set(assignment.given)
    assert not set(imports(tree)) & set(assignment.withheld)


@pytest.mark.parametrize("name", CLASSES)
def test_specimens_are_different_programs(name):
    def without_docstring(path):
        return ast.dump(ast.Module(parsed(path).body[1:], []))

    paths = [path for path in PROGRAMS if path.parent.name == name]
    assert len({without_docstring(path) for path in paths}) == len(paths)


@of_estimators
def test_specimen_returns_a_finite_posterior(path, run):
    with np.errstate(invalid="ignore"):
        for posterior in replay(entry_point(path), run, Constants(), np.random.default_rng(4)):
            posterior = posterior.posterior if isinstance(posterior, Step) else posterior
            if isinstance(posterior, np.ndarray):
                posterior = equally_weighted(posterior)
            first, second = posterior
            assert np.all(np.isfinite(first)) and first.shape[-1] == 12
            assert second.shape == ((12, 12) if isinstance(posterior, Gaussian) else (len(first),))


@pytest.mark.parametrize(
    "path", [path for path in PROGRAMS if path.parent.name == "beacon-rrt"], ids=lambda path: path.stem
)
def test_specimen_returns_an_action(path):
    scene, rng = Scene(start=(-4.0, 0.0, 2.0, 0.0)), np.random.default_rng(5)
    action = entry_point(path)(None, None, scene.start_state, scene, rng)
    action = action.posterior if isinstance(action, Step) else action
    assert np.shape(action) == ((3,) if path.stem == "accelerations_for_thrusts" else (4,))
    assert np.all(np.isfinite(action))


def test_the_scene_without_obstacles_is_flown_by_the_controller_alone():
    # What straight_to_the_goal is given points for.
    scene = Scene(start=(-4.0, 0.0, 2.0, 0.0))
    straight = entry_point(FOLDER / "beacon-rrt/straight_to_the_goal.py")
    assert np.array_equal(
        straight(None, None, scene.start_state, scene, None), fly_to(scene.start_state, [*scene.goal, 0.0], scene)
    )


@pytest.mark.parametrize("column", [0, 4])
def test_a_missing_reading_breaks_what_takes_it_for_one(column):
    for folder in ("beacon-ekf", "beacon-pf"):
        estimator, rng = entry_point(FOLDER / folder / "missing_as_reading.py"), np.random.default_rng(4)
        prior = estimator(None, None, None, Constants(), rng)
        observation = np.full(11, 1.0)
        observation[column] = np.inf
        with np.errstate(invalid="ignore"):
            posterior = estimator(prior, observation, np.full(4, 2.4), Constants(), rng)
        assert any(np.isnan(part).any() for part in posterior)


def test_beneath_a_beacon_there_is_no_root():
    path = FOLDER / "beacon-ekf/pseudo_with_unguarded_root.py"
    constants, observation = Constants(start=(4.9, 4.9, 3.4, 0.0)), np.full(11, np.inf)
    # 1.3 m away, but 1.4 m below: noise of 10 cm does that.
    observation[[0, 4, 8]] = 1.3, 0.7, 3.4
    estimator = entry_point(path)
    with np.errstate(invalid="ignore"):
        posterior = estimator(
            estimator(None, None, None, constants, None), observation, np.full(4, 2.4), constants, None
        )
    assert np.isnan(posterior.mean).any()
