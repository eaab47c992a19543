"""The table of ranges, and what is said of its error."""

import numpy as np
import pytest

from course_lib.geometry.lookup import RangeTable, build, look_up, measured_error
from course_lib.geometry.polygons import walls as walls_of
from course_lib.geometry.raycast import cast_fan

BEARINGS = np.radians([-90.0, -45.0, 0.0, 45.0, 90.0])
ROOM = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]
PILLAR = [(1.9, 1.4), (2.1, 1.4), (2.1, 1.6), (1.9, 1.6)]


def poses_in_room(rng, n):
    return np.column_stack([rng.uniform(0.0, 4.0, n), rng.uniform(0.0, 3.0, n), rng.uniform(-9.0, 9.0, n)])


def nearest(table, poses, bearings):
    """`look_up`, in NumPy."""
    nx, ny, directions = table.ranges.shape
    i = np.clip(np.floor((poses[:, 0] - table.origin[0]) / table.cell), 0, nx - 1).astype(int)
    j = np.clip(np.floor((poses[:, 1] - table.origin[1]) / table.cell), 0, ny - 1).astype(int)
    turns = (poses[:, 2:] + bearings) / (2.0 * np.pi)
    k = np.round(turns * directions).astype(int) % directions
    return table.ranges[i[:, None], j[:, None], k].astype(float)


def test_is_exact_at_the_centres_of_its_cells():
    walls = walls_of([ROOM, PILLAR])
    table = build(walls, cell=0.5, directions=8)
    assert table.ranges.shape == (8, 6, 8)
    x, y = np.meshgrid(0.25 + 0.5 * np.arange(8), 0.25 + 0.5 * np.arange(6), indexing="ij")
    for heading in (0.0, np.pi / 2, -np.pi, 3 * np.pi):
        poses = np.column_stack([x.ravel(), y.ravel(), np.full(48, heading)])
        exact = cast_fan(poses, BEARINGS, walls)
        assert np.allclose(look_up(table, poses, BEARINGS), exact, rtol=1e-6, atol=0)


def test_agrees_with_the_twin_on_the_table_and_beside_it():
    rng = np.random.default_rng(1)
    table = build(walls_of([ROOM, PILLAR]), cell=0.3, directions=7, limit=2.5)
    poses = poses_in_room(rng, 500) * [1.5, 1.5, 1.0] - [1.0, 1.0, 0.0]
    assert np.array_equal(look_up(table, poses, BEARINGS), nearest(table, poses, BEARINGS))


def test_the_error_shrinks_with_the_cells_except_at_edges():
    rng = np.random.default_rng(2)
    poses = poses_in_room(rng, 4000)
    poses = poses[np.abs(poses[:, :2] - [2.0, 1.5]).max(axis=1) > 0.1]
    walls = walls_of([ROOM, PILLAR])
    coarse, fine = (
        measured_error(build(walls, cell, directions), walls, poses, BEARINGS)
        for cell, directions in ((0.1, 90), (0.025, 360))
    )
    assert fine.median < coarse.median / 3
    assert fine.share_off < coarse.share_off
    assert coarse.median < coarse.q90 < coarse.q99 < coarse.worst
    # The pillar hides more than a metre of range from some pose beside the line of sight, at any resolution.
    assert fine.worst > 1.0


def test_the_error_of_a_table_that_is_off_by_a_known_amount():
    walls = walls_of([ROOM])
    # One cell per wall's distance: from the middle, headings at multiples of 90°, nothing is rounded.
    table = build(walls, cell=1.0, directions=4)
    poses = np.array([[0.5, 0.5, 0.0], [2.5, 1.5, np.pi / 2]])
    bearings = np.array([0.0, np.pi / 2])
    assert measured_error(table, walls, poses, bearings) == (0.0, 0.0, 0.0, 0.0, 0.0)
    off = RangeTable(table.ranges + np.float32(0.25), table.origin, table.cell)
    assert measured_error(off, walls, poses, bearings) == (1.0, 0.25, 0.25, 0.25, 0.25)
    # A wall at one and none at the other is infinitely wrong, none at both is right.
    assert measured_error(table, walls, poses, bearings, limit=3.0)[:2] == (0.25, 0.0)
    assert measured_error(table, walls, poses, bearings, limit=3.0).worst == np.inf
    assert measured_error(build(walls, 1.0, 4, limit=3.0), walls, poses, bearings, limit=3.0).worst == 0.0


@pytest.mark.parametrize(("cell", "directions"), [(0.0, 8), (-1.0, 8), (0.1, 0), (np.nan, 8)])
def test_says_what_it_cannot_build(cell, directions):
    with pytest.raises(ValueError, match="a table needs"):
        build(walls_of([ROOM]), cell, directions)
    with pytest.raises(ValueError, match="walls"):
        build(np.empty((0, 4)))


def test_says_what_it_cannot_look_up():
    table = build(walls_of([ROOM]), 1.0, 4)
    with pytest.raises(ValueError, match=r"poses: shape \(2, 2\)"):
        look_up(table, np.zeros((2, 2)), BEARINGS)
