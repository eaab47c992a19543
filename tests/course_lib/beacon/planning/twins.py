"""The planners' kernels once more in plain Python, on the equations of `twins`: also the benchmarks' baseline."""

import numpy as np

from course_lib.beacon.planning import collisions, rrt, steering
from course_lib.beacon.quadrotor import fly_to
from tests.course_lib.beacon import twins


def distance(point, scene):
    """To the closest box or wall."""
    x, y, z = point
    side = scene.R / 2
    least = min(side - abs(x), side - abs(y), z, scene.h - z)
    for box in scene.obstacles:
        inside = np.clip(point, box[:3], box[3:])
        least = min(least, float(np.linalg.norm(point - inside)))
    return least


def edge(state, u, scene):
    """The path of an edge: position at a time."""
    return lambda t: twins.f(state, u, t, scene)[:3] if t > 0 else state[:3]


def edge_by_chord(state, u, duration, scene):
    return collisions.march_by_chord(edge(state, u, scene), duration, lambda p: distance(p, scene), scene.radius)


def edge_by_speed(state, u, duration, margin, scene):
    growth = u.sum() / scene.mass + scene.g
    path = edge(state, u, scene)
    return collisions.march_by_speed(
        path, duration, lambda p: distance(p, scene), margin, np.linalg.norm(state[6:9]), growth
    )


def source_rrt(scene, draws, low, high):
    """Question 4 as it is written: nodes, parents, and the node in the goal or None."""
    nodes, parents = [scene.start_state], [0]
    for draw in draws:
        point = (draw[:3] - [0.5, 0.5, 0.0]) * [scene.R, scene.R, scene.h]
        parent = int(np.argmin([np.sum((node[:3] - point) ** 2) for node in nodes]))
        duration = 0.1 + 0.4 * draw[3]
        u = low + draw[4:] * (high - low)
        state = twins.f(nodes[parent], u, duration, scene)
        if np.abs(state[3:5]).max() >= rrt.TILT or np.abs(state[9:12]).max() >= rrt.SPIN:
            continue
        if edge_by_chord(nodes[parent], u, duration, scene)[0]:
            continue
        nodes.append(state)
        parents.append(parent)
        if np.linalg.norm(state[:3] - scene.goal) <= scene.goal_radius:
            return nodes, parents, len(nodes) - 1
    return nodes, parents, None


def fly(state, steps, target, goal, margin, scene):
    """A flight to a target: states, and how it ended; each sampling time is checked."""
    states = [state]
    for _ in range(steps):
        u = fly_to(states[-1], target, scene)
        if edge_by_speed(states[-1], u, scene.Ts, margin, scene)[0]:
            return states, steering.COLLIDED
        states.append(twins.f(states[-1], u, scene.Ts, scene))
        if np.linalg.norm(states[-1][:3] - goal[:3]) <= goal[3]:
            free = distance(states[-1][:3], scene) - margin > collisions.TOLERANCE
            return states, steering.ARRIVED if free else steering.COLLIDED
    return states, steering.FLEW


def grow(scene, draws, bias, goal, margin):
    """The tree of flights: nodes, parents, steps, and whether it reached the goal."""
    nodes, parents, steps, failures = [scene.start_state], [0], [0], [0]
    for draw in draws:
        if draw[0] < bias:
            point, duration = goal[:3], 2 * steering.LONGEST
        else:
            point = (draw[1:4] - [0.5, 0.5, 0.0]) * [scene.R, scene.R, scene.h]
            duration = steering.SHORTEST + draw[4] * (steering.LONGEST - steering.SHORTEST)
        far = [
            np.linalg.norm(node[:3] + steering.DRIFT * node[6:9] - point) * (1 + steering.DETOUR * failed)
            for node, failed in zip(nodes, failures, strict=True)
        ]
        parent = int(np.argmin(far))
        target = np.array([*point, scene.start[3]])
        states, outcome = fly(nodes[parent], int(duration / scene.Ts), target, goal, margin, scene)
        last = len(states) - 1
        if outcome == steering.COLLIDED:
            failures[parent] += 1
            last = int(last * steering.KEPT)
            if last * scene.Ts < steering.SHORTEST:
                continue
        nodes.append(states[last])
        parents.append(parent)
        steps.append(last)
        failures.append(0)
        if outcome == steering.ARRIVED:
            return nodes, parents, steps, True
    return nodes, parents, steps, False
