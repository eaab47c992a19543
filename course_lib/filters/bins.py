"""Bins of a cloud of particles: which particles share one, and which bins are occupied.

A bin is one number, its key, so that a set of bins is a table of numbers. For kernels; `filters.adaptive` counts bins,
`filters.modes` joins them.
"""

import numpy as np
from numba import njit, types

_MOST_BINS = 2.0**62
_EMPTY = -1
_COLUMN = types.float64[::1]
_COUNTS = types.int64[::1]


def columns(states, widths, angles):
    """The arguments of `number`, checked.

    Parameters
    ----------
    states : array_like, shape (N, d)
    widths : array_like, shape (d,)
        Width of a bin along each column, positive.
    angles : sequence of int
        Columns that hold angles in radians.

    Returns
    -------
    states : ndarray, shape (N, d)
    widths : ndarray, shape (d,)
    angular : ndarray of bool, shape (d,)

    Raises
    ------
    ValueError
        There is not a positive width for each column, or there are no particles.
    """
    states = np.ascontiguousarray(states, dtype=float)
    widths = np.ascontiguousarray(widths, dtype=float)
    if states.ndim != 2 or not len(states) or widths.shape != states.shape[1:] or not widths.min() > 0.0:
        raise ValueError(f"states {states.shape} need a positive width of bin for each column, got {widths}")
    angular = np.zeros(len(widths), dtype=bool)
    angular[list(angles)] = True
    return states, widths, angular


@njit(types.Tuple((_COUNTS, _COUNTS))(types.float64[:, ::1], _COLUMN, types.boolean[::1]), cache=True)
def number(states, widths, angular):
    """The bin of each particle.

    Parameters
    ----------
    states : ndarray, shape (N, d)
    widths : ndarray, shape (d,)
        Bins begin at multiples of these. Those of an angle are narrowed until a whole number of them makes the circle.
    angular : ndarray of bool, shape (d,)
        Columns that hold angles in radians, wrapped or not.

    Returns
    -------
    keys : ndarray of int64, shape (N,)
        Σ bᵢ sᵢ of the bin's coordinates bᵢ, which start at 0, and the strides.
    counts : ndarray of int64, shape (d,)
        Coordinates along each column: the strides are s₀ = 1, sᵢ₊₁ = sᵢ · countsᵢ. Along a column that is no angle the
        first and the last are never occupied, so that every bin has both its neighbours.

    Raises
    ------
    ValueError
        A state is not finite, or there are more than 2⁶² bins between the particles.
    """
    n, d = states.shape
    keys, counts = np.zeros(n, dtype=np.int64), np.empty(d, dtype=np.int64)
    coordinates = np.empty(n)
    stride = 1.0
    for c in range(d):
        width, lowest, highest = widths[c], np.inf, -np.inf
        if angular[c]:
            # Rounding must not make an eleventh bin of 2π / (2π / 10).
            around = max(np.ceil(2.0 * np.pi / width - 1e-9), 1.0)
            width = 2.0 * np.pi / around
        for i in range(n):
            b = np.floor(states[i, c] / width)
            if not np.isfinite(b):
                raise ValueError("states must be finite to be put into bins")
            if angular[c]:
                b -= around * np.floor(b / around)
            coordinates[i] = b
            lowest, highest = min(lowest, b), max(highest, b)
        if angular[c]:
            lowest, extent = 0.0, around
        else:
            lowest, extent = lowest - 1.0, highest - lowest + 3.0
        if not stride * extent < _MOST_BINS:
            raise ValueError("widths of bins are too small for a cloud as wide as this: more than 2^62 bins")
        for i in range(n):
            keys[i] += np.int64(coordinates[i] - lowest) * np.int64(stride)
        counts[c] = np.int64(extent)
        stride *= extent
    return keys, counts


@njit(cache=True)
def empty_table(most):
    """A set of at most `most` keys, an array for `place`: three quarters of it stay free."""
    size = 2
    while size < 4 * most:
        size *= 2
    return np.full(size, _EMPTY, dtype=np.int64)


@njit(cache=True, inline="always")
def place(table, key):
    """Where a key is in the set, or where it belongs: `table[place]` is then -1 and free to be written.

    Open addressing with linear probing, from a multiplicative hash.
    """
    # 2^64 over the golden ratio spreads neighbouring keys; the high bits of the product depend on all of the key's.
    hashed = (np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)
    mask = table.size - 1
    i = np.int64(hashed) & mask
    while table[i] != _EMPTY and table[i] != key:
        i = (i + 1) & mask
    return i
