"""A planner's world to test the grader with: a point of mass 1 kg on a plane, one box between it and its goal.

It is imported in fork servers, too: `serving` puts this repository on their path.
"""

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from grader.assignment import Criterion, PlannerAssignment, Uniform, Variant
from grader.sandbox import server

ROOT = Path(__file__).parents[2]
HALF = 0.05


@dataclass(frozen=True)
class Scene:
    """Told: a step's length (s), the largest force along an axis (N), boxes, and the goal [x, y, radius] (m)."""

    Ts: float = 0.1
    force: float = 2.0
    obstacles: tuple[tuple[float, float, float, float], ...] = ((2.0, 1.0, 3.0, 3.0),)
    goal: tuple[float, float, float] = (4.5, 2.0, 0.3)


@dataclass(frozen=True)
class Hidden:
    """Not told: how strong gusts are (N), and how many steps there are."""

    gust: float = 0.1
    steps: int = 120


class World:
    """Double integrator with gusts; the box is as wide as the scene says, its place along y is drawn."""

    def __init__(self, scene, hidden, rng):
        shift = rng.uniform(-0.3, 0.3)
        boxes = tuple((x0, y0 + shift, x1, y1 + shift) for x0, y0, x1, y1 in scene.obstacles)
        self.constants = Scene(scene.Ts, scene.force, boxes, scene.goal)
        self.state, self.step, self.effort = np.array([0.5, 2.0, 0.0, 0.0]), 0, 0.0
        self.status, self.message, self.over = "", "", False
        self._hidden, self._rng, self.log = hidden, rng, []

    def inputs(self):
        return None, self.state.copy()

    def act(self, action):
        scene = self.constants
        gust = self._hidden.gust * self._rng.standard_normal(2)
        self.log.append(gust)
        force = np.clip(action, -scene.force, scene.force)
        self.state[2:] += scene.Ts * (force + gust)
        self.state[:2] += scene.Ts * self.state[2:]
        self.step += 1
        self.effort += scene.Ts * float(force @ force) + 1e-9
        x, y = self.state[:2]
        when = f"step {self.step} ({self.step * scene.Ts:.2f} s)"
        if any(x0 < x < x1 and y0 < y < y1 for x0, y0, x1, y1 in scene.obstacles):
            self._end("collided", f"{when}: ran into obstacle 1 at ({x:.2f}, {y:.2f}) m")
        elif self.distance() < scene.goal[2]:
            self._end("ok", "")
        elif self.step == self._hidden.steps:
            self._end("not arrived", f"{when}: time is up, {self.distance():.2f} m from the goal")

    def _end(self, status, message):
        self.over, self.status, self.message = True, status, message

    def metrics(self):
        return {"time": self.step * self.constants.Ts, "effort": self.effort}

    def position(self):
        return self.state[:2]

    def distance(self):
        return float(np.hypot(*(self.state[:2] - self.constants.goal[:2])))


def Planner(previous, belief, state, constants, rng):
    """Steer for the waypoints around the box, and damp."""
    (x0, y0, x1, y1), goal = constants.obstacles[0], np.array(constants.goal[:2])
    above = y1 - state[1] < state[1] - y0
    side = y1 + 0.5 if above else y0 - 0.5
    target = goal
    if state[0] < x0 - 0.2 and not (state[1] > y1 + 0.2 or state[1] < y0 - 0.2):
        target = np.array([x0 - 0.6, side])
    elif state[0] < x1 + 0.2:
        target = np.array([x1 + 0.5, side])
    return 3.0 * (target - state[:2]) - 2.5 * state[2:]


def picture(world):
    scene = world.constants
    return {
        "room": [0.0, 0.0, 5.0, 4.0],
        "sensors": [],
        "obstacles": [list(box) for box in scene.obstacles],
        "goal": list(scene.goal),
        "unit": "m",
    }


CRITERIA = (Criterion("time", 40.0, 1.3, 2.5), Criterion("effort", 10.0, 2.0, 5.0))
TOY = PlannerAssignment(
    name="toy",
    title="A point around a box",
    entry_point="Planner",
    reference="tests.grader.toy:Planner",
    simulate=lambda variant, rng: World(variant.constants, variant.hidden, rng),
    picture=picture,
    dimension=2,
    variants=(
        Variant("default", "as it is", Scene(), Hidden(), 2, CRITERIA),
        Variant("weak", "half the force", Scene(force=1.0), Hidden(), 1, CRITERIA, {"gust": Uniform(0.05, 0.2)}),
    ),
    withheld=("course_lib.vacuum.reference",),
    deadline=1.0,
    first_call=20.0,
)


@contextmanager
def on_the_path():
    """Let fork servers find this module."""
    environment = server._environment
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(server, "_environment", lambda: environment() | {"PYTHONPATH": str(ROOT)})
        yield
