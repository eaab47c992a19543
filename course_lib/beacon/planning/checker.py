"""The independent checker of plans: an integrator and a geometry of its own, at a much finer step.

It shares no code with the planners nor with `quadrotor`: attitude is a rotation matrix here, the equations are Newton's
and Euler's with vectors, steps are a millisecond, and distances are shapely's, from point to polygon in the plan view.
"""

from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

#: Longest step of the integrator, in seconds.
FINE = 0.001
#: A plan is one that the vehicle follows when no step's end is farther than this from what the plan says (m, rad, m/s,
#: rad/s): the error that the model makes with its long steps.
FAITHFUL = 1e-3


class Report(NamedTuple):
    """What the checker found.

    Attributes
    ----------
    clearance : float
        Least distance between the vehicle's ball and anything else along the plan, in metres; negative: a collision.
    time : float
        When, in seconds.
    place : ndarray, shape (3,)
        Where, in metres.
    what : str
        The closest there: "obstacle 4", counted from 1, "wall", "floor" or "ceiling".
    error : float
        Largest difference between a state of the plan and where the checker's integrator gets from the state before it.
    arrives : bool
        The plan ends in the goal, and starts where it should.
    """

    clearance: float
    time: float
    place: np.ndarray
    what: str
    error: float
    arrives: bool

    @property
    def collides(self):
        """The vehicle touches something."""
        return self.clearance < 0

    @property
    def sound(self):
        """Follows the model, touches nothing and arrives."""
        return not self.collides and self.error < FAITHFUL and self.arrives


def check(plan, scene, start=None):
    """Fly a plan once more, and measure how close it comes.

    Parameters
    ----------
    plan : Plan
    scene : Scene
    start : ndarray, shape (12,)
        Where the plan must begin; the default is the scene's start, at rest.

    Returns
    -------
    Report
    """
    if start is None:
        start = np.zeros(12)
        start[[0, 1, 2, 5]] = scene.start
    times, places, ends = _fly(plan, scene)
    gaps, whats = _gaps(places, scene)
    closest = int(np.argmin(gaps))
    offset = plan.states[1:] - ends
    offset[:, 3:6] = (offset[:, 3:6] + np.pi) % (2 * np.pi) - np.pi
    arrives = np.linalg.norm(places[-1] - scene.goal) <= scene.goal_radius and np.array_equal(plan.states[0], start)
    return Report(
        float(gaps[closest] - scene.radius),
        float(times[closest]),
        places[closest],
        whats(closest),
        float(np.abs(offset).max()),
        bool(arrives),
    )


def _fly(plan, scene):
    """Times (s) and places (m) a millisecond apart, and where each step ends, shape (K, 12). All steps at once."""
    count = int(np.ceil(plan.durations.max() / FINE))
    dt = plan.durations[:, None] / count
    angles = plan.states[:-1, 3:6]
    p, v, w = (plan.states[:-1, columns] for columns in (slice(0, 3), slice(6, 9), slice(9, 12)))
    turn = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    inertia = np.array(scene.inertia)
    # Rotors ahead, left, behind, right; the first and the third turn the body one way, the others the other way.
    arms = scene.arm * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    torque = plan.thrusts @ np.cross(arms, [0.0, 0.0, 1.0])
    torque[:, 2] += scene.torque_ratio * plan.thrusts @ [1, -1, 1, -1]
    lift = plan.thrusts.sum(axis=1)[:, None]

    def slope(_, v, turn, w):
        force = lift * turn[:, :, 2] - scene.drag * v
        skew = np.zeros((len(w), 3, 3))
        skew[:, [2, 0, 1], [1, 2, 0]] = w
        skew[:, [1, 2, 0], [2, 0, 1]] = -w
        return v, force / scene.mass - [0.0, 0.0, scene.g], turn @ skew, (torque - np.cross(w, inertia * w)) / inertia

    def moved(state, slopes, dt):
        step = dt[:, :, None]
        return tuple(s + (step if s.ndim == 3 else dt) * k for s, k in zip(state, slopes, strict=True))

    state, path = (p, v, turn, w), [p]
    for _ in range(count):
        k1 = slope(*state)
        k2 = slope(*moved(state, k1, dt / 2))
        k3 = slope(*moved(state, k2, dt / 2))
        k4 = slope(*moved(state, k3, dt))
        state = moved(state, [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)], dt)
        path.append(state[0])
    begin = np.concatenate([[0.0], np.cumsum(plan.durations)[:-1]])
    times = begin[:, None] + dt * np.arange(count + 1)
    p, v, turn, w = state
    ends = np.hstack([p, Rotation.from_matrix(turn).as_euler("ZYX")[:, ::-1], v, w])
    return times.ravel(), np.swapaxes(path, 0, 1).reshape(-1, 3), ends


def _gaps(places, scene):
    """Distance from each place to what is closest (m), and a function from a row to the name of that."""
    x, y, z = places.T
    side, names = scene.R / 2, ["wall", "floor", "ceiling"]
    gaps = [np.min([side - x, side + x, side - y, side + y], axis=0), z, scene.h - z]
    points = shapely.points(x, y)
    for number, (x0, y0, z0, x1, y1, z1) in enumerate(scene.obstacles, 1):
        level = shapely.distance(shapely.box(x0, y0, x1, y1), points)
        gaps.append(np.hypot(level, np.where(z < z0, z0 - z, np.where(z > z1, z - z1, 0.0))))
        names.append(f"obstacle {number}")
    return np.min(gaps, axis=0), lambda row: names[int(np.argmin([gap[row] for gap in gaps]))]
