"""The simulated world.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest, kstest, triang

from course_lib.vacuum.constants import Constants, Hidden
from course_lib.vacuum.models import distances, prior
from course_lib.vacuum.world import World

FALSE_ALARM = 1e-6


def simulate(seed=61, hidden=None, **constants):
    world = World(Constants(**constants), Hidden(**(hidden or {})))
    return world, world.simulate(np.random.default_rng(seed))


def segments(speeds):
    """Lengths of the stretches of constant speed."""
    ends = np.flatnonzero(np.diff(speeds)) + 1
    return np.diff(np.r_[0, ends, len(speeds)])


def test_shapes():
    _, run = simulate()
    assert run.truth.shape == (201, 6) and run.observations.shape == (200, 4) and run.controls.shape == (200, 2)


def test_speeds_are_piecewise_constant():
    _, run = simulate(hidden={"steps": 10_000})
    for speeds in run.controls.T:
        lengths = segments(speeds)[:-1]
        assert set(lengths) == set(range(5, 31)), "every length from 5 to 30 steps, and no other"
        distinct = speeds[np.r_[0, np.cumsum(lengths)]]
        assert kstest(distinct, "uniform", args=(1.0, 1.0)).pvalue > FALSE_ALARM / 2
    assert (run.controls[:, 0] != run.controls[:, 1]).all()


@pytest.mark.parametrize("steps", [1, 4, 5, 31, 200])
def test_speeds_last_for_the_whole_run(steps):
    for shortest, longest in ((1, 1), (5, 30), (200, 300)):
        hidden = {"steps": steps, "shortest_segment": shortest, "longest_segment": longest}
        _, run = simulate(hidden=hidden)
        assert run.controls.shape == (steps, 2)
        assert ((run.controls >= 1.0) & (run.controls <= 2.0)).all()


def test_a_control_acts_from_the_step_before_to_its_own():
    world, run = simulate(L=50.0, hidden={"steps": 100})
    for robot, columns in enumerate(([0, 1], [3, 4])):
        moved = np.diff(run.truth[:, columns], axis=0)
        heading = run.truth[:, 3 * robot + 2]
        straight = heading[1:] == heading[:-1]
        assert straight.sum() > 80 and len(segments(run.controls[:, robot])) > 3
        expected = (run.controls[:, robot] * world.constants.Ts)[:, None]
        expected = expected * np.column_stack([np.cos(heading), np.sin(heading)])[1:]
        np.testing.assert_allclose(moved[straight], expected[straight], atol=1e-9)


def test_robots_stay_in_the_room_and_start_in_their_corners():
    world, run = simulate(L=2.0, length=2.0, v_s_bar=0.5)
    position = run.truth[:, [[0, 1], [3, 4]]]
    assert (position >= 0.0).all() and (position <= world.constants.room).all()
    for robot in (0, 1):
        assert (position[0, robot] == world.constants.sensors[2 * robot : 2 * robot + 2]).all(axis=1).any()
    assert len(np.unique(run.truth[:, 2])) > 3, "the robot bounces"


@pytest.mark.parametrize("probability", [0.0, 0.2, 0.9, 1.0])
def test_each_sensor_reports_with_the_probability_given(probability):
    _, run = simulate(hidden={"steps": 5000, "report_probability": probability})
    reports = np.isfinite(run.observations)
    assert (run.observations[~reports] == np.inf).all()
    for sensor in reports.T:
        assert binomtest(int(sensor.sum()), len(sensor), probability).pvalue > FALSE_ALARM / 4
    if 0.0 < probability < 1.0:
        assert np.abs(np.corrcoef(reports.T) - np.eye(4)).max() < 5.5 / np.sqrt(5000)


def test_readings_are_of_the_right_robot_or_the_wrong_one_with_triangular_noise():
    world, run = simulate(s_bar=0.3, w_bar=0.05, hidden={"steps": 8000, "report_probability": 1.0})
    distance = distances(run.truth[1:], world.constants)
    right, wrong = distance[:, [0, 0, 1, 1], range(4)], distance[:, [1, 1, 0, 0], range(4)]
    from_right, from_wrong = run.observations - right, run.observations - wrong
    assert (np.minimum(np.abs(from_right), np.abs(from_wrong)) <= 0.05 + 1e-12).all()
    # Where the robots' distances differ by more than 2 w̄ a reading tells whose it is.
    clear = np.abs(right - wrong) > 0.1
    erred = np.abs(from_wrong) <= 0.05
    for sensor in range(4):
        told = erred[clear[:, sensor], sensor]
        assert binomtest(int(told.sum()), len(told), 0.3).pvalue > FALSE_ALARM / 4
    for residual, which in ((from_right, clear & ~erred), (from_wrong, clear & erred)):
        assert kstest(residual[which], triang(0.5, -0.05, 0.1).cdf).pvalue > FALSE_ALARM / 2


@pytest.mark.parametrize("s_bar, robots", [(0.0, [0, 0, 1, 1]), (1.0, [1, 1, 0, 0])])
def test_sensors_that_never_err_and_that_always_do(s_bar, robots):
    world, run = simulate(s_bar=s_bar, w_bar=0.01, hidden={"report_probability": 1.0})
    measured = distances(run.truth[1:], world.constants)[:, robots, range(4)]
    assert np.abs(run.observations - measured).max() <= 0.01 + 1e-12


def test_a_seed_is_a_run():
    for part in ("truth", "observations", "controls"):
        np.testing.assert_array_equal(getattr(simulate(7)[1], part), getattr(simulate(7)[1], part))
        assert not np.array_equal(getattr(simulate(7)[1], part), getattr(simulate(8)[1], part))


def test_a_generator_used_twice_gives_two_runs():
    rng = np.random.default_rng(9)
    assert not np.array_equal(World().simulate(rng).truth, World().simulate(rng).truth)


def test_the_truth_does_not_depend_on_the_sensors():
    _, run = simulate(10)
    for change in ({"w_bar": 0.2}, {"s_bar": 0.5}, {"hidden": {"report_probability": 1.0}}):
        _, other = simulate(10, **change)
        np.testing.assert_array_equal(other.truth, run.truth)
        np.testing.assert_array_equal(other.controls, run.controls)
        assert not np.array_equal(other.observations, run.observations)


def test_other_noise_scales_the_same_errors():
    # Whether a sensor reports, which robot it measures and where its noise lies in its range stay as they were.
    world, run = simulate(11, s_bar=0.0)
    _, other = simulate(11, s_bar=0.0, w_bar=0.5)
    measured = distances(run.truth[1:], world.constants)[:, [0, 0, 1, 1], range(4)]
    reports = np.isfinite(run.observations)
    np.testing.assert_array_equal(np.isfinite(other.observations), reports)
    np.testing.assert_allclose((other.observations - measured)[reports], 0.5 * (run.observations - measured)[reports])


def test_many_truths_share_their_speeds_and_nothing_else():
    world = World(Constants(), replace(Hidden(), steps=30))
    run = world.simulate_many(np.random.default_rng(12), 500)
    assert run.truth.shape == (31, 500, 6) and run.controls.shape == (30, 2)
    assert (run.observations == np.inf).all()
    assert len(np.unique(run.truth[0, :, 2])) == 500
    for robot, columns in enumerate(([0, 1], [3, 4])):
        moved = np.linalg.norm(np.diff(run.truth[..., columns], axis=0), axis=2)
        allowed = run.controls[:, robot, None] * world.constants.Ts
        assert (moved <= allowed + 1e-12).all()
        assert (np.isclose(moved, allowed).mean(axis=1) > 0.5).all()
    corners = prior(500, world.constants, np.random.default_rng(0))[:, :2]
    np.testing.assert_array_equal(np.unique(run.truth[0, :, :2], axis=0), np.unique(corners, axis=0))
