"""Obstacles: boxes in the room, how far away the closest is, and the scene of a flight.

A box is (x₀, y₀, z₀, x₁, y₁, z₁) in metres, its lowest corner and its highest. The room is |x|, |y| ≤ R / 2,
0 ≤ z ≤ h; its walls, floor and ceiling are obstacles like the others.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from course_lib.beacon.constants import Constants
from course_lib.ranges import check_ranges


@dataclass(frozen=True)
class Scene(Constants):
    """What a planner is told: `Constants`, and where to fly. The vehicle starts at rest and level at `start`.

    Attributes
    ----------
    obstacles : tuple of tuple of float
        Boxes (x₀, y₀, z₀, x₁, y₁, z₁) in metres.
    goal : tuple of float
        x, y, z in metres.
    goal_radius : float
        The vehicle has arrived when its centre is at most that far from the goal, in metres.
    radius : float
        Of the ball around the centre of the vehicle that must touch nothing, in metres.
    limit : float
        Time to arrive in, in seconds.

    Raises
    ------
    ValueError
        A number out of its range, a box whose corners are in the wrong order, or a start or goal at which the vehicle
        touches something.
    """

    obstacles: tuple[tuple[float, ...], ...] = ()
    goal: tuple[float, float, float] = (2.0, 0.0, 2.0)
    goal_radius: float = 0.3
    radius: float = 0.25
    limit: float = 30.0

    def __post_init__(self):
        super().__post_init__()
        positive = (1e-9, np.inf)
        check_ranges(self, goal_radius=positive, radius=positive, limit=positive)
        for number, box in enumerate(self.obstacles, 1):
            if len(box) != 6 or not np.all(np.isfinite(box)) or not np.all(np.array(box[:3]) < box[3:]):
                raise ValueError(f"obstacle {number} = {box} must be x0, y0, z0, x1, y1, z1 with each x0 < x1")
        for name, place in (("start", self.start[:3]), ("goal", self.goal)):
            if len(place) != 3 or not distances(np.array([place], dtype=float), self)[0] > self.radius:
                raise ValueError(f"{name} = {place} must be three numbers farther than {self.radius} m from everything")

    @cached_property
    def boxes(self):
        """`obstacles` as an array, shape (M, 6)."""
        return np.array(self.obstacles, dtype=float).reshape(-1, 6)

    @property
    def start_state(self):
        """The first state, shape (12,)."""
        x, y, z, yaw = self.start
        return np.array([x, y, z, 0.0, 0.0, yaw, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    @property
    def steps(self):
        """How many sampling times there are until `limit`."""
        return max(round(self.limit / self.Ts), 1)


def distances(points, scene):
    """Distance from each point to the closest obstacle or wall.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        In metres.
    scene : Scene
        Anything with `boxes`, `R` and `h`.

    Returns
    -------
    ndarray, shape (N,)
        In metres; 0 inside a box, negative outside the room.
    """
    points = np.ascontiguousarray(points, dtype=float)
    result = np.empty(len(points))
    _distances(points, scene.boxes, scene.R, scene.h, result)
    return result


def nearest(point, scene):
    """What is closest to a point (3,): "obstacle 4", counted from 1, "a wall", "the floor" or "the ceiling"."""
    x, y, z = point
    walls = {"a wall": scene.R / 2 - max(abs(x), abs(y)), "the floor": z, "the ceiling": scene.h - z}
    name = min(walls, key=walls.get)
    corner = scene.boxes
    beyond = np.maximum(np.maximum(corner[:, :3] - point, point - corner[:, 3:]), 0.0)
    apart = np.linalg.norm(beyond, axis=1)
    if len(apart) and apart.min() < walls[name]:
        return f"obstacle {np.argmin(apart) + 1}"
    return name


@njit("float64(float64, float64, float64, float64[:, ::1], float64, float64)", cache=True)
def distance(x, y, z, boxes, R, h):
    """`distances` of one point, as a kernel."""
    least = min(min(0.5 * R - abs(x), 0.5 * R - abs(y)), min(z, h - z))
    if not least > 0.0:
        return least
    least *= least
    for i in range(len(boxes)):
        dx = max(max(boxes[i, 0] - x, x - boxes[i, 3]), 0.0)
        dy = max(max(boxes[i, 1] - y, y - boxes[i, 4]), 0.0)
        dz = max(max(boxes[i, 2] - z, z - boxes[i, 5]), 0.0)
        least = min(least, dx * dx + dy * dy + dz * dz)
    return np.sqrt(least)


@njit("void(float64[:, ::1], float64[:, ::1], float64, float64, float64[::1])", cache=True)
def _distances(points, boxes, R, h, result):
    for i in range(len(points)):
        result[i] = distance(points[i, 0], points[i, 1], points[i, 2], boxes, R, h)
