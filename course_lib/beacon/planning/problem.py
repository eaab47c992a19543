"""The planner: a tree of flights steered by the controller, then the shortest of several routes made shorter.

It differs from the source's (`beacon.rrt`) in four things: an edge is flown by the stabilising controller towards a
sampled point, now and then the goal, instead of by random inputs, so that 12 states become 3 to search; the node to
expand is judged by where it drifts and how often it failed; the collision check misses nothing; the route is shortened.

References
----------
S. LaValle, J. Kuffner, *Randomized kinodynamic planning*, IJRR 20 (2001).
P. Cheng, S. LaValle, *Reducing metric sensitivity in randomized trajectory design*, IROS 2001: nodes that failed count
as farther away.
"""

from typing import NamedTuple

import numpy as np

from course_lib.beacon.planning import steering
from course_lib.beacon.quadrotor import parameters

#: Share of the edges that aim at the goal.
BIAS = 0.15
#: Plans end that deep in the goal: this share of its radius.
DEEP = 0.6
#: Legs of a route beyond those it begins with.
SPARE = 8


class Plan(NamedTuple):
    """A way to the goal. States are those of `quadrotor.f` to the last bit: f(states[k], thrusts[k], durations[k]) is
    states[k + 1].

    Attributes
    ----------
    states : ndarray, shape (K + 1, 12)
    thrusts : ndarray, shape (K, 4)
        Constant in each step, in N.
    durations : ndarray, shape (K,)
        Of each step, in seconds.
    """

    states: np.ndarray
    thrusts: np.ndarray
    durations: np.ndarray

    @property
    def duration(self):
        """Of the whole, in seconds."""
        return float(self.durations.sum())


class Route(NamedTuple):
    """What the controller flies to, leg by leg.

    Attributes
    ----------
    targets : ndarray, shape (L, 4)
        x, y, z (m) and yaw (rad).
    steps : ndarray of int, shape (L,)
        Sampling times of each leg.
    """

    targets: np.ndarray
    steps: np.ndarray


def plan(scene, state, rng, margin=0.15, trees=2, edges=40_000, proposals=4_000):
    """Plan a flight from a state to the scene's goal.

    Parameters
    ----------
    scene : Scene
    state : ndarray, shape (12,)
    rng : numpy.random.Generator
    margin : float
        What is left between the vehicle and everything else, in metres.
    trees : int
        The quickest route of so many is the one that is shortened.
    edges : int
        Of each tree, at most.
    proposals : int
        Changes of the route that are tried.

    Returns
    -------
    Plan or None
        In steps of the sampling time; None when no tree reached the goal.
    """
    routes = [search(scene, state, rng, margin, edges)[0] for _ in range(trees)]
    routes = [route for route in routes if route is not None]
    if not routes:
        return None
    return shortened(min(routes, key=lambda route: route.steps.sum()), scene, state, rng, margin, proposals)


def search(scene, state, rng, margin, edges):
    """Grow one tree.

    Parameters
    ----------
    scene, state, rng, margin, edges
        As in `plan`.

    Returns
    -------
    route : Route or None
        None when the tree did not reach the goal.
    tally : ndarray of int, shape (2,)
        Nodes in the tree, and edges tried.
    """
    nodes, targets = np.empty((edges + 1, 12)), np.empty((edges + 1, 4))
    nodes[0], targets[0] = state, state[5]
    parents, steps = np.zeros(edges + 1, dtype=np.int64), np.zeros(edges + 1, dtype=np.int64)
    tally = np.zeros(2, dtype=np.int64)
    draws = rng.random((edges, steering.DRAWS))
    node = steering.grow(nodes, parents, targets, steps, draws, BIAS, *_surroundings(scene, margin), tally)
    if node < 0:
        return None, tally
    way = []
    while node > 0:
        way.append(node)
        node = parents[node]
    way.reverse()
    return Route(targets[way], steps[way]), tally


def shortened(route, scene, state, rng, margin, proposals):
    """Fly a route that `search` returned, and make it shorter.

    Parameters
    ----------
    route : Route
    scene, state, rng, margin, proposals
        As in `plan`.

    Returns
    -------
    Plan
    """
    legs, total = len(route.steps), int(route.steps.sum())
    targets, steps = np.empty((legs + SPARE, 4)), np.ones(legs + SPARE, dtype=np.int64)
    targets[:legs], steps[:legs] = route
    states, thrusts = np.empty((total + 1, 12)), np.empty((total, 4))
    states[0] = state
    draws = rng.random((proposals, steering.DRAWS))
    _, cost = steering.shorten(states, thrusts, targets, steps, legs, draws, *_surroundings(scene, margin))
    count = int(cost)
    return Plan(states[: count + 1], thrusts[:count], np.full(count, scene.Ts))


def _surroundings(scene, margin):
    """The last arguments of all kernels of `steering`."""
    goal = np.array([*scene.goal, DEEP * scene.goal_radius])
    return goal, scene.radius + margin, scene.boxes, np.array([scene.R, scene.h, scene.Ts]), parameters(scene)
