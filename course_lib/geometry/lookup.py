"""Ranges read from a table: the nearest of many poses that were cast before.

Its error is of two kinds. Where neighbouring poses see the same wall it shrinks with the cells: about half a cell, and
half a step of direction times the range, more if the ray is slanted to the wall. At a silhouette edge, where a ray just
misses a corner, the range jumps from the corner to whatever is behind; a cell with poses on both sides has one number
for both, and is wrong by the whole jump for some of them. Smaller cells make such poses rarer, not their error smaller:
no resolution bounds the worst case. `measured_error` says how much of either there is on a map;
`python -m tests.benchmarks raycasting` prints it for the DR20's. Interpolation is left out: it shrinks the first kind
only, and at an edge invents ranges at which there is nothing.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from course_lib.geometry.raycast import cast_fan, finite_rows

_FULL_TURN = 2.0 * math.pi

#: Cells that are cast at a time: in float64 they take twice the room they have in the table.
_BATCH = 4096


class RangeTable(NamedTuple):
    """Ranges from the centres of square cells in evenly spaced directions.

    Attributes
    ----------
    ranges : ndarray, shape (nx, ny, K), float32
        Metres; inf where there is nothing. Direction k is at the angle 2πk / K from the x-axis. Half the memory of
        float64, and a precision far beyond the error.
    origin : tuple of float
        x and y of the corner of cell (0, 0), in metres.
    cell : float
        Side of a cell, in metres.
    """

    ranges: np.ndarray
    origin: tuple
    cell: float


class TableError(NamedTuple):
    """How far looked-up ranges are from the exact ones.

    Attributes
    ----------
    share_off : float
        Part of the rays that are off by more than the tolerance.
    median, q90, q99, worst : float
        Quantiles of the absolute error, in metres; inf where one of the two ranges is inf and the other is not.
    """

    share_off: float
    median: float
    q90: float
    q99: float
    worst: float


def build(walls, cell=0.05, directions=180, limit=np.inf, parallel=False):
    """Cast the table of a map.

    Parameters
    ----------
    walls : ndarray, shape (S, 4)
        As of `raycast.cast`, at least one. The cells cover all of them.
    cell : float
        Side of a cell, in metres.
    directions : int
        Directions on the full turn. A multiple of 4 holds those along the axes.
    limit, parallel
        As of `raycast.cast_fan`.

    Returns
    -------
    RangeTable

    Raises
    ------
    ValueError
        If there are no walls, `cell` is not positive or there is no direction.
    """
    walls = np.asarray(walls, dtype=np.float64)
    if not (walls.size and cell > 0.0 and directions >= 1):
        raise ValueError(f"a table needs walls ({walls.size // 4}), a cell > 0 ({cell}), a direction ({directions})")
    low, high = walls.reshape(-1, 2).min(axis=0), walls.reshape(-1, 2).max(axis=0)
    nx, ny = (int(n) for n in np.maximum(1, np.ceil((high - low) / cell - 1e-9)))
    cells = np.indices((nx, ny)).reshape(2, -1).T
    poses = np.column_stack([low + cell * (cells + 0.5), np.zeros(nx * ny)])
    bearings = _FULL_TURN / directions * np.arange(directions)
    ranges = np.empty((nx * ny, directions), dtype=np.float32)
    for start in range(0, nx * ny, _BATCH):
        batch = slice(start, start + _BATCH)
        ranges[batch] = cast_fan(poses[batch], bearings, walls, limit, parallel)
    ranges = ranges.reshape(nx, ny, directions)
    return RangeTable(ranges, (float(low[0]), float(low[1])), float(cell))


def look_up(table, poses, bearings):
    """Ranges of the nearest cells and directions.

    Parameters
    ----------
    table : RangeTable
    poses : ndarray, shape (N, 3)
        x, y, heading: metres and radians, finite. A pose off the table is read at its border.
    bearings : ndarray, shape (B,)
        Directions of the rays from the heading, in radians.

    Returns
    -------
    ndarray, shape (N, B)

    Raises
    ------
    ValueError
        If a shape does not fit or a number is not finite.
    """
    poses, bearings = finite_rows(poses, 3, "poses"), finite_rows([bearings], None, "bearings")[0]
    ranges = np.empty((len(poses), len(bearings)))
    _look_up(poses, bearings, table.ranges, *table.origin, table.cell, ranges)
    return ranges


@njit(
    "void(float64[:, ::1], float64[::1], float32[:, :, ::1], float64, float64, float64, float64[:, ::1])",
    error_model="numpy",
    cache=True,
)
def _look_up(poses, bearings, table, x_0, y_0, cell, ranges):
    nx, ny, directions = table.shape
    per_cell, per_radian = 1.0 / cell, directions / _FULL_TURN
    for n in range(len(poses)):
        i = min(max(int((poses[n, 0] - x_0) * per_cell), 0), nx - 1)
        j = min(max(int((poses[n, 1] - y_0) * per_cell), 0), ny - 1)
        for k in range(len(bearings)):
            direction = int(math.floor((poses[n, 2] + bearings[k]) * per_radian + 0.5)) % directions
            ranges[n, k] = table[i, j, direction]


def measured_error(table, walls, poses, bearings, limit=np.inf, tolerance=0.01):
    """Compare a table with exact ray casting.

    Parameters
    ----------
    table : RangeTable
    walls, limit
        What it was built with.
    poses : ndarray, shape (N, 3)
        Where to compare: random free poses of the map, for instance.
    bearings : ndarray, shape (B,)
    tolerance : float
        Metres from which on a ray is off.

    Returns
    -------
    TableError
    """
    exact, found = cast_fan(poses, bearings, walls, limit), look_up(table, poses, bearings)
    error = np.zeros_like(exact)
    differs = exact != found
    error[differs] = np.abs(found[differs] - exact[differs])
    quantiles = np.quantile(error, [0.5, 0.9, 0.99, 1.0], method="higher")
    return TableError(float(np.mean(error > tolerance)), *(float(q) for q in quantiles))
