"""Driving and bouncing.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.stats import ks_2samp, kstest

from course_lib.angles import wrap
from course_lib.vacuum.constants import Constants
from course_lib.vacuum.models import drive, transition, triangular_noise
from tests.course_lib.vacuum.twins import drive_numpy

FALSE_ALARM = 1e-6

v_bars = st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 1.0))
extents = st.floats(0.1, 20.0)
# Headings along the walls, into the corners, and any others.
headings = st.one_of(
    st.sampled_from([k * np.pi / 4 for k in range(-4, 5)] + [np.nextafter(k * np.pi / 2, 9) for k in (-2, -1, 0, 1)]),
    st.floats(-np.pi, np.pi),
)
# Positions as shares of the room: in the corners, at the walls, next to them, and anywhere.
shares = st.one_of(st.sampled_from([0.0, 1.0, 0.5, 1e-16, np.nextafter(1.0, 0.0)]), st.floats(0.0, 1.0))
# Distances as multiples of the longer side: many bounces within a step, none, or no motion at all.
lengths = st.one_of(st.sampled_from([0.0, 1.0, 1e-12]), st.floats(0.0, 12.0))
robots = st.lists(st.tuples(shares, shares, headings, lengths), min_size=1, max_size=12)


def place(robots, room):
    """States (N, 3) and distances (N,) of robots drawn as above."""
    share_x, share_y, heading, length = np.array(robots).T.copy()
    return np.column_stack([share_x * room[0], share_y * room[1], heading]), length * max(room)


def uniform_states(n, room, rng):
    return np.column_stack([rng.uniform(0, room[0], n), rng.uniform(0, room[1], n), rng.uniform(-np.pi, np.pi, n)])


def driven(states, distance, room, v_bar, rng, kernel=drive, column=0, **more):
    states = states.copy()
    kernel(states, column, np.broadcast_to(distance, len(states)).copy(), room[0], room[1], v_bar, rng, **more)
    return states


# what no constants and no noise may break


@given(robots, extents, extents, v_bars, st.integers(0, 2**32 - 1))
@example([(0.0, 0.0, -3 * np.pi / 4, 3.0), (1.0, 1.0, np.pi / 4, 3.0)], 5.0, 5.0, 1.0, 0)
@example([(1.0, 0.0, -np.pi / 2, 0.0), (1.0, 0.0, 0.0, 0.0)], 5.0, 5.0, 1.0, 0)
def test_no_robot_leaves_the_room_or_gains_speed(robots, room_x, room_y, v_bar, seed):
    before, distance = place(robots, (room_x, room_y))
    after = driven(before, distance, (room_x, room_y), v_bar, np.random.default_rng(seed))
    assert (after[:, :2] >= 0.0).all() and (after[:, :2] <= [room_x, room_y]).all()
    assert (np.abs(after[:, 2]) <= np.pi).all()
    displacement = np.linalg.norm(after[:, :2] - before[:, :2], axis=1)
    assert (displacement <= distance * (1.0 + 1e-12) + 1e-12).all()


@given(robots, extents, extents, v_bars, st.integers(0, 2**32 - 1))
def test_a_robot_that_reaches_no_wall_drives_straight(robots, room_x, room_y, v_bar, seed):
    before, distance = place(robots, (room_x, room_y))
    heading = before[:, 2]
    goal = before[:, :2] + distance[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    inside = ((goal > 1e-9) & (goal < [room_x - 1e-9, room_y - 1e-9])).all(axis=1)
    after = driven(before, distance, (room_x, room_y), v_bar, np.random.default_rng(seed))
    np.testing.assert_allclose(after[inside, :2], goal[inside], atol=1e-9)
    np.testing.assert_array_equal(after[inside, 2], heading[inside])


@given(robots, extents, extents)
def test_without_noise_the_walls_are_mirrors(robots, room_x, room_y):
    # Independent of any bounce: drive straight through mirrored rooms, then fold them onto the first.
    room = np.array([room_x, room_y])
    before, distance = place(robots, room)
    heading = before[:, 2]
    direction = np.column_stack([np.cos(heading), np.sin(heading)])
    unfolded = before[:, :2] + distance[:, None] * direction
    fold = np.mod(unfolded, 2 * room)
    mirrored = fold > room
    position = np.where(mirrored, 2 * room - fold, fold)
    after = driven(before, distance, room, 0.0, np.random.default_rng(0))
    np.testing.assert_allclose(after[:, :2], position, atol=1e-9)
    # At a wall the heading may be the one before the bounce or the one after it.
    clear = ((position > 1e-9) & (position < room - 1e-9)).all(axis=1)
    expected = np.where(mirrored, -direction, direction)[clear]
    actual = np.column_stack([np.cos(after[clear, 2]), np.sin(after[clear, 2])])
    np.testing.assert_allclose(actual, expected, atol=1e-9)


def test_a_robot_that_heads_along_a_wall_stays_at_it():
    along = np.array([[1.0, 0.0, 0.0], [4.0, 0.0, np.pi], [0.0, 1.0, np.pi / 2], [5.0, 4.0, -np.pi / 2]])
    after = driven(along, 2.0, (5.0, 5.0), 1.0, np.random.default_rng(0))
    np.testing.assert_allclose(after[:, :2], [[3.0, 0.0], [2.0, 0.0], [0.0, 3.0], [5.0, 2.0]], atol=1e-12)


def test_only_the_robot_that_is_asked_to_drives():
    rng = np.random.default_rng(41)
    before = np.column_stack([uniform_states(50, (5.0, 5.0), rng), uniform_states(50, (5.0, 5.0), rng)])
    distance = rng.uniform(0.0, 9.0, 50)
    after, given_distance = before.copy(), distance.copy()
    drive(after, 3, given_distance, 5.0, 5.0, 1.0, rng)
    np.testing.assert_array_equal(after[:, :3], before[:, :3])
    assert (after[:, 3:5] != before[:, 3:5]).any(axis=1).all()
    np.testing.assert_array_equal(given_distance, distance)


# the twin, and what its path shows


@given(robots, extents, extents, v_bars, st.integers(0, 2**32 - 1))
def test_kernel_equals_its_numpy_twin(robots, room_x, room_y, v_bar, seed):
    before, distance = place(robots, (room_x, room_y))
    rng, twins_rng = np.random.default_rng(seed), np.random.default_rng(seed)
    after = driven(before, distance, (room_x, room_y), v_bar, rng)
    twins = driven(before, distance, (room_x, room_y), v_bar, twins_rng, drive_numpy)
    # cos, sin, arctan2 and cbrt of the two libraries may differ in their last digit.
    np.testing.assert_allclose(after, twins, atol=1e-9)
    assert rng.random() == twins_rng.random(), "kernel and twin drew different numbers of bounces"


@pytest.mark.parametrize("v_bar", [0.0, 0.3, 1.0])
def test_kernel_equals_its_numpy_twin_on_a_crowd(v_bar):
    rng = np.random.default_rng(42)
    before, distance = uniform_states(5000, (5.0, 3.0), rng), rng.uniform(0.0, 20.0, 5000)
    after = driven(before, distance, (5.0, 3.0), v_bar, np.random.default_rng(43))
    twins = driven(before, distance, (5.0, 3.0), v_bar, np.random.default_rng(43), drive_numpy)
    np.testing.assert_allclose(after, twins, atol=1e-9)


@given(robots, extents, extents, v_bars, st.integers(0, 2**32 - 1))
def test_a_robots_way_is_as_long_as_its_distance_however_often_it_bounces(robots, room_x, room_y, v_bar, seed):
    before, distance = place(robots, (room_x, room_y))
    path = []
    after = driven(before, distance, (room_x, room_y), v_bar, np.random.default_rng(seed), drive_numpy, path=path)
    np.testing.assert_array_equal(path[-1], after[:, :2])
    np.testing.assert_allclose(np.linalg.norm(np.diff(path, axis=0), axis=2).sum(axis=0), distance, atol=1e-9)


# the law of the bounce


# One robot at each wall: where it stands, the wall's inward normal, and the direction along it.
WALLS = {
    "lower": ([2.5, 0.0], [0.0, 1.0], [1.0, 0.0]),
    "upper": ([2.5, 5.0], [0.0, -1.0], [1.0, 0.0]),
    "left": ([0.0, 2.5], [1.0, 0.0], [0.0, 1.0]),
    "right": ([5.0, 2.5], [-1.0, 0.0], [0.0, 1.0]),
}


@pytest.mark.parametrize("v_bar", [1.0, 0.4])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("wall", WALLS)
def test_post_bounce_angle_follows_the_exercise(wall, side, v_bar):
    rng = np.random.default_rng(44)
    foot, normal, along = (np.array(vector) for vector in WALLS[wall])
    along = side * along
    n = 4000
    incident = rng.uniform(0.05, np.pi / 2, n)
    velocity = np.cos(incident)[:, None] * along - np.sin(incident)[:, None] * normal
    # A quarter of a metre before the wall and as much after it: one bounce, far from the corners.
    before = np.column_stack([foot - 0.25 * velocity, np.arctan2(velocity[:, 1], velocity[:, 0])])
    after = driven(before, 0.5, (5.0, 5.0), v_bar, rng)

    leaving = after[:, :2] - foot
    np.testing.assert_allclose(np.linalg.norm(leaving, axis=1), 0.25, atol=1e-9)
    direction = np.arctan2(leaving[:, 1], leaving[:, 0])
    np.testing.assert_allclose(wrap(after[:, 2] - direction), 0.0, atol=1e-9)
    reflected = np.arctan2(leaving @ normal, leaving @ along)
    noise = reflected / incident - 1.0
    assert noise.min() >= -v_bar - 1e-9 and noise.max() <= v_bar + 1e-9
    # f(v) = c v² on [-v̄, v̄], c = 3 / (2 v̄³)
    assert kstest(noise, lambda v: (v**3 + v_bar**3) / (2 * v_bar**3)).pvalue > FALSE_ALARM
    # The noise has nothing to do with the incident angle.
    grazing = incident < np.median(incident)
    assert ks_2samp(noise[grazing], noise[~grazing]).pvalue > FALSE_ALARM


def test_the_same_check_rejects_uniform_noise():
    noise = np.random.default_rng(45).uniform(-1.0, 1.0, 4000)
    assert kstest(noise, lambda v: (v**3 + 1.0) / 2.0).pvalue < FALSE_ALARM


def test_robots_bounce_independently_of_each_other():
    n = 4000
    before = np.tile([2.5, 0.2, -np.pi / 2], (n, 1))
    heading = driven(before, 0.4, (5.0, 5.0), 0.5, np.random.default_rng(46))[:, 2]
    assert len(np.unique(heading)) == n
    assert abs(np.corrcoef(heading[1:], heading[:-1])[0, 1]) < 5.0 / np.sqrt(n)


@pytest.mark.parametrize("v_bar", [0.0, 0.7])
def test_two_half_steps_are_one_whole_step(v_bar):
    rng = np.random.default_rng(47)
    n, room = 6000, (3.0, 2.0)
    before = np.tile([0.4, 0.3, -2.2], (n, 1))
    distance = rng.uniform(0.0, 6.0, n)
    whole = driven(before, distance, room, v_bar, rng)
    halves = driven(driven(before, distance / 2, room, v_bar, rng), distance / 2, room, v_bar, rng)
    if v_bar == 0.0:
        np.testing.assert_allclose(halves, whole, atol=1e-9)
    for column in range(3):
        assert ks_2samp(whole[:, column], halves[:, column], method="asymp").pvalue > FALSE_ALARM / 3


# the transition of both robots


def test_each_robot_drives_at_its_own_speed():
    constants = Constants(L=100.0, Ts=0.5)
    states = np.tile([50.0, 50.0, 0.3, 20.0, 70.0, -2.0], (10, 1))
    before = states.copy()
    moved = transition(states, [4.0, 2.0], constants, np.random.default_rng(48)) - states
    np.testing.assert_array_equal(states, before)
    np.testing.assert_allclose(moved[:, :2], np.tile([2.0 * np.cos(0.3), 2.0 * np.sin(0.3)], (10, 1)))
    np.testing.assert_allclose(moved[:, 3:5], np.tile([np.cos(-2.0), np.sin(-2.0)], (10, 1)))
    np.testing.assert_array_equal(moved[:, [2, 5]], 0.0)


@given(v_bars, st.floats(0.1, 10.0), st.floats(0.3, 3.0), st.floats(0.0, 0.99), st.integers(0, 2**32 - 1))
def test_both_robots_stay_in_a_room_of_any_shape(v_bar, side, length, v_s_bar, seed):
    constants = Constants(L=side, v_bar=v_bar, length=length, v_s_bar=v_s_bar)
    rng = np.random.default_rng(seed)
    states = np.column_stack([uniform_states(5, constants.room, rng) for _ in range(2)])
    speeds = rng.uniform(0.0, 40.0 * side, 2)
    after = transition(states, speeds, constants, rng)
    for robot in (0, 1):
        position = slice(3 * robot, 3 * robot + 2)
        assert (after[:, position] >= 0.0).all() and (after[:, position] <= constants.room).all()
        displacement = np.linalg.norm(after[:, position] - states[:, position], axis=1)
        assert (displacement <= speeds[robot] * constants.Ts * (1.0 + v_s_bar) * (1.0 + 1e-9) + 1e-9).all()
    assert (np.abs(after[:, [2, 5]]) <= np.pi).all()


def test_speed_noise_is_triangular_multiplicative_and_drawn_for_each_robot():
    constants = Constants(L=1000.0, v_s_bar=0.3)
    states = np.tile([500.0, 500.0, 1.0, 400.0, 600.0, 2.0], (5000, 1))
    after = transition(states, [2.0, 7.0], constants, np.random.default_rng(49))
    noise = [
        np.linalg.norm((after - states)[:, columns], axis=1) / (speed * constants.Ts) - 1.0
        for columns, speed in (([0, 1], 2.0), ([3, 4], 7.0))
    ]
    for v_s in noise:
        assert kstest(v_s, "triang", args=(0.5, -0.3, 0.6)).pvalue > FALSE_ALARM / 2
    assert abs(np.corrcoef(noise)[0, 1]) < 5.0 / np.sqrt(5000)


def test_speed_noise_draws_its_own_number_per_step_and_nothing_when_absent():
    rng, expected = np.random.default_rng(50), np.random.default_rng(50)
    states = np.tile([500.0, 500.0, 0.0, 500.0, 500.0, 0.0], (3, 1))
    transition(states, [1.0, 1.0], Constants(L=1000.0), rng)
    assert rng.random() == expected.random()
    after = transition(states, [1.0, 1.0], Constants(L=1000.0, v_s_bar=0.2), np.random.default_rng(51))
    noise = triangular_noise(np.random.default_rng(51).random(6), 0.2)
    np.testing.assert_allclose(after[:, [0, 3]].T.ravel() - 500.0, 0.1 * (1.0 + noise))
