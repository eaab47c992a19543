"""Occupancy grids: a plane in square cells, each occupied, free or unknown.

References
----------
J. Amanatides, A. Woo, *A fast voxel traversal algorithm for ray tracing*, Eurographics 1987.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numba import njit

UNKNOWN, FREE, OCCUPIED = -1, 0, 1


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Square cells of a rectangle, which may be turned.

    Attributes
    ----------
    cells : ndarray of int8, shape (rows, columns)
        UNKNOWN, FREE or OCCUPIED. Rows go along the grid's y-axis, row 0 lowest; columns along its x-axis.
    resolution : float
        Side of a cell (m).
    origin : tuple of float
        x, y (m) of the lower left corner of the first cell, and the angle (rad) by which the grid's x-axis is turned
        counter-clockwise from the world's; 0 when left out.

    Raises
    ------
    ValueError
        The cells are not a table of those three values, or the resolution or the origin is not usable.
    """

    cells: np.ndarray
    resolution: float
    origin: tuple

    def __post_init__(self):
        cells = np.array(self.cells, dtype=np.int8, order="C")
        if cells.ndim != 2 or not cells.size or not np.isin(self.cells, (UNKNOWN, FREE, OCCUPIED)).all():
            raise ValueError("cells must be a table of -1 (unknown), 0 (free) and 1 (occupied)")
        if not (self.resolution > 0.0 and np.isfinite(self.resolution)):
            raise ValueError(f"resolution = {self.resolution} must be positive and finite")
        origin = tuple(float(value) for value in self.origin)
        if len(origin) not in (2, 3) or not np.isfinite(origin).all():
            raise ValueError(f"origin = {self.origin} must be two or three finite numbers: x, y and, if any, an angle")
        cells.flags.writeable = False
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "origin", (*origin, 0.0)[:3])

    def to_grid(self, points):
        """World points in units of cells: column and row as real numbers.

        Parameters
        ----------
        points : array_like, shape (..., 2)
            x, y in the world (m).

        Returns
        -------
        ndarray, shape (..., 2)
            Along the grid's x- and y-axis; cell (i, j) is [j, j + 1) x [i, i + 1).
        """
        return (np.asarray(points, dtype=float) - self.origin[:2]) @ self._turn / self.resolution

    def to_world(self, coordinates):
        """The inverse of `to_grid`."""
        return np.asarray(coordinates, dtype=float) * self.resolution @ self._turn.T + self.origin[:2]

    def cells_of(self, points):
        """Cells that hold points.

        Parameters
        ----------
        points : array_like, shape (..., 2)
            x, y in the world (m).

        Returns
        -------
        ndarray of int, shape (..., 2)
            Row and column, which may lie outside the grid.
        """
        return np.floor(self.to_grid(points)).astype(int)[..., ::-1]

    def centres_of(self, cells):
        """Centres of cells: the counterpart of `cells_of`.

        Parameters
        ----------
        cells : array_like of int, shape (..., 2)
            Row and column.

        Returns
        -------
        ndarray, shape (..., 2)
            x, y in the world (m).
        """
        return self.to_world(np.asarray(cells)[..., ::-1] + 0.5)

    def look_up(self, table, points, outside):
        """Values of a table with one entry a cell, at points.

        Parameters
        ----------
        table : ndarray, shape (rows, columns)
            `cells`, `distances()`, or whatever else goes with this grid.
        points : array_like, shape (..., 2)
            x, y in the world (m).
        outside : scalar
            The value of points outside the grid.

        Returns
        -------
        ndarray, shape (...)
        """
        row, column = np.moveaxis(self.cells_of(points), -1, 0)
        rows, columns = self.cells.shape
        within = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.where(within, table[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)], outside)

    def distances(self):
        """Distance from the centre of each cell to the centre of the nearest occupied one.

        Returns
        -------
        ndarray, shape (rows, columns)
            Metres; `inf` throughout when no cell is occupied.
        """
        # Only here: it takes longer to import than all the rest.
        from scipy.ndimage import distance_transform_edt

        occupied = self.cells == OCCUPIED
        if not occupied.any():
            return np.full(occupied.shape, np.inf)
        return distance_transform_edt(~occupied) * self.resolution

    def rings(self, *kinds):
        """Outlines of all cells of certain kinds, for `polygons.walls`: by the even-odd rule they hold these cells.

        The rings of FREE make a room and its obstacles: `room, *obstacles = grid.rings(FREE)`.

        Parameters
        ----------
        kinds : int
            One or more of UNKNOWN, FREE, OCCUPIED; OCCUPIED when left out.

        Returns
        -------
        tuple of tuple of (float, float)
            Vertices (m) of each ring, of which the last is not the first again and none lies between its neighbours on
            a line. The ring that encloses the largest area comes first.
        """
        rows, columns = np.nonzero(np.isin(self.cells, kinds or (OCCUPIED,)))
        if not len(rows):
            return ()
        # Whole numbers, so that the union is exact.
        squares = shapely.box(columns, rows, columns + 1, rows + 1)
        shapes = shapely.get_parts(shapely.coverage_union_all(squares))
        rings = shapely.get_rings(shapes)
        rings = rings[np.argsort(-shapely.area(shapely.polygons(rings)), kind="stable")]
        corners = (self.to_world(_corners(shapely.get_coordinates(ring)[:-1])) for ring in rings)
        return tuple(tuple(map(tuple, vertices.tolist())) for vertices in corners)

    def cast(self, origins, angles, limit=np.inf, kinds=(OCCUPIED,)):
        """Ranges along rays to the first cell of certain kinds, exactly.

        Cells are closed squares: a ray that touches a side or a corner has met it. In cells of other kinds this is what
        `raycast.cast` says of the walls of `rings(*kinds)`.

        Parameters
        ----------
        origins : array_like, shape (N, 2)
            x, y (m).
        angles : array_like, shape (N, B)
            Directions in the world (rad).
        limit : float
            The largest range (m).
        kinds : sequence of int
            What stops a ray.

        Returns
        -------
        ndarray, shape (N, B)
            Metres; 0 from within such a cell, `inf` where there is none within `limit`.
        """
        angles = np.asarray(angles, dtype=float) - self.origin[2]
        stops = np.isin(self.cells, kinds)
        return _cast(self.to_grid(origins), angles, stops, limit / self.resolution) * self.resolution

    @property
    def _turn(self):
        cos, sin = np.cos(self.origin[2]), np.sin(self.origin[2])
        return np.array([[cos, -sin], [sin, cos]])


