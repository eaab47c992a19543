"""The assignment of the quadrotor's planner: rooms full of obstacles, flown through in gusts."""

from dataclasses import dataclass, replace

import numpy as np

from course_lib.beacon.planning.flight import Flight
from course_lib.beacon.planning.obstacles import Scene, distances
from course_lib.beacon.planning.scenes import KINDS, random_scene
from grader.assignment import Criterion, LogUniform, PlannerAssignment, Uniform, Variant

# Ratios of the time to the goal to the reference's in the same scene and gusts that earn full marks and none. A planner
# that arrives is nearly right: one that follows a path of points in sight of the controller takes 1.5 to 3 times as
# long, and a cautious one four times.
TIME = (3.0, 10.0)
#: Places between start and goal at which something may stand in the way.
LOOKS = 200


@dataclass(frozen=True)
class Hidden:
    """What decides on a scene.

    Attributes
    ----------
    kind : str
        A key of `course_lib.beacon.planning.scenes.KINDS`.
    """

    kind: str


def simulate(variant, rng):
    """A flight at its start: scene and gusts have separate streams."""
    place, air = rng.spawn(2)
    kind = variant.hidden.kind
    scene = random_scene(kind, place, variant.constants)
    while kind != "open" and not in_the_way(scene):
        scene = random_scene(kind, place, variant.constants)
    return Flight(scene, air)


def in_the_way(scene):
    """Whether something stands between start and goal: without, one need not plan."""
    straight = np.linspace(scene.start[:3], scene.goal, LOOKS)
    return bool(distances(straight, scene).min() <= scene.radius)


def picture(flight):
    """The room from above, for drawings."""
    scene = flight.constants
    r = scene.R / 2
    return {
        "room": [-r, -r, r, r],
        "sensors": [],
        "obstacles": [[x0, y0, x1, y1] for x0, y0, _, x1, y1, _ in scene.obstacles],
        "goal": [*scene.goal[:2], scene.goal_radius],
        "unit": "m",
    }


def any_kind(rng):
    """A kind of scene in which something is in the way."""
    return str(rng.choice([kind for kind in KINDS if kind != "open"]))


def _variant(name, title, points, kind, episodes=1, constants=None, ranges=None):
    return Variant(
        name=name,
        title=title,
        constants=replace(Scene(), **(constants or {})),
        hidden=Hidden(kind),
        episodes=episodes,
        criteria=(Criterion("time", points, *TIME),),
        ranges=ranges or {},
    )


LARGE = {"radius": 0.4, "mass": 1.5, "inertia": (0.02, 0.02, 0.04), "u_max": 8.0}

VARIANTS = (
    _variant("pillars", "pillars from floor to ceiling", 16, "pillars", episodes=2),
    _variant("open", "an empty room", 6, "open"),
    _variant("window", "a wall with a window", 12, "window"),
    _variant("windows", "two walls with windows", 10, "windows"),
    _variant("corridor", "three walls with doors at alternating sides", 10, "corridor"),
    _variant("clutter", "boxes in the air", 16, "clutter", episodes=2),
    _variant("gusts", "pillars in strong gusts", 10, "pillars", constants={"sigma_v": 0.4, "sigma_w": 0.1}),
    _variant("large", "pillars and a large vehicle", 10, "pillars", constants=LARGE),
    _variant(
        "drawn",
        "a room, a vehicle and obstacles of your grader's choosing",
        10,
        "pillars",
        ranges={
            "kind": any_kind,
            "R": Uniform(9.0, 13.0),
            "h": Uniform(3.5, 5.0),
            "radius": Uniform(0.2, 0.3),
            "mass": Uniform(0.8, 1.2),
            "sigma_v": LogUniform(0.1, 0.3),
        },
    ),
)

ASSIGNMENTS = (
    PlannerAssignment(
        name="beacon-rrt",
        title="A quadrotor among obstacles: a kinodynamic planner",
        entry_point="Planner",
        reference="course_lib.beacon.planning.pilot:Planner",
        simulate=simulate,
        picture=picture,
        dimension=4,
        variants=VARIANTS,
        given=("course_lib.beacon.quadrotor", "course_lib.beacon.planning.obstacles"),
        withheld=(
            "course_lib.beacon.models",
            "course_lib.beacon.world",
            "course_lib.beacon.planning.flight",
            "course_lib.beacon.planning.collisions",
            "course_lib.beacon.planning.checker",
            "course_lib.beacon.planning.rrt",
            "course_lib.beacon.planning.steering",
            "course_lib.beacon.planning.problem",
            "course_lib.beacon.planning.pilot",
            "course_lib.beacon.reference",
        ),
        deadline=2.0,
        first_call=60.0,
    ),
)
