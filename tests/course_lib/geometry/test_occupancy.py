"""Occupancy grids: coordinates, distances, outlines, and rays that agree with those cast at the outlines."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from course_lib.geometry import raycast
from course_lib.geometry.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from course_lib.geometry.polygons import inside, walls


def random_grid(rng, turned=True):
    cells = rng.choice([UNKNOWN, FREE, OCCUPIED], p=[0.1, 0.7, 0.2], size=rng.integers(1, 12, size=2))
    origin = rng.uniform(-3.0, 3.0, size=3) * (1.0, 1.0, turned)
    return OccupancyGrid(cells.astype(np.int8), rng.uniform(0.05, 2.0), origin)


def distances_to_walls(origins, angles, walls):
    """Ranges by cross products, all rays against all walls: p + r d = a + s (b - a), 0 <= s <= 1."""
    d = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[..., None, :]
    a, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    to_a = a - origins[:, None, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = d[..., 0] * along[:, 1] - d[..., 1] * along[:, 0]
        r = (to_a[..., 0] * along[:, 1] - to_a[..., 1] * along[:, 0]) / cross
        s = (to_a[..., 0] * d[..., 1] - to_a[..., 1] * d[..., 0]) / cross
        return np.where((cross != 0.0) & (r >= 0.0) & (s >= 0.0) & (s <= 1.0), r, np.inf).min(axis=-1, initial=np.inf)


def test_cells_and_points_on_a_turned_grid():
    grid = OccupancyGrid(np.zeros((2, 3)), 0.5, (1.0, 2.0, np.pi / 2))
    # The grid's x-axis points along the world's y-axis.
    np.testing.assert_array_equal(grid.cells_of([[0.9, 3.2], [0.4, 2.1], [1.1, 2.1]]), [[0, 2], [1, 0], [-1, 0]])
    np.testing.assert_allclose(grid.centres_of([[0, 2], [1, 0]]), [[0.75, 3.25], [0.25, 2.25]])
    np.testing.assert_allclose(grid.to_grid(grid.to_world([[0.3, 1.7]])), [[0.3, 1.7]])
    np.testing.assert_array_equal(grid.look_up(grid.cells, [[0.9, 3.2], [1.1, 2.1]], UNKNOWN), [FREE, UNKNOWN])


@pytest.mark.parametrize(
    "cells, resolution, origin, message",
    [
        ([[0, 2]], 0.1, (0, 0), "cells must be a table"),
        ([0, 1], 0.1, (0, 0), "cells must be a table"),
        ([[0.5]], 0.1, (0, 0), "cells must be a table"),
        ([[0]], 0.0, (0, 0), "resolution = 0.0"),
        ([[0]], 0.1, (0, np.nan), "origin"),
        ([[0]], 0.1, (0,), "origin"),
    ],
)
def test_what_is_not_a_grid(cells, resolution, origin, message):
    with pytest.raises(ValueError, match=message):
        OccupancyGrid(np.array(cells), resolution, origin)


def test_distances_agree_with_all_pairs():
    grid = random_grid(np.random.default_rng(3))
    rows, columns = grid.cells.shape
    centres = grid.centres_of(np.stack(np.mgrid[:rows, :columns], axis=-1))
    occupied = centres[grid.cells == OCCUPIED]
    expected = np.linalg.norm(centres[:, :, None] - occupied, axis=-1).min(axis=-1)
    np.testing.assert_allclose(grid.distances(), expected, atol=1e-12)
    assert (OccupancyGrid(np.zeros((2, 2)), 0.1, (0, 0)).distances() == np.inf).all()


def test_rings_of_a_room_with_a_table():
    cells = np.ones((5, 6))
    cells[1:4, 1:5] = FREE
    cells[2, 2] = OCCUPIED
    room, table = OccupancyGrid(cells, 0.5, (0.0, 0.0)).rings(FREE)
    assert set(room) == {(0.5, 0.5), (2.5, 0.5), (2.5, 2.0), (0.5, 2.0)}
    assert set(table) == {(1.0, 1.0), (1.5, 1.0), (1.5, 1.5), (1.0, 1.5)}
    assert OccupancyGrid(np.zeros((2, 2)), 0.5, (0.0, 0.0)).rings() == ()


@given(st.integers(0, 2**32 - 1))
def test_rings_hold_the_cells_they_are_of(seed):
    grid = random_grid(np.random.default_rng(seed))
    rows, columns = grid.cells.shape
    centres = np.ascontiguousarray(grid.centres_of(np.stack(np.mgrid[:rows, :columns], axis=-1)).reshape(-1, 2))
    for kinds in ((OCCUPIED,), (OCCUPIED, UNKNOWN), (FREE,)):
        held = inside(centres, walls(grid.rings(*kinds)))
        np.testing.assert_array_equal(held, np.isin(grid.cells, kinds).ravel())


@given(st.integers(0, 2**32 - 1))
def test_rays_agree_with_those_cast_at_the_walls_of_the_rings(seed):
    rng = np.random.default_rng(seed)
    grid = random_grid(rng)
    kinds = ((OCCUPIED,), (OCCUPIED, UNKNOWN))[seed % 2]
    rows, columns = grid.cells.shape
    # Also from without, and not from within what stops rays: there a wall is met on leaving.
    origins = grid.to_world(rng.uniform(-2.0, (columns + 2.0, rows + 2.0), size=(30, 2)))
    origins = origins[~np.isin(grid.look_up(grid.cells, origins, FREE), kinds)]
    angles = rng.uniform(-7.0, 7.0, size=(len(origins), 8))
    outline = walls(grid.rings(*kinds))
    expected = distances_to_walls(origins, angles, outline)
    np.testing.assert_allclose(grid.cast(origins, angles, kinds=kinds), expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(raycast.cast(origins, angles, outline), expected, rtol=0, atol=1e-9)
    limited = grid.cast(origins, angles, limit=1.0, kinds=kinds)
    np.testing.assert_allclose(limited, np.where(expected <= 1.0, expected, np.inf), rtol=0, atol=1e-9)


def test_rays_agree_with_shapely():
    grid = random_grid(np.random.default_rng(8), turned=False)
    rows, columns = np.nonzero(grid.cells == OCCUPIED)
    corners = grid.to_world(np.stack([columns, rows], axis=-1))
    squares = shapely.union_all(shapely.box(*corners.T, *(corners + grid.resolution).T))
    origins = grid.centres_of(np.argwhere(grid.cells != OCCUPIED)) + 0.123 * grid.resolution
    angles = np.tile(np.arange(0.05, 6.2, 0.3), (len(origins), 1))
    ends = origins[:, None] + 100.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    starts = np.broadcast_to(origins[:, None], ends.shape)
    seen = shapely.intersection(shapely.linestrings(np.stack([starts, ends], axis=2)), squares)
    expected = shapely.distance(shapely.points(starts), seen)
    expected = np.where(np.isnan(expected), np.inf, expected)
    np.testing.assert_allclose(grid.cast(origins, angles), expected, rtol=0, atol=1e-9)


def test_rays_that_touch():
    """One occupied cell, [1, 2] x [1, 2], in a grid of 3 x 3 and a margin: closed, so touching it is meeting it."""
    cells = np.zeros((3, 3))
    cells[1, 1] = OCCUPIED
    grid = OccupancyGrid(cells, 1.0, (0.0, 0.0))

    def one(x, y, angle):
        return grid.cast([[x, y]], [[angle]])[0, 0]

    assert one(0.5, 1.0, 0.0) == 0.5 and one(0.5, 2.0, 0.0) == 0.5  # along its lower and its upper side
    assert one(-1.0, 1.0, 0.0) == 2.0 and one(4.0, 1.5, 3.0 * np.pi) == pytest.approx(2.0)
    assert one(1.5, 1.5, 0.3) == 0.0 and one(2.0, 2.0, 0.3) == 0.0 and one(1.0, 1.2, 3.0) == 0.0
    assert one(0.5, 0.9, 0.0) == np.inf and one(2.5, 1.5, 0.0) == np.inf
    at_corner = OccupancyGrid(np.array([[1, 0], [0, 0]]), 1.0, (0.0, 0.0))
    # From (1, 3) down along x = 1, the side of the only occupied cell.
    assert at_corner.cast([[1.0, 3.0]], [[-np.pi / 2]])[0, 0] == pytest.approx(2.0)