def _corners(ring):
    """The vertices at which a ring turns."""
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    return ring[before[:, 0] * after[:, 1] != before[:, 1] * after[:, 0]]


@njit(cache=True)
def _range(x, y, dx, dy, stops, limit):
    """Range of one ray, in units of cells: from cell to cell, over whichever grid line is nearer."""
    rows, columns = stops.shape
    on_column, on_row = x == np.floor(x), y == np.floor(y)
    if _met(stops, int(np.floor(y)), int(np.floor(x)), on_row, on_column):
        return 0.0
    # The cell the ray goes into, and whether it runs along a grid line, so that it touches the cells on both sides.
    column = int(np.ceil(x)) - 1 if dx < 0.0 else int(np.floor(x))
    row = int(np.ceil(y)) - 1 if dy < 0.0 else int(np.floor(y))
    along_column, along_row = on_column and dx == 0.0, on_row and dy == 0.0
    while not (_leaves(column, dx, columns) or _leaves(row, dy, rows)):
        # From the origin each time: adding up the distances between lines would add up their rounding.
        to_column = (column + (dx > 0.0) - x) / dx if dx != 0.0 else np.inf
        to_row = (row + (dy > 0.0) - y) / dy if dy != 0.0 else np.inf
        distance = min(to_column, to_row)
        if distance > limit:
            return np.inf
        next_column, next_row = column, row
        if to_column <= to_row:
            next_column += 1 if dx > 0.0 else -1
        if to_row <= to_column:
            next_row += 1 if dy > 0.0 else -1
        if _met(stops, next_row, next_column, along_row, along_column):
            return distance
        # Through a corner: the two cells beside the ray have it, too.
        if to_column == to_row and (
            _met(stops, row, next_column, False, False) or _met(stops, next_row, column, False, False)
        ):
            return distance
        column, row = next_column, next_row
    return np.inf


@njit(cache=True)
def _leaves(index, direction, count):
    return (direction > 0.0 and index >= count) or (direction < 0.0 and index < 0)


@njit(cache=True)
def _met(stops, row, column, below, left):
    """Whether a cell stops rays, or the ones below and to the left of it where they count."""
    rows, columns = stops.shape
    for i in range(row - below, row + 1):
        for j in range(column - left, column + 1):
            if 0 <= i < rows and 0 <= j < columns and stops[i, j]:
                return True
    return False


@njit("float64[:,::1](float64[:,:], float64[:,:], boolean[:,::1], float64)", cache=True)
def _cast(origins, angles, stops, limit):
    """Ranges in units of cells."""
    ranges = np.empty(angles.shape)
    for n in range(angles.shape[0]):
        for b in range(angles.shape[1]):
            dx, dy = np.cos(angles[n, b]), np.sin(angles[n, b])
            # cos(π/2) is 6e-17: a ray meant to run along a grid line has to stay on it.
            dx, dy = dx if abs(dx) > 1e-15 else 0.0, dy if abs(dy) > 1e-15 else 0.0
            ranges[n, b] = _range(origins[n, 0], origins[n, 1], dx, dy, stops, limit)
    return ranges
