"""Compiled parts of the planner that steers: flights to a target, a tree of them, and how a plan is shortened.

A route is a list of legs, each a target (x, y, z) for `quadrotor.fly_to` and a number of sampling times; flying it with
the model gives the plan. So every plan is one that the vehicle can follow exactly.
"""

import numpy as np
from numba import njit

from course_lib.beacon.planning.collisions import TOLERANCE, edge_by_speed, growth_of_speed, speed_of
from course_lib.beacon.planning.obstacles import distance
from course_lib.beacon.quadrotor import advance, controlled

#: How a flight ended.
FLEW, COLLIDED, ARRIVED = 0, 1, 2
#: A node's distance to a sample is taken from where it drifts in so many seconds, and grows with each failed edge.
DRIFT, DETOUR = 0.5, 0.3
#: An edge is as long as a draw from this range, in seconds; of one that collides, this share is kept.
SHORTEST, LONGEST, KEPT = 0.3, 2.0, 0.5
#: Columns of draws that an edge or a proposal takes.
DRAWS = 7
#: A route of more legs is first of all made one of fewer.
MANY = 16


@njit("float64(float64[::1], float64[::1])", cache=True)
def apart(state, place):
    """Distance of two points, the first three numbers of each."""
    return np.sqrt((state[0] - place[0]) ** 2 + (state[1] - place[1]) ** 2 + (state[2] - place[2]) ** 2)


@njit(
    "UniTuple(int64, 2)(float64[:, ::1], float64[:, ::1], int64, int64, float64[::1], float64[::1], float64,"
    " float64[:, ::1], float64[::1], float64[::1])",
    cache=True,
)
def fly(states, thrusts, first, steps, target, goal, margin, boxes, room, parameters):
    """Fly to a target, checking for collisions, until the goal is reached.

    Parameters
    ----------
    states : ndarray, shape (T + 1, 12)
        Row `first` is where the flight starts; the rows after it are written.
    thrusts : ndarray, shape (T, 4)
        Written from row `first` on.
    first, steps : int
    target : ndarray, shape (4,)
    goal : ndarray, shape (4,)
        x, y, z and the radius in which it counts as reached, in metres.
    margin : float
        The vehicle's radius and what is to be left beyond it, in metres.
    boxes : ndarray, shape (M, 6)
    room : ndarray, shape (3,)
        R, h and the sampling time.
    parameters : ndarray

    Returns
    -------
    outcome : int
    row : int
        The last one, or, after a collision, the one before it.
    """
    R, h, Ts = room
    # The vehicle is sure to be free for that far.
    slack = 0.0
    for k in range(first, first + steps):
        state = states[k]
        u = controlled(state, target, parameters)
        thrusts[k] = u
        # No farther than this in a sampling time, so that most of them need no check.
        reach = (speed_of(state) + 0.5 * growth_of_speed(u, parameters) * Ts) * Ts
        if not slack > reach:
            slack = distance(state[0], state[1], state[2], boxes, R, h) - margin
            if not slack > TOLERANCE:
                return COLLIDED, k
            if slack <= reach and edge_by_speed(state, u, Ts, margin, TOLERANCE, boxes, R, h, parameters)[0]:
                return COLLIDED, k
        slack -= reach
        states[k + 1] = state
        advance(states[k + 1 : k + 2], thrusts[k : k + 1], Ts, parameters)
        if apart(states[k + 1], goal) <= goal[3]:
            gap = distance(states[k + 1, 0], states[k + 1, 1], states[k + 1, 2], boxes, R, h) - margin
            return (ARRIVED if gap > TOLERANCE else COLLIDED), k + 1
    return FLEW, first + steps


@njit("int64(float64[:, ::1], int64[::1], int64, float64[::1])", cache=True)
def nearest_node(nodes, failures, count, target):
    """The node from which a target is likely to be reached soonest."""
    best, least = 0, np.inf
    for i in range(count):
        dx = nodes[i, 0] + DRIFT * nodes[i, 6] - target[0]
        dy = nodes[i, 1] + DRIFT * nodes[i, 7] - target[1]
        dz = nodes[i, 2] + DRIFT * nodes[i, 8] - target[2]
        worse = 1.0 + DETOUR * failures[i]
        far = (dx * dx + dy * dy + dz * dz) * worse * worse
        if far < least:
            best, least = i, far
    return best


