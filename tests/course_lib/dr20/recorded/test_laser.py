"""Scans become a map, and scans find themselves in it: each step against its twin, and all of it on a made-up log."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from course_lib.angles import wrap
from course_lib.dr20.recorded import laser, scans
from course_lib.geometry import raycast
from course_lib.geometry.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from course_lib.geometry.polygons import clearance, inside, walls
from course_lib.recording import read_carmen

#: Corridors around a block, with niches that tell them apart.
ROOM = [(0, 0), (9, 0), (9, 3), (10, 3), (10, 5), (9, 5), (9, 7), (4, 7), (4, 8), (3, 8), (3, 7), (0, 7)]
BLOCK = [(2, 2), (7, 2), (7, 5), (5, 5), (5, 4), (4, 4), (4, 5), (2, 5)]
WALLS = walls([ROOM, BLOCK])
LAP = 60
WHEELS = laser.Odometry(scale=1.05, gain=0.97, drift=0.05, mount=0.1, alphas=(0.0, 0.0, 0.0, 0.0))


def track(count):
    """Poses around the block, LAP of them to a lap, the heading along the way."""
    way = shapely.LinearRing([(1, 1), (8, 1), (8, 6), (1, 6)])
    at = np.arange(count) / LAP * way.length % way.length
    points = shapely.get_coordinates(shapely.line_interpolate_point(way, at))
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(way, (at + 0.8) % way.length))
    return np.column_stack([points, np.arctan2(*(ahead - points).T[::-1])])


def wheels_of(poses):
    """Odometry that WHEELS corrects to these poses of the scanner."""
    first, way, second = laser.increments(poses).T
    way = way / WHEELS.scale
    first, second = ((turn - 0.5 * WHEELS.drift * way) / WHEELS.gain for turn in (first, second))
    scanner = [np.zeros((1, 3))]
    for step in np.column_stack([first, way, second]):
        scanner.append(laser.move(scanner[-1], step[None]))
    scanner = np.concatenate(scanner)
    scanner[:, :2] -= WHEELS.mount * np.column_stack([np.cos(scanner[:, 2]), np.sin(scanner[:, 2])])
    return scanner


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Three laps, written as a log and read again: ranges to 1 cm, 5 m at the most; then a metre back."""
    rng = np.random.default_rng(2)
    poses = track(3 * LAP + 2)
    bearings = np.radians(np.arange(180) - 90.0)
    ranges = raycast.cast_fan(poses, bearings, WALLS, limit=5.0)
    ranges = np.where(np.isfinite(ranges), ranges + 0.01 * rng.standard_normal(ranges.shape), 81.83)
    path = tmp_path_factory.mktemp("log") / "room.clf"
    lines = (
        f"FLASER 180 {' '.join(f'{r:.2f}' for r in scan)} {' '.join(map(str, (*pose, *wheels)))} {k}.0 host {k}.0\n"
        for k, (scan, pose, wheels) in enumerate(zip(ranges, poses, wheels_of(poses), strict=True))
    )
    path.write_text("".join(lines))
    return read_carmen(path)


@pytest.fixture(scope="module")
def field(recording):
    first = int(np.sum(scans.laps(recording.corrected) <= 2))
    part = recording.corrected[:first], recording.ranges[:first], recording.bearings
    return scans.likelihood_field(scans.build_map(*part))


def test_laps_end_with_whole_turns_and_going_back_begins_none():
    turns = np.concatenate([np.linspace(0.0, 2.5, 250), np.linspace(2.5, 0.5, 201)])
    poses = np.column_stack([3.0 + np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns), turns])
    for direction in (1.0, -1.0):
        lap = scans.laps(poses * (1.0, direction, 1.0))
        np.testing.assert_array_equal(np.flatnonzero(np.diff(lap)) + 1, [100, 200])


