"""Plans so that the vehicle just fits, as if there were no gusts."""

import numpy as np

from course_lib.beacon.planning.obstacles import distances
from course_lib.beacon.quadrotor import f, fly_to
from course_lib.filters import Step

MARGIN = 0.0
EDGES = 2000
TREES = 3
#: Positions between two sampling times at which a flight is looked at.
LOOKS = np.array([[0.0], [0.5], [1.0]])


def Planner(previous, belief, state, constants, rng):
    legs, leg, clock = plan(state, constants, rng) if previous is None else previous.memory
    while leg < len(legs) - 1 and clock >= legs[leg][1]:
        leg, clock = leg + 1, 0
    target = legs[leg][0]
    return Step(fly_to(state, [*target, constants.start[3]], constants), (legs, leg, clock + 1))


def plan(state, scene, rng):
    """Legs (target, steps), of which the last has no end, and where in them one is."""
    for margin in (MARGIN,):
        found = [legs for legs in (tree(state, scene, margin, rng) for _ in range(TREES)) if legs]
        if found:
            legs = min(found, key=lambda legs: sum(steps for _, steps in legs))
            legs = drop_legs(legs, state, scene, margin)
            break
    else:
        legs = []
    return [*legs, (np.array(scene.goal), 1)], 0, 0


def tree(root, scene, margin, rng):
    nodes, parents, legs, failures = np.empty((EDGES + 1, 12)), [0], [None], np.zeros(EDGES + 1)
    nodes[0] = root
    goal = np.array(scene.goal)
    for _ in range(EDGES):
        count = len(legs)
        to_goal = rng.random() < 0.15
        target = goal if to_goal else rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]) * [scene.R, scene.R, scene.h]
        steps = int((4.0 if to_goal else rng.uniform(0.4, 2.0)) / scene.Ts)
        drifted = nodes[:count, :3] + 0.5 * nodes[:count, 6:9]
        parent = int(np.argmin(np.linalg.norm(drifted - target, axis=1) * (1 + 0.3 * failures[:count])))
        states, arrived = flight(nodes[parent], target, steps, scene, margin)
        if len(states) <= 0.4 / scene.Ts and not arrived:
            failures[parent] += 1
            continue
        if len(states) <= steps and not arrived:
            failures[parent] += 1
            states = states[: len(states) // 2 + 1]
        nodes[count] = states[-1]
        parents.append(parent)
        legs.append((target, len(states) - 1))
        if arrived:
            way = []
            while count:
                way.append(legs[count])
                count = parents[count]
            return way[::-1]
    return None


def flight(state, target, steps, scene, margin):
    """States as long as they are free and not yet in the goal, and whether the last one is in it."""
    states = [state]
    for _ in range(steps):
        thrusts = fly_to(states[-1], [*target, scene.start[3]], scene)
        new = f(states[-1], thrusts, scene.Ts, scene)
        between = states[-1][:3] + LOOKS * (new[:3] - states[-1][:3])
        if distances(between, scene).min() <= scene.radius + margin:
            return states, False
        states.append(new)
        if np.linalg.norm(new[:3] - scene.goal) < 0.6 * scene.goal_radius:
            return states, True
    return states, False


def drop_legs(legs, state, scene, margin):
    """Leave out whatever leg can be left out."""
    i = 0
    while i < len(legs):
        fewer = legs[:i] + legs[i + 1 :]
        shorter = flown(fewer, state, scene, margin)
        if shorter and sum(s for _, s in shorter) < sum(s for _, s in legs):
            legs = shorter
        else:
            i += 1
    return legs


def flown(legs, state, scene, margin):
    """The legs as they are flown until the goal is reached; the last one as long as it takes. None if they hit."""
    done = []
    for number, (target, steps) in enumerate(legs):
        last = number == len(legs) - 1
        states, arrived = flight(state, target, int(5 / scene.Ts) if last else steps, scene, margin)
        done.append((target, len(states) - 1))
        if arrived:
            return done
        if len(states) <= steps:
            return None
        state = states[-1]
    return None