@njit(
    "int64(float64[:, ::1], int64[::1], float64[:, ::1], int64[::1], float64[:, ::1], float64, float64[::1], float64,"
    " float64[:, ::1], float64[::1], float64[::1], int64[::1])",
    cache=True,
)
def grow(nodes, parents, targets, steps, draws, bias, goal, margin, boxes, room, parameters, tally):
    """Grow a tree of flights until one reaches the goal.

    Parameters
    ----------
    nodes : ndarray, shape (N, 12)
        The first is the root; written.
    parents, steps : ndarray of int, shape (N,)
        Written: the node an edge starts from, and its sampling times.
    targets : ndarray, shape (N, 4)
        Written: what an edge flew to. The first row holds the yaw.
    draws : ndarray, shape (edges, DRAWS)
        Uniform in [0, 1).
    bias : float
        Share of the edges that aim at the goal.
    goal, margin, boxes, room, parameters
        As in `fly`.
    tally : ndarray of int, shape (2,)
        Written: nodes and edges.

    Returns
    -------
    int
        The node that is in the goal; -1 when there is none.
    """
    R, h, Ts = room
    failures = np.zeros(len(nodes), dtype=np.int64)
    longest = int(2 * LONGEST / Ts) + 1
    states, thrusts = np.empty((longest + 1, 12)), np.empty((longest, 4))
    target = np.empty(4)
    target[3] = targets[0, 3]
    count = 1
    for edge in range(len(draws)):
        draw = draws[edge]
        tally[0], tally[1] = count, edge + 1
        aimed = draw[0] < bias
        if aimed:
            target[:3] = goal[:3]
            duration = 2 * LONGEST
        else:
            target[0], target[1], target[2] = (draw[1] - 0.5) * R, (draw[2] - 0.5) * R, draw[3] * h
            duration = SHORTEST + draw[4] * (LONGEST - SHORTEST)
        parent = nearest_node(nodes, failures, count, target)
        states[0] = nodes[parent]
        steps_of_edge = int(duration / Ts)
        outcome, row = fly(states, thrusts, 0, steps_of_edge, target, goal, margin, boxes, room, parameters)
        if outcome == COLLIDED:
            failures[parent] += 1
            row = int(row * KEPT)
            if row * Ts < SHORTEST:
                continue
        nodes[count] = states[row]
        parents[count], steps[count] = parent, row
        targets[count] = target
        count += 1
        tally[0] = count
        if outcome == ARRIVED:
            return count - 1
        if count == len(nodes):
            return -1
    return -1


@njit(
    "Tuple((boolean, float64))(float64[:, ::1], float64[:, ::1], float64[:, ::1], int64[::1], int64, int64, int64,"
    " int64, float64[::1], float64, float64[:, ::1], float64[::1], float64[::1])",
    cache=True,
)
def fly_route(states, thrusts, targets, steps, legs, leg, row, last, goal, margin, boxes, room, parameters):
    """Fly a route from a leg on; the last leg until the goal is reached.

    Parameters
    ----------
    states, thrusts, goal, margin, boxes, room, parameters
        As in `fly`.
    targets : ndarray, shape (L, 4)
    steps : ndarray of int, shape (L,)
    legs, leg : int
        How many there are, and with which to begin.
    row : int
        Where that starts.
    last : int
        The row at which the flight is given up.

    Returns
    -------
    arrived : bool
    cost : float
        Sampling times until it arrived, and, up to a half, how far from the goal's centre it then is.
    """
    while leg < legs and row < last:
        count = last - row if leg == legs - 1 else min(steps[leg], last - row)
        outcome, row = fly(states, thrusts, row, count, targets[leg], goal, margin, boxes, room, parameters)
        if outcome == ARRIVED:
            return True, row + 0.5 * apart(states[row], goal) / goal[3]
        if outcome == COLLIDED:
            return False, np.inf
        leg += 1
    return False, np.inf