def test_rays_are_tallied_in_the_cells_they_cross():
    rng = np.random.default_rng(4)
    starts, ends = rng.uniform(0.0, (9.0, 6.0), size=(2, 200, 2))
    expected = np.zeros((6, 9), dtype=int), np.zeros((6, 9), dtype=int)
    for start, end in zip(starts, ends, strict=True):
        lines = [(k - start[axis]) / (end - start)[axis] for axis in (0, 1) for k in range(10)]
        cuts = np.sort([0.0, *(cut for cut in lines if 0.0 < cut < 1.0), 1.0])
        middles = start + 0.5 * (cuts[:-1] + cuts[1:])[:, None] * (end - start)
        column, row = np.floor(middles).astype(int).T
        np.add.at(expected[1], (row[:-1], column[:-1]), 1)
        expected[0][row[-1], column[-1]] += 1
    for counted, right in zip(scans.tally(starts, ends, 6, 9), expected, strict=True):
        np.testing.assert_array_equal(counted, right)


def test_the_map_is_that_of_the_room(field):
    grid = field.grid
    rows = np.argwhere(grid.cells != UNKNOWN)
    centres, cells = np.ascontiguousarray(grid.centres_of(rows)), grid.cells[tuple(rows.T)]
    # Occupied cells are at walls (noise, half a cell's diagonal); free ones are not beyond them.
    near = clearance(centres, WALLS) < 0.04 + 0.04
    assert near[cells == OCCUPIED].all()
    assert (near | inside(centres, WALLS))[cells == FREE].all()
    assert (cells == FREE).sum() * grid.resolution**2 > 0.9 * (65.0 - 14.0)


def test_the_field_of_one_cell():
    field = scans.likelihood_field(OccupancyGrid([[1, 0, -1, -1]], 0.1, (0.0, 0.0)), sigma=0.1, p_hit=0.5, reach=20.0)
    hit = 0.5 * np.exp(-0.5 * np.arange(4) ** 2) / (np.sqrt(2.0 * np.pi) * 0.1) + 0.5 / 20.0
    assert hit[3] < 1.0 / 20.0 < hit[2]
    np.testing.assert_allclose(np.exp(field.log_likelihood[0]), [*hit[:3], 1.0 / 20.0, 1.0 / 20.0])
    np.testing.assert_allclose(np.exp(field.log_likelihood[1]), 1.0 / 20.0)


def test_the_likelihood_of_a_scan_agrees_with_numpy():
    rng = np.random.default_rng(6)
    grid = OccupancyGrid(rng.integers(-1, 2, size=(30, 40)), 0.1, (-2.0, 1.0, 0.7))
    field = scans.likelihood_field(grid)
    poses = np.column_stack([grid.to_world(rng.uniform(-9.0, 49.0, size=(50, 2))), rng.uniform(-3.0, 3.0, 50)])
    ranges, bearings = rng.uniform(0.0, 4.0, 12), np.linspace(-1.5, 1.5, 12)
    ranges[[0, 7]] = np.inf
    expected = np.zeros(50)
    for reading, bearing in zip(ranges, bearings, strict=True):
        if np.isfinite(reading):
            angles = poses[:, 2] + bearing
            points = poses[:, :2] + reading * np.column_stack([np.cos(angles), np.sin(angles)])
            expected += grid.look_up(field.log_likelihood[:-1, :-1], points, field.log_likelihood[-1, -1])
    found = scans.scan_log_likelihood(poses, ranges, bearings, field)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_increments_lead_from_pose_to_pose(seed):
    rng = np.random.default_rng(seed)
    poses = np.cumsum(rng.choice([0.0, 0.005, 0.1, 1.0], size=(8, 3)) * rng.uniform(-3.0, 3.0, size=(8, 3)), axis=0)
    steps = laser.increments(poses)
    moved = laser.move(poses[:-1], steps)
    # Ways of less than 1 cm have no direction.
    np.testing.assert_allclose(moved[:, :2], poses[1:, :2], atol=0.0201)
    far = np.abs(steps[:, 1]) > 0.01
    np.testing.assert_allclose(moved[far, :2], poses[1:][far, :2], atol=1e-9)
    np.testing.assert_allclose(wrap(moved[:, 2] - poses[1:, 2]), 0.0, atol=1e-9)
    assert (np.abs(steps[:, 0]) <= np.pi / 2 + 1e-9).all()


def test_a_way_back_is_a_negative_way():
    np.testing.assert_allclose(laser.increments(np.array([[1.0, 0.0, 0.0], [0.0, 0.1, 0.1]]))[0, 1], -np.hypot(1, 0.1))


