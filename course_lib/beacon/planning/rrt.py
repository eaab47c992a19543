"""The source's kinodynamic RRT (question 4): the baseline.

An edge: a random duration in [0.1, 0.5] s, random inputs between u_min and u_max, X = f(X_n, U, Δt), kept unless the
march along the chord finds a collision. What the source leaves open is filled in as plainly as can be:

* the node to expand is the one nearest to a point drawn uniformly in the room, by the distance of positions;
* a node in the goal's ball ends the search;
* d_min is the vehicle's radius;
* a node whose tilt or rates leave `TILT` and `SPIN` is dropped: beyond them the integrator's steps are far too
  long, and at a quarter of a turn the angles are singular.
"""

import numpy as np
from numba import njit

from course_lib.beacon.planning.collisions import edge_by_chord, edge_by_speed
from course_lib.beacon.planning.problem import Plan
from course_lib.beacon.quadrotor import advance, parameters

#: Shortest and longest duration of an edge, in seconds.
DURATIONS = (0.1, 0.5)
#: Largest roll and pitch (rad) and body rate (rad/s) of a node.
TILT, SPIN = 1.2, 15.0
#: Uniform draws that an edge takes: a point (3), a duration, four inputs.
DRAWS = 8
#: What `grow` calls the checks.
CHORD, SPEED = 0, 1


def source_rrt(scene, state, rng, edges=20_000, inputs=None, check=CHORD):
    """Search for a plan the source's way.

    Parameters
    ----------
    scene : Scene
    state : ndarray, shape (12,)
        Where to start.
    rng : numpy.random.Generator
    edges : int
        How many are tried.
    inputs : (float, float)
        u_min and u_max, in N; the default is all that the rotors can do.
    check : int
        `CHORD`, the source's, or `SPEED`, which misses nothing.

    Returns
    -------
    plan : Plan or None
        None when no node lies in the goal.
    nodes : ndarray, shape (N, 12)
        The tree's states.
    """
    low, high = inputs or (0.0, scene.u_max)
    nodes = np.empty((edges + 1, 12))
    nodes[0] = state
    parents, thrusts, durations = np.zeros(edges + 1, dtype=np.int64), np.empty((edges + 1, 4)), np.empty(edges + 1)
    found, count = grow(
        nodes,
        parents,
        thrusts,
        durations,
        rng.random((edges, DRAWS)),
        np.array([low, high]),
        np.array([*scene.goal, scene.goal_radius]),
        scene.radius,
        check,
        scene.boxes,
        scene.R,
        scene.h,
        parameters(scene),
    )
    nodes = nodes[:count]
    if found < 0:
        return None, nodes
    way = []
    while found > 0:
        way.append(found)
        found = parents[found]
    way.reverse()
    return Plan(nodes[[0, *way]], thrusts[way], durations[way]), nodes


@njit(
    "UniTuple(int64, 2)(float64[:, ::1], int64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[::1],"
    " float64[::1], float64, int64, float64[:, ::1], float64, float64, float64[::1])",
    cache=True,
)
def grow(nodes, parents, thrusts, durations, draws, inputs, goal, d_min, check, boxes, R, h, parameters):
    """Grow the tree until a node lies in the goal.

    Parameters
    ----------
    nodes : ndarray, shape (N, 12)
        The first is the root; the others are written, as are their `parents` (N,), `thrusts` (N, 4), `durations` (N,).
    draws : ndarray, shape (edges, DRAWS)
        Uniform in [0, 1).
    inputs : ndarray, shape (2,)
        u_min and u_max.
    goal : ndarray, shape (4,)
        x, y, z and the radius.
    d_min, check, boxes, R, h, parameters
        As in `source_rrt` and the checks.

    Returns
    -------
    found : int
        The node in the goal, or -1.
    count : int
        Of nodes.
    """
    count = 1
    place, u = np.empty((1, 12)), np.empty((1, 4))
    for draw in draws:
        x, y, z = (draw[0] - 0.5) * R, (draw[1] - 0.5) * R, draw[2] * h
        parent, least = 0, np.inf
        for i in range(count):
            far = (nodes[i, 0] - x) ** 2 + (nodes[i, 1] - y) ** 2 + (nodes[i, 2] - z) ** 2
            if far < least:
                parent, least = i, far
        duration = DURATIONS[0] + draw[3] * (DURATIONS[1] - DURATIONS[0])
        u[0] = inputs[0] + draw[4:8] * (inputs[1] - inputs[0])
        place[0] = nodes[parent]
        advance(place, u, duration, parameters)
        state = place[0]
        tilt = max(abs(state[3]), abs(state[4]))
        spin = max(abs(state[9]), max(abs(state[10]), abs(state[11])))
        if not (tilt < TILT and spin < SPIN):
            continue
        if check == CHORD:
            collides = edge_by_chord(nodes[parent], u[0], duration, d_min, boxes, R, h, parameters)[0]
        else:
            collides = edge_by_speed(nodes[parent], u[0], duration, d_min, 0.005, boxes, R, h, parameters)[0]
        if collides:
            continue
        nodes[count], thrusts[count] = state, u[0]
        parents[count], durations[count] = parent, duration
        count += 1
        if (state[0] - goal[0]) ** 2 + (state[1] - goal[1]) ** 2 + (state[2] - goal[2]) ** 2 <= goal[3] ** 2:
            return count - 1, count
    return -1, count