@njit(
    "Tuple((int64, float64))(float64[:, ::1], float64[:, ::1], float64[:, ::1], int64[::1], int64, float64[:, ::1],"
    " float64[::1], float64, float64[:, ::1], float64[::1], float64[::1])",
    cache=True,
)
def shorten(states, thrusts, targets, steps, legs, draws, goal, margin, boxes, room, parameters):
    """Make a route shorter in time: leave legs out, shift targets and times of turning, and keep what is sooner there.

    Parameters
    ----------
    states, thrusts, targets, steps
        As in `fly_route`, with room for as many legs as `targets` has rows; overwritten by the best.
    legs : int
    draws : ndarray, shape (proposals, DRAWS)
        Uniform in [0, 1).
    goal, margin, boxes, room, parameters
        As in `fly`.

    Returns
    -------
    legs : int
    cost : float
        As of `fly_route`; infinite when the route does not arrive.
    """
    R, h, _ = room
    arrived, best = fly_route(
        states, thrusts, targets, steps, legs, 0, 0, len(thrusts), goal, margin, boxes, room, parameters
    )
    if not arrived:
        return legs, np.inf
    trial, inputs = states.copy(), thrusts.copy()
    wishes, counts = targets.copy(), steps.copy()
    for draw in draws:
        wishes[:legs], counts[:legs] = targets[:legs], steps[:legs]
        leg, now = min(int(draw[1] * legs), legs - 1), legs
        kind = draw[0]
        if kind < (0.6 if legs > MANY else 0.25):
            # Without one leg or a few in a row.
            gone = min(1 + int(0.3 * legs * draw[2] ** 2), legs - 1 - leg)
            now = legs - gone
            for i in range(leg, now):
                wishes[i], counts[i] = wishes[i + gone], counts[i + gone]
        elif draw[5] < 0.25:
            # Turn sooner or later, the legs after it as they were or as much shorter or longer.
            shift = int((2.0 * draw[2] - 1.0) * 10.0 ** (1.5 * draw[3]))
            counts[leg] = max(counts[leg] + shift, 1)
            if draw[4] < 0.5 and leg + 1 < legs:
                counts[leg + 1] = max(counts[leg + 1] - shift, 1)
        else:
            if draw[5] < 0.45 and legs < MANY and legs < len(targets) and counts[leg] > 1:
                # In two legs, of which the first is then moved.
                now = legs + 1
                for i in range(now - 1, leg, -1):
                    wishes[i], counts[i] = wishes[i - 1], counts[i - 1]
                part = 1 + int((draw[5] - 0.25) / 0.2 * (counts[leg] - 1))
                counts[leg], counts[leg + 1] = part, counts[leg + 1] - part
            scale = 10.0 ** (0.5 - 2.0 * draw[6])
            wishes[leg, 0] += scale * (2.0 * draw[2] - 1.0)
            wishes[leg, 1] += scale * (2.0 * draw[3] - 1.0)
            wishes[leg, 2] += scale * (2.0 * draw[4] - 1.0)
        row = 0
        for i in range(leg):
            row += steps[i]
        if row >= best:
            continue
        trial[row] = states[row]
        arrived, cost = fly_route(
            trial, inputs, wishes, counts, now, leg, row, int(best), goal, margin, boxes, room, parameters
        )
        if arrived and cost < best:
            best, end = cost, int(cost)
            states[row : end + 1], thrusts[row:end] = trial[row : end + 1], inputs[row:end]
            legs = now
            targets[:legs], steps[:legs] = wishes[:legs], counts[:legs]
            # What the last leg has in steps is what it took.
            before = 0
            for i in range(legs - 1):
                before += steps[i]
            if before >= end:
                # It arrived earlier: the legs after that are not flown.
                before, legs = 0, 0
                while before < end:
                    before += steps[legs]
                    legs += 1
                before -= steps[legs - 1]
            steps[legs - 1] = end - before
    return legs, best
