"""The worked examination's tree: random inputs, random times, the march along the chord, and no feedback in flight."""

import numpy as np

from course_lib.beacon.planning.obstacles import distances
from course_lib.beacon.quadrotor import f, hover
from course_lib.filters import Step

EDGES = 3000


def Planner(previous, belief, state, constants, rng):
    steps = plan(state, constants, rng) if previous is None else previous.memory
    if not steps:
        return Step(hover(constants), steps)
    (thrusts, left), *rest = steps
    return Step(thrusts, [(thrusts, left - 1), *rest] if left > 1 else rest)


def plan(state, scene, rng):
    """Thrusts and for how many sampling times, one after the other."""
    nodes, parents, edges = [state], [0], [None]
    for _ in range(EDGES):
        place = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]) * [scene.R, scene.R, scene.h]
        parent = int(np.argmin(np.linalg.norm(np.array(nodes)[:, :3] - place, axis=1)))
        duration = rng.random() * 0.4 + 0.1
        thrusts = rng.random(4) * scene.u_max
        new = f(nodes[parent], thrusts, duration, scene)
        if np.abs(new[3:5]).max() > 1.2 or collides(nodes[parent], thrusts, duration, new, scene):
            continue
        nodes.append(new)
        parents.append(parent)
        edges.append((thrusts, max(round(duration / scene.Ts), 1)))
        if np.linalg.norm(new[:3] - scene.goal) < scene.goal_radius:
            break
    # To the node that is nearest to the goal.
    node = int(np.argmin(np.linalg.norm(np.array(nodes)[:, :3] - scene.goal, axis=1)))
    way = []
    while node:
        way.append(edges[node])
        node = parents[node]
    return way[::-1]


def collides(state, thrusts, duration, new, scene):
    """March by the distance to the closest obstacle, the time in proportion to the chord."""
    chord, total, place = np.linalg.norm(new[:3] - state[:3]), 0.0, state[:3]
    while total < chord:
        d = distances(place[None], scene)[0]
        if d < scene.radius:
            return True
        total += d
        place = f(state, thrusts, total / chord * duration, scene)[:3]
    return False
