"""Scans of a laser scanner as a map, and how likely a scan is in one.

References
----------
S. Thrun, W. Burgard, D. Fox, *Probabilistic Robotics*, MIT Press 2005: the likelihood field (table 6.3), the map of
reflections (section 9.4).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from course_lib.geometry.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


class ScanField(NamedTuple):
    """A map and how likely a beam is to end in each of its cells.

    Attributes
    ----------
    grid : OccupancyGrid
    log_likelihood : ndarray, shape (rows + 1, columns + 1)
        Of one beam; the last row and column are for what is outside.
    """

    grid: OccupancyGrid
    log_likelihood: np.ndarray


def laps(corrected):
    """The lap each scan belongs to.

    The corridors go around a block of rooms. A lap is a turn around the middle of what the robot drove through, in the
    direction of the first; later ones count as one, for visits to rooms and ways back are no turns.

    Parameters
    ----------
    corrected : ndarray, shape (M, 3)

    Returns
    -------
    ndarray of int, shape (M,)
        1 or 2; 3 from the end of the second turn on.
    """
    positions = corrected[:, :2] - 0.5 * (corrected[:, :2].min(axis=0) + corrected[:, :2].max(axis=0))
    bearing = np.unwrap(np.arctan2(positions[:, 1], positions[:, 0]))
    turns = np.abs(bearing - bearing[0]) / (2.0 * np.pi)
    return 1 + np.minimum(np.floor(np.maximum.accumulate(turns)), 2).astype(int)


def ends(poses, ranges, bearings):
    """Where beams end.

    Parameters
    ----------
    poses : ndarray, shape (M, 3)
    ranges : ndarray, shape (M, B)
        `inf` where nothing came back.
    bearings : ndarray, shape (B,)

    Returns
    -------
    points : ndarray, shape (K, 2)
        Ends of the K finite beams (m).
    rows : ndarray of int, shape (K,)
        The pose of each.
    """
    rows, beams = np.nonzero(np.isfinite(ranges))
    angles = poses[rows, 2] + bearings[beams]
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return poses[rows, :2] + ranges[rows, beams, None] * directions, rows


def build_map(poses, ranges, bearings, resolution=0.05, reflecting=0.3, margin=1.0):
    """A map of how often beams are reflected.

    A cell is occupied if, of the beams that reached it, the share that ended in it is large enough; free if beams went
    through it; otherwise unknown. Beams that never came back say nothing.

    Parameters
    ----------
    poses : ndarray, shape (M, 3)
        Of the scanner: x, y (m), heading (rad).
    ranges : ndarray, shape (M, B)
        Metres.
    bearings : ndarray, shape (B,)
        Radians.
    resolution : float
        Side of a cell (m).
    reflecting : float
        The least share.
    margin : float
        Unknown land around what was reached (m).

    Returns
    -------
    OccupancyGrid
    """
    points, rows = ends(poses, ranges, bearings)
    low = np.minimum(points.min(axis=0), poses[:, :2].min(axis=0)) - margin
    high = np.maximum(points.max(axis=0), poses[:, :2].max(axis=0)) + margin
    columns, lines = np.ceil((high - low) / resolution).astype(int)
    hits, passes = tally((poses[rows, :2] - low) / resolution, (points - low) / resolution, lines, columns)
    reached = hits + passes
    occupied = hits > reflecting * reached
    cells = np.where(occupied, OCCUPIED, np.where(reached > 0, FREE, UNKNOWN))
    return OccupancyGrid(cells, resolution, tuple(low))


@njit("Tuple((int64[:,::1], int64[:,::1]))(float64[:,::1], float64[:,::1], int64, int64)", cache=True)
def tally(starts, ends, rows, columns):
    """How many rays end in each cell, and how many go through it.

    Parameters
    ----------
    starts, ends : ndarray, shape (K, 2)
        x, y in units of cells, within the grid.
    rows, columns : int
        Of the grid.

    Returns
    -------
    hits, passes : ndarray of int, shape (rows, columns)
    """
    hits, passes = np.zeros((rows, columns), dtype=np.int64), np.zeros((rows, columns), dtype=np.int64)
    for k in range(len(starts)):
        x, y = starts[k]
        dx, dy = ends[k, 0] - x, ends[k, 1] - y
        column, row = int(np.floor(x)), int(np.floor(y))
        last_column, last_row = int(np.floor(ends[k, 0])), int(np.floor(ends[k, 1]))
        # As many steps as grid lines lie between: rounding cannot make the ray miss its last cell.
        for _ in range(abs(last_column - column) + abs(last_row - row)):
            passes[row, column] += 1
            to_column = (column + (dx > 0.0) - x) / dx if column != last_column else np.inf
            to_row = (row + (dy > 0.0) - y) / dy if row != last_row else np.inf
            if to_column < to_row:
                column += 1 if dx > 0.0 else -1
            else:
                row += 1 if dy > 0.0 else -1
        hits[row, column] += 1
    return hits, passes


def likelihood_field(grid, sigma=0.1, p_hit=0.5, reach=30.0):
    """How likely a beam is to end in each cell.

    It ends near something occupied, or anywhere: p = p_hit N(d; 0, σ²) + (1 - p_hit) / reach with d the distance to the
    nearest occupied cell. Of unknown land p is 1 / reach at least, for nothing is known against it.

    Parameters
    ----------
    grid : OccupancyGrid
    sigma : float
        Of the scanner, the map and its cells together (m).
    p_hit : float
        Share of beams that the map explains.
    reach : float
        Largest range (m).

    Returns
    -------
    ScanField
    """
    distances = grid.distances()
    density = np.exp(-0.5 * (distances / sigma) ** 2) / (np.sqrt(2.0 * np.pi) * sigma)
    likelihood = p_hit * density + (1.0 - p_hit) / reach
    likelihood = np.where(grid.cells == UNKNOWN, np.maximum(likelihood, 1.0 / reach), likelihood)
    return ScanField(grid, np.log(np.pad(likelihood, (0, 1), constant_values=1.0 / reach)))


def scan_log_likelihood(poses, ranges, bearings, field):
    """Log-likelihood of a scan, summed over its beams.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
    ranges : ndarray, shape (B,)
        Beams that did not come back (`inf`) are skipped: glass and black things return none at any distance.
    bearings : ndarray, shape (B,)
    field : ScanField

    Returns
    -------
    ndarray, shape (N,)
    """
    kept = np.isfinite(ranges)
    beams = (ranges[kept] * np.array([np.cos(bearings[kept]), np.sin(bearings[kept])])) / field.grid.resolution
    at = np.column_stack([field.grid.to_grid(poses[:, :2]), poses[:, 2] - field.grid.origin[2]])
    return _sum_over_beams(at, np.ascontiguousarray(beams), field.log_likelihood)


@njit("float64[::1](float64[:,::1], float64[:,::1], float64[:,::1])", cache=True)
def _sum_over_beams(poses, beams, table):
    rows, columns = table.shape
    sums = np.zeros(len(poses))
    for n in range(len(poses)):
        x, y, cos, sin = poses[n, 0], poses[n, 1], np.cos(poses[n, 2]), np.sin(poses[n, 2])
        for b in range(beams.shape[1]):
            column = np.floor(x + cos * beams[0, b] - sin * beams[1, b])
            row = np.floor(y + sin * beams[0, b] + cos * beams[1, b])
            if 0.0 <= column < columns and 0.0 <= row < rows:
                sums[n] += table[int(row), int(column)]
            else:
                sums[n] += table[rows - 1, columns - 1]
    return sums


def anywhere(n, grid, rng):
    """Poses drawn uniformly over the free cells, with any heading.

    Parameters
    ----------
    n : int
    grid : OccupancyGrid
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n, 3)
    """
    rows, columns = np.nonzero(grid.cells == FREE)
    drawn = rng.integers(len(rows), size=n)
    corners = np.column_stack([columns[drawn], rows[drawn]])
    return np.column_stack([grid.to_world(corners + rng.random((n, 2))), rng.uniform(-np.pi, np.pi, n)])
