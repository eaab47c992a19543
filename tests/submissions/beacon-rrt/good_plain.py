"""A tree of points, a path cut short, and the controller led along it as far ahead as a look into the future allows."""

import numpy as np

from course_lib.beacon import quadrotor
from course_lib.beacon.planning.obstacles import distances
from course_lib.filters import Step

MARGIN = 0.2
STEP = 0.8
MOST_POINTS = 4000
#: How far along the path the controller may be sent, in tenths of a metre; how long its flight is foreseen, in seconds.
AHEAD = (60, 45, 35, 28, 22, 17, 13, 10, 7, 5, 3)
FORESIGHT = 2.2
#: What is to be left beside the vehicle then, in metres, for the gusts.
KEPT = 0.12


def Planner(previous, belief, state, constants, rng):
    path = previous.memory if previous is not None else plan(state[:3], constants, rng)
    target = carrot(state, path, constants)
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


def carrot(state, path, scene):
    """The farthest place on the path to which the controller can be sent without coming close to anything."""
    here = int(np.linalg.norm(path - state[:3], axis=1).argmin())
    best, most = path[here], -np.inf
    for ahead in AHEAD:
        target = path[min(here + ahead, len(path) - 1)]
        room = foreseen(state, target, scene)
        if room > KEPT:
            return target
        if room > most:
            best, most = target, room
    return best


def foreseen(state, target, scene):
    """How close the vehicle will come to anything, beyond its radius, when it is sent to a target."""
    places = []
    for _ in range(int(FORESIGHT / scene.Ts)):
        thrusts = quadrotor.fly_to(state, [*target, scene.start[3]], scene)
        state = quadrotor.f(state, thrusts, scene.Ts, scene)
        places.append(state[:3])
        if np.linalg.norm(state[:3] - scene.goal) < 0.5 * scene.goal_radius:
            break
    return distances(np.array(places), scene).min() - scene.radius
