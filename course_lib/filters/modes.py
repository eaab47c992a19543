"""The heaviest mode of a cloud: where the robot is while the filter still thinks it might be elsewhere.

The mean of two clusters lies between them, where nothing is. Here the cloud is put into bins, occupied bins that touch
are one cluster, and the estimate is the mean of the heaviest.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from course_lib.filters import bins
from course_lib.filters.bins import empty_table, number, place

_ROWS = types.float64[:, ::1]
_COLUMN = types.float64[::1]
_COUNTS = types.int64[::1]
_FLAGS = types.boolean[::1]


class Mode(NamedTuple):
    """A cluster of particles.

    Attributes
    ----------
    mean : ndarray, shape (d,)
        Weighted; on the circle where a column holds angles.
    weight : float
        The cluster's share of all weight.
    members : ndarray of bool, shape (N,)
    """

    mean: np.ndarray
    weight: float
    members: np.ndarray


def heaviest(particles, widths, angles=(), least=0.05):
    """The cluster with most of the weight.

    Parameters
    ----------
    particles : Particles
    widths : array_like, shape (d,)
        Widths of a bin; particles less than this apart in every column are in one cluster, more than twice this apart
        in any they are in different ones, unless others join them.
    angles : sequence of int
        Columns that hold angles in radians: bins wrap, their mean is taken on the circle.
    least : float
        Bins that hold less than this share of the heaviest bin's weight belong to no cluster: so that a few particles
        strewn over all the room (`adaptive.inject`) do not join what is apart.

    Returns
    -------
    Mode
        Of clusters equally heavy, the one with the first particle.
    """
    states, widths, angular = bins.columns(particles.states, widths, angles)
    return Mode(*_heaviest(states, particles.weights, widths, angular, least))


def components(states, widths, angles=()):
    """Number the clusters.

    Parameters
    ----------
    states : ndarray, shape (N, d)
    widths, angles
        As in `heaviest`.

    Returns
    -------
    ndarray of int64, shape (N,)
        The cluster of each particle: 0, 1, ... in the order of their first particles.
    """
    states, widths, angular = bins.columns(states, widths, angles)
    return _components(states, np.ones(len(states)), widths, angular, 0.0)


@njit(cache=True, inline="always")
def _root(parent, k):
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@njit(_COUNTS(_ROWS, _COLUMN, _COLUMN, _FLAGS, types.float64), cache=True)
def _components(states, weights, widths, angular, least):
    """Cluster of each particle, numbered by their first particles; -1 where its bin is too light."""
    n, d = states.shape
    keys, counts = number(states, widths, angular)
    # Bins by their first particles: their keys, what they hold, and each particle's bin.
    table = empty_table(n)
    position_of = np.empty(table.size, dtype=np.int64)
    bin_of, key_of, held = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64), np.zeros(n)
    count = 0
    for i in range(n):
        at = place(table, keys[i])
        if table[at] != keys[i]:
            table[at], position_of[at], key_of[count] = keys[i], count, keys[i]
            count += 1
        bin_of[i] = position_of[at]
        held[bin_of[i]] += weights[i]
    enough = least * held[:count].max()

    # Neighbours differ by at most 1 along each column. Half of them will do: the others find this bin.
    half = 3**d // 2
    steps = np.empty((half, d), dtype=np.int64)
    for j in range(half):
        rest = 3**d - 1 - j
        for c in range(d):
            steps[j, c] = rest % 3 - 1
            rest //= 3
    parent = np.arange(count)
    # What a step of -1, 0, 1 along a column adds to a bin's key.
    added = np.zeros((d, 3), dtype=np.int64)
    for k in range(count):
        if held[k] < enough:
            continue
        rest, stride = key_of[k], 1
        for c in range(d):
            coordinate, size = rest % counts[c], counts[c]
            added[c, 0] = -stride if coordinate > 0 or not angular[c] else (size - 1) * stride
            added[c, 2] = stride if coordinate < size - 1 or not angular[c] else (1 - size) * stride
            rest //= size
            stride *= size
        for j in range(half):
            neighbour = key_of[k]
            for c in range(d):
                neighbour += added[c, steps[j, c] + 1]
            at = place(table, neighbour)
            if table[at] == neighbour and held[position_of[at]] >= enough:
                a, b = _root(parent, k), _root(parent, position_of[at])
                parent[max(a, b)] = min(a, b)

    # A root is the first bin of its cluster, so that these come in order.
    name, names = np.full(count, -1, dtype=np.int64), 0
    for k in range(count):
        if held[k] >= enough:
            root = _root(parent, k)
            if root == k:
                name[k] = names
                names += 1
            name[k] = name[root]
    cluster = np.empty(n, dtype=np.int64)
    for i in range(n):
        cluster[i] = name[bin_of[i]]
    return cluster


@njit(
    types.Tuple((_COLUMN, types.float64, _FLAGS))(_ROWS, _COLUMN, _COLUMN, _FLAGS, types.float64),
    cache=True,
)
def _heaviest(states, weights, widths, angular, least):
    n, d = states.shape
    cluster = _components(states, weights, widths, angular, least)
    held, total = np.zeros(cluster.max() + 1), 0.0
    for i in range(n):
        total += weights[i]
        if cluster[i] >= 0:
            held[cluster[i]] += weights[i]
    best = held.argmax()
    members, mean, sines = cluster == best, np.zeros(d), np.zeros(d)
    for i in range(n):
        if members[i]:
            for c in range(d):
                if angular[c]:
                    sines[c] += weights[i] * np.sin(states[i, c])
                    mean[c] += weights[i] * np.cos(states[i, c])
                else:
                    mean[c] += weights[i] * states[i, c]
    for c in range(d):
        mean[c] = np.arctan2(sines[c], mean[c]) if angular[c] else mean[c] / held[best]
    return mean, held[best] / total, members
