"""Sends the controller two metres ahead on its path, whatever is between."""

import numpy as np

from course_lib.beacon import quadrotor
from course_lib.beacon.planning.obstacles import distances
from course_lib.filters import Step

MARGIN = 0.2
STEP = 0.8
MOST_POINTS = 4000


def Planner(previous, belief, state, constants, rng):
    path = previous.memory if previous is not None else plan(state[:3], constants, rng)
    here = int(np.linalg.norm(path - state[:3], axis=1).argmin())
    target = path[min(here + 20, len(path) - 1)]
    return Step(quadrotor.fly_to(state, [*target, constants.start[3]], constants), path)


def clear(a, b, scene, margin=MARGIN):
    """Whether a ball that moves straight from a to b stays that far away from everything."""
    # No farther apart than 5 cm, of which the margin is made to pay.
    count = int(np.linalg.norm(b - a) / 0.05) + 2
    return distances(np.linspace(a, b, count), scene).min() > scene.radius + margin


def plan(start, scene, rng):
    """A path of points, from the start to the goal."""
    goal = np.array(scene.goal)
    for margin in (MARGIN, 0.12, 0.06):
        path = tree(start, goal, scene, margin, rng)
        if path is not None:
            return densely(shorten(path, scene, margin, rng))
    return densely([start, goal])


def tree(start, goal, scene, margin, rng):
    points, parents = np.empty((MOST_POINTS, 3)), np.zeros(MOST_POINTS, dtype=int)
    points[0], count = start, 1
    low, high = np.array([-scene.R / 2, -scene.R / 2, 0.0]), np.array([scene.R / 2, scene.R / 2, scene.h])
    for _ in range(4 * MOST_POINTS):
        sample = goal if rng.random() < 0.1 else rng.uniform(low, high)
        away = np.linalg.norm(points[:count] - sample, axis=1)
        parent = int(away.argmin())
        if away[parent] == 0.0:
            continue
        new = points[parent] + (sample - points[parent]) * min(STEP / away[parent], 1.0)
        if not clear(points[parent], new, scene, margin):
            continue
        points[count], parents[count] = new, parent
        count += 1
        if np.linalg.norm(goal - new) < 2.0 and clear(new, goal, scene, margin):
            path, node = [goal], count - 1
            while node:
                path.append(points[node])
                node = parents[node]
            return [start, *path[:0:-1], goal]
        if count == MOST_POINTS:
            return None
    return None


def shorten(path, scene, margin, rng):
    """Cut corners between random places on the path."""
    for _ in range(150):
        places = densely(path)
        i, j = sorted(rng.integers(len(places), size=2))
        if j - i > 1 and clear(places[i], places[j], scene, margin):
            path = [*places[: i + 1], *places[j:]]
    return path


def densely(path):
    """The path with a point every 10 cm or so."""
    pieces = [
        np.linspace(a, b, int(np.linalg.norm(b - a) / 0.1) + 1, endpoint=False)
        for a, b in zip(path[:-1], path[1:], strict=True)
    ]
    return np.vstack([*pieces, path[-1]])
