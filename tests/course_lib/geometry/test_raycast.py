"""Exact ray casting, beside NumPy and shapely, at ends, along walls and on them."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numba import njit

from course_lib.geometry.polygons import walls as walls_of
from course_lib.geometry.raycast import cast, cast_fan, fan_into
from tests.course_lib.geometry import raycast_twin

BEARINGS = np.radians([-90.0, -45.0, 0.0, 45.0, 90.0])
RIGHT_ANGLES = np.pi / 2 * np.arange(-4, 9)
seeds = st.integers(0, 2**32 - 1)


def box(x0, y0, x1, y1):
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


#: The map of the report: a room with five tables.
SHEET = walls_of(
    [
        box(0, 0, 5, 5),
        box(2, 2, 3, 3.5),
        box(2, 1, 2.5, 1.5),
        box(3, 1, 3.5, 1.5),
        box(1, 2, 1.5, 2.5),
        box(4, 4, 4.5, 4.5),
    ]
)


def lattice_walls(rng, count, axis_aligned=False):
    """Walls between points of a coarse lattice: many touch, cross, or lie on one line; a few have no length."""
    ends = rng.integers(0, 7, (count, 4)).astype(float)
    if axis_aligned:
        ends[: count // 2, 2] = ends[: count // 2, 0]
        ends[count // 2 :, 3] = ends[count // 2 :, 1]
    return ends


def random_rays(rng, n, b):
    return rng.uniform(-1.0, 7.0, (n, 2)), rng.uniform(-7.0, 7.0, (n, b))


def star(rng, corners):
    """A ring around the origin that every ray from there meets once."""
    angles = np.sort(rng.uniform(-np.pi, np.pi, corners))
    radii = rng.uniform(1.0, 5.0, corners)
    return radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


def test_the_scan_printed_in_the_report():
    pose = [[2.3297, 0.4813, np.radians(0.35)]]
    # The pose is printed to 0.01°: 0.2 mm at 2.7 m.
    assert np.allclose(cast_fan(pose, BEARINGS, SHEET), [[0.4813, 0.6849, 2.6704, 0.9539, 0.5187]], rtol=0, atol=3e-4)


def test_by_hand_in_the_map_of_the_report():
    # The first looks along the top of a table, the last along the side of one.
    poses = np.array([[1.0, 1.5, 0.0], [2.75, 1.25, np.pi / 2], [4.5, 2.75, np.pi]])
    root = np.sqrt(2.0)
    assert np.allclose(
        cast_fan(poses, BEARINGS[[0, 2, 4]], SHEET),
        [[1.5, 1.0, 0.5], [0.25, 0.75, 0.25], [1.25, 1.5, 2.75]],
        rtol=0,
        atol=1e-14,
    )
    assert np.allclose(cast_fan(poses[2:], BEARINGS[[1, 3]], SHEET), [[2.25 * root, 1.25 * root]], rtol=0, atol=1e-14)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 24, 41])
def test_agrees_with_the_twin_and_with_shapely_on_maps_that_touch(count):
    rng = np.random.default_rng([1, count])
    for _ in range(3):
        walls, (origins, angles) = lattice_walls(rng, count), random_rays(rng, 20, 6)
        ranges = cast(origins, angles, walls)
        for other in (
            raycast_twin.cast(origins, angles, walls),
            raycast_twin.cast_with_shapely(origins, angles, walls),
        ):
            assert np.array_equal(np.isinf(ranges), np.isinf(other))
            assert np.allclose(ranges, other, rtol=0, atol=1e-9)


@given(seeds)
def test_rays_along_axes_of_axis_aligned_maps_agree_with_shapely(seed):
    rng = np.random.default_rng(seed)
    walls = lattice_walls(rng, 12, axis_aligned=True)
    # Half of the origins are on the lattice: on walls, at their ends, and in line with them.
    origins = np.vstack([rng.integers(-1, 8, (6, 2)).astype(float), rng.uniform(-1.0, 7.0, (6, 2))])
    angles = np.tile(RIGHT_ANGLES, (12, 1))
    ranges = cast(origins, angles, walls)
    assert np.allclose(ranges, raycast_twin.cast(origins, angles, walls), rtol=0, atol=1e-12)
    assert np.allclose(ranges, raycast_twin.cast_with_shapely(origins, angles, walls), rtol=0, atol=1e-9)
    for heading in RIGHT_ANGLES:
        poses = np.column_stack([origins, np.full(12, heading)])
        fan = cast_fan(poses, BEARINGS[[0, 2, 4]], walls)
        assert np.allclose(fan, cast(origins, poses[:, 2:] + BEARINGS[[0, 2, 4]], walls), rtol=0, atol=1e-9)


def test_a_ray_along_a_wall_meets_its_nearest_point():
    wall = np.array([[2.0, 1.0, 4.0, 1.0]])
    for walls in (wall, wall[:, [2, 3, 0, 1]]):
        ranges = cast([[0.0, 1.0], [3.0, 1.0], [5.0, 1.0], [2.0, 1.0]], [[0.0, np.pi]] * 4, walls)
        assert np.array_equal(ranges, [[2.0, np.inf], [0.0, 0.0], [np.inf, 1.0], [0.0, 0.0]])
    upright = wall[:, [1, 0, 3, 2]]
    assert np.array_equal(cast([[1.0, 0.0]], [[np.pi / 2, -np.pi / 2]], upright), [[2.0, np.inf]])


@given(seeds)
def test_a_wall_seen_almost_end_on_is_met_between_its_ends(seed):
    rng = np.random.default_rng(seed)
    angle, near, length = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 3.0), rng.uniform(0.5, 3.0)
    along, across = (np.array([np.cos(a), np.sin(a)]) for a in (angle, angle + np.pi / 2))
    tilt = 10.0 ** rng.uniform(-17, -4)
    walls = np.concatenate([near * along - tilt * across, (near + length) * along + tilt * across])[None]
    (t,) = cast([[0.0, 0.0]], [[angle]], walls)[0]
    # With a tilt of rounding size the ray may miss the wall, and with any other it must not.
    assert near - 1e-9 <= t <= near + length + 1e-9 or (np.isinf(t) and tilt < 1e-14)


@given(seeds)
def test_an_origin_on_a_wall_has_range_nought_in_every_direction(seed):
    rng = np.random.default_rng(seed)
    walls = np.vstack([rng.uniform(0.0, 6.0, (5, 4)), lattice_walls(rng, 5)])
    parts = rng.choice([0.0, 0.5, 1.0, rng.uniform()], 10)
    origins = walls[:, :2] + parts[:, None] * (walls[:, 2:] - walls[:, :2])
    assert np.array_equal(cast(origins, rng.uniform(-4.0, 4.0, (10, 4)), walls), np.zeros((10, 4)))


@pytest.mark.parametrize("corners", [3, 4, 5, 24, 57])
def test_no_ray_slips_through_a_corner(corners):
    rng = np.random.default_rng([2, corners])
    slipped = 0
    for _ in range(30):
        shift = rng.uniform(-5.0, 5.0, 2)
        ring = star(rng, corners)
        if np.ptp(np.arctan2(ring[:, 1], ring[:, 0])) < np.pi or not _surrounds(ring):
            continue
        ring = ring + shift
        walls, offsets = walls_of([ring]), ring - shift
        exact = np.arctan2(offsets[:, 1], offsets[:, 0])
        angles = np.concatenate([exact, np.nextafter(exact, 9.0), np.nextafter(exact, -9.0)])
        ranges = cast(shift[None], angles[None], walls)[0]
        assert np.allclose(ranges, np.tile(np.hypot(*offsets.T), 3), rtol=0, atol=1e-6)
        slipped += np.isinf(raycast_twin.naive(shift[None], angles[None], walls)).sum()
        # From elsewhere inside, too, a ray to a corner ends there or before.
        origin = shift + 0.1 * rng.standard_normal(2)
        offsets = ring - origin
        t = cast_fan([[*origin, 0.3]], np.arctan2(offsets[:, 1], offsets[:, 0]) - 0.3, walls)
        assert np.isfinite(t).all() or not _surrounds(offsets)
    if corners == 57:
        assert slipped > 0


def _surrounds(ring):
    """Whether no gap between neighbouring corners, seen from (0, 0), is half a turn or more, and they go round once."""
    angles = np.arctan2(ring[:, 1], ring[:, 0])
    gaps = np.diff(np.unwrap(np.append(angles, angles[0])))
    return abs(abs(gaps.sum()) - 2 * np.pi) < 1e-6


@given(seeds)
def test_turning_and_shifting_everything_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    walls, (origins, angles) = rng.uniform(0.0, 6.0, (9, 4)), random_rays(rng, 8, 5)
    turn, shift = rng.uniform(-np.pi, np.pi), rng.uniform(-10.0, 10.0, 2)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])

    def moved(points):
        return points @ rotation.T + shift

    before = cast(origins, angles, walls)
    after = cast(moved(origins), angles + turn, moved(walls.reshape(-1, 2)).reshape(-1, 4))
    # A few in a million random rays pass so near to an end that rounding decides; the examples are fixed and have none.
    assert np.allclose(before, after, rtol=1e-8, atol=1e-8)


@given(seeds)
def test_a_wall_in_two_parts_is_the_same_wall(seed):
    rng = np.random.default_rng(seed)
    walls, (origins, angles) = lattice_walls(rng, 9), random_rays(rng, 8, 5)
    middle = walls[:, :2] + rng.uniform(0.0, 1.0, (9, 1)) * (walls[:, 2:] - walls[:, :2])
    parts = np.vstack([np.hstack([walls[:, :2], middle]), np.hstack([middle, walls[:, 2:]])])
    assert np.allclose(cast(origins, angles, walls), cast(origins, angles, parts), rtol=1e-9, atol=1e-9)


coordinates = st.integers(-8, 8).map(lambda n: n / 2)
segments = st.lists(st.tuples(*4 * [coordinates]), max_size=9).map(lambda rows: np.reshape(rows, (-1, 4)))


@given(segments, segments, st.tuples(coordinates, coordinates), st.floats(-7.0, 7.0))
@example(np.empty((0, 4)), np.zeros((1, 4)), (0.0, 0.0), 0.0)
def test_more_walls_never_lengthen_a_ray_and_their_order_does_not_matter(some, others, origin, angle):
    origin, angles = [origin], angle + np.pi / 4 * np.arange(8)[None]
    ranges = cast(origin, angles, np.vstack([some, others]))
    assert np.array_equal(ranges, np.minimum(cast(origin, angles, some), cast(origin, angles, others)))
    assert np.array_equal(ranges, cast(origin, angles, np.vstack([others, some])[::-1]))
    assert (ranges >= 0.0).all()


def test_nothing_there_and_nothing_within_the_limit():
    assert np.isinf(cast_fan(np.zeros((3, 3)), BEARINGS, np.empty((0, 4)))).all()
    assert cast_fan(np.empty((0, 3)), BEARINGS, SHEET).shape == (0, 5)
    wall = np.array([[2.0, -1.0, 2.0, 1.0]])
    assert cast([[0.0, 0.0]], [[0.0]], wall, limit=2.0) == 2.0
    assert np.isinf(cast([[0.0, 0.0]], [[0.0]], wall, limit=np.nextafter(2.0, 0.0)))
    in_line = np.array([[2.0, 0.0, 4.0, 0.0]])
    assert cast([[0.0, 0.0]], [[0.0]], in_line, limit=2.0) == 2.0
    assert np.isinf(cast([[0.0, 0.0]], [[0.0]], in_line, limit=1.9))


def test_threads_change_nothing():
    rng = np.random.default_rng(3)
    poses = np.column_stack([rng.uniform(0.0, 5.0, (1300, 2)), rng.uniform(-np.pi, np.pi, 1300)])
    one, many = (cast_fan(poses, BEARINGS, SHEET, 3.0, parallel) for parallel in (False, True))
    assert np.array_equal(one, many)


def test_in_another_kernel():
    @njit
    def longest(poses, bearings, walls):
        ranges = np.empty((len(poses), len(bearings)))
        fan_into(poses, bearings, walls, np.inf, ranges)
        return ranges.max()

    poses = np.array([[1.0, 1.0, 0.3], [4.0, 1.0, 2.0]])
    assert longest(poses, BEARINGS, SHEET) == cast_fan(poses, BEARINGS, SHEET).max()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: cast_fan(np.zeros((4, 2)), BEARINGS, SHEET), r"poses: shape \(4, 2\)"),
        (lambda: cast_fan(np.zeros((4, 3)), BEARINGS, SHEET.T), r"walls: shape \(4, 24\)"),
        (lambda: cast_fan([[0.0, np.nan, 0.0]], BEARINGS, SHEET), "poses: row 0 is not finite"),
        (lambda: cast_fan(np.zeros((4, 3)), 0.0, SHEET), "bearings"),
        (lambda: cast_fan(np.zeros((4, 3)), BEARINGS, SHEET, limit=np.nan), "limit: nan"),
        (lambda: cast(np.zeros((4, 2)), np.zeros((3, 5)), SHEET), "angles: 3 rows, origins: 4"),
    ],
)
def test_says_what_does_not_fit(call, words):
    with pytest.raises(ValueError, match=words):
        call()