def test_the_wheels_errors_are_found(recording):
    found = laser.calibrate(recording.odometry, recording.corrected)
    np.testing.assert_allclose(found[:4], WHEELS[:4], atol=1e-4)
    np.testing.assert_allclose(found.alphas, 0.0, atol=1e-6)
    assert laser.increments(recording.odometry, WHEELS) == pytest.approx(
        laser.increments(recording.corrected), abs=1e-6
    )


def test_noise_grows_with_what_was_turned_and_gone():
    """100 000 draws at a fixed seed: deviations within 2 % (their own standard deviation is 0.2 %)."""
    odometry = WHEELS._replace(alphas=(0.01, 0.02, 0.03, 0.04))
    drawn = laser.transition(np.zeros((100_000, 3)), np.array([0.0, 2.0, 0.5]), odometry, np.random.default_rng(1))
    turned = 0.02 * 4.0 + 0.006**2
    assert np.std(drawn[:, 2]) == pytest.approx(np.sqrt(2.0 * turned + 0.01 * 0.25), rel=0.02)
    gone = np.hypot(drawn[:, 0], drawn[:, 1])
    assert np.std(gone) == pytest.approx(np.sqrt(0.03 * 4.0 + 0.04 * 0.25 + 0.01**2), rel=0.02)


def test_anywhere_is_where_it_is_free(field):
    drawn = scans.anywhere(500, field.grid, np.random.default_rng(1))
    assert (field.grid.look_up(field.grid.cells, drawn[:, :2], UNKNOWN) == FREE).all()
    assert (np.histogram(drawn[:, 2], 4, (-np.pi, np.pi))[0] > 80).all()


def localized(recording, stretch, field, start, rng, alphas=None):
    """Distances and turns from the truth, scan by scan, and the track."""
    odometry = WHEELS._replace(alphas=(1e-3, 1e-3, 1e-3, 1e-3))
    beams = np.arange(0, 180, 5)
    track = laser.localize(recording, stretch, field, odometry, start, rng, beams, 0.1, alphas, least=500)
    error = track.estimates - recording.corrected[stretch.start : stretch.stop]
    return np.hypot(error[:, 0], error[:, 1]), np.abs(wrap(error[:, 2])), track


def last_lap(recording):
    first = int(np.sum(scans.laps(recording.corrected) <= 2))
    assert len(recording.times) - first > 0.9 * LAP
    return range(first, len(recording.times))


@pytest.mark.parametrize("known", [True, False])
def test_the_last_lap_is_localized_in_the_map_of_the_first_two(recording, field, known):
    """Fixed seed."""
    rng, stretch = np.random.default_rng(7), last_lap(recording)
    start = recording.corrected[stretch.start] + 0.1 * rng.standard_normal((1000, 3))
    start = start if known else scans.anywhere(10_000, field.grid, rng)
    distance, turn, track = localized(recording, stretch, field, start, rng)
    late = slice(0 if known else LAP // 2, None)
    assert distance[late].max() < 0.15 and turn[late].max() < 0.1
    assert track.counts[-1] < track.counts[0] and track.shares[-1] > 0.9


def test_random_particles_find_a_robot_that_was_carried_away(recording, field):
    """Fixed seed. Without the robot's wheels turning it goes from scan 15 of the lap to scan 30."""
    stretch = last_lap(recording)
    left, put = stretch.start + 15, stretch.start + 30
    steps, wheels = laser.increments(recording.odometry), [recording.odometry[:1]]
    for step in [*steps[: left - 1], np.zeros(3), *steps[put:]]:
        wheels.append(laser.move(wheels[-1], step[None]))
    kept, wheels = np.r_[:left, put : len(recording.times)], np.concatenate(wheels)
    carried = replace(recording, ranges=recording.ranges[kept], odometry=wheels, corrected=recording.corrected[kept])
    stretch = range(stretch.start, len(kept))
    late = {}
    for alphas in (None, (0.05, 0.5)):
        rng = np.random.default_rng(3)
        start = recording.corrected[stretch.start] + 0.1 * rng.standard_normal((1000, 3))
        distance, _, _ = localized(carried, stretch, field, start, rng, alphas)
        assert distance[:15].max() < 0.2 and distance[15] > 2.0
        late[alphas] = distance[-10:].max()
    assert late[0.05, 0.5] < 0.2 < 1.0 < late[None]
