"""The filters and the calibration on made-up recordings, of which everything is known. Seeds are fixed throughout."""

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from course_lib.angles import wrap
from course_lib.beacon.planar.calibration import calibrate, labyrinth
from course_lib.beacon.planar.filters import dead_reckoning, kalman_step, localize, particle_step, start_near_truth
from course_lib.beacon.planar.robot import POSE, Constants, move, observe
from course_lib.filters import Gaussian
from course_lib.recording import GroundRecording, read_mrclam, read_uwb
from tests.benchmarks.recorded import errors

LANDMARKS = np.array([[3.0, 0.0], [0.0, 3.0], [-3.0, 0.0], [0.0, -3.0]])
CONSTANTS = Constants(LANDMARKS, sigma_v=0.02, sigma_omega=0.03, sigma_rho=0.1, sigma_alpha=0.05, outliers=0.001, N=500)
FILTERS = [kalman_step, particle_step]


def drive(constants, seconds=60.0, seed=0, outliers=0.0, bearings=True):
    """A robot that goes round and round among four landmarks: ten readings of odometry, two sightings a second."""
    rng = np.random.default_rng(seed)
    dt, steps = 0.1, int(10 * seconds)
    times = dt * np.arange(steps + 1)
    odometry = np.column_stack([np.full(steps + 1, 0.3), 0.3 + 0.2 * np.sin(times)])
    states = np.zeros((steps + 1, 4))
    states[0] = 0.5, -1.0, 0.0, constants.bias_sigma * rng.standard_normal()
    for k in range(steps):
        # What is commanded a while before is done now.
        command = odometry[max(k - round(constants.delay / dt), 0)]
        noise = rng.standard_normal(2) * (constants.sigma_v, constants.sigma_omega) / np.sqrt(dt)
        states[k + 1] = move(states[k : k + 1], (*command, dt), constants, *noise)[0]
    rows = np.arange(5, steps + 1, 5)
    seen = rng.integers(len(LANDMARKS), size=len(rows))
    read = [observe(states[row : row + 1], [landmark], constants) for row, landmark in zip(rows, seen, strict=True)]
    ranges, angles = np.array(read)[:, :, 0, 0].T
    far = rng.random(len(rows)) < outliers
    ranges = ranges + constants.sigma_rho * rng.standard_normal(len(rows)) + far * rng.uniform(1.0, 5.0, len(rows))
    angles = wrap(angles + constants.sigma_alpha * rng.standard_normal(len(rows)))
    return GroundRecording(
        name="made up",
        clock=0.0,
        odometry_times=times,
        odometry=odometry,
        sighting_times=times[rows],
        sighted=seen,
        ranges=ranges,
        bearings=angles if bearings else np.full(len(rows), np.inf),
        landmarks=LANDMARKS,
        landmark_names=np.arange(4),
        truth_times=times,
        truth=np.column_stack([states[:, :2], wrap(states[:, 2])]),
    )


def follow(recording, constants, step, seed=1):
    return localize(recording, constants, np.random.default_rng(seed), step)


@pytest.mark.parametrize("step", FILTERS)
def test_the_filters_follow_and_know_how_well(step):
    """Over 12 runs the mean NEES per dimension is near 1: errors hang together in a run, so the bounds are wide."""
    results = [errors(follow(drive(CONSTANTS, seed=seed), CONSTANTS, step, seed)) for seed in range(12)]
    rmse, _, nees, covered = np.mean(results, axis=0)
    assert rmse < 0.08
    assert 0.7 < nees < 1.4
    assert 0.82 < covered < 0.97


def test_the_filters_agree():
    recording = drive(CONSTANTS)
    kalman = follow(recording, CONSTANTS, kalman_step)
    particles = follow(recording, replace(CONSTANTS, N=4000), particle_step)
    # Both start at the same error, since it is drawn first.
    difference = kalman.means[:, POSE] - particles.means[:, POSE]
    difference[:, 2] = wrap(difference[:, 2])
    spread = np.sqrt(np.diagonal(kalman.covariances[:, POSE, POSE], axis1=1, axis2=2))
    assert np.sqrt(np.mean((difference / spread) ** 2)) < 0.35
    assert kalman.log_evidence == pytest.approx(particles.log_evidence, abs=5.0)


@pytest.mark.parametrize("step", FILTERS)
def test_the_filters_are_better_than_dead_reckoning(step):
    recording = drive(CONSTANTS)
    assert errors(follow(recording, CONSTANTS, step))[0] < 0.3 * errors(follow(recording, CONSTANTS, dead_reckoning))[0]


@pytest.mark.parametrize("step", FILTERS)
def test_a_bearing_that_is_not_wrapped_loses_the_robot(step):
    recording = drive(CONSTANTS)
    wrong = errors(follow(recording, CONSTANTS, partial(step, difference=np.subtract)))[0]
    assert wrong > 4.0 * errors(follow(recording, CONSTANTS, step))[0]


@pytest.mark.parametrize("step", FILTERS)
def test_outliers_are_borne_by_a_filter_that_expects_them(step):
    recording = drive(CONSTANTS, outliers=0.15)
    expecting = replace(CONSTANTS, outliers=0.15)
    trusting = replace(CONSTANTS, outliers=1e-12, gate=1.0 - 1e-12)
    assert errors(follow(recording, expecting, step))[0] < 0.1
    if step is kalman_step:
        # No gate keeps errors of metres out when it is open to all; a mixture of almost no outliers still has one.
        trusting = replace(trusting, sigma_rho=0.3)
        assert errors(follow(recording, trusting, step))[0] > 1.5 * errors(follow(recording, expecting, step))[0]


@pytest.mark.parametrize("step", FILTERS)
def test_a_bias_of_the_ranges_is_found_from_ranges_alone(step):
    biased = replace(CONSTANTS, range_offset=0.4)
    recording = drive(biased, seconds=90.0, bearings=False)
    told = replace(CONSTANTS, bias_sigma=0.5, N=2000)
    track = follow(recording, told, step)
    bias, deviation = track.means[-1, 3], np.sqrt(track.covariances[-1, 3, 3])
    assert deviation < 0.1
    assert abs(bias - 0.4) < 4.0 * deviation
    assert errors(track)[0] < 0.5 * errors(follow(recording, CONSTANTS, step))[0]


def test_calibration_finds_what_was_hidden():
    hidden = replace(
        CONSTANTS,
        v_scale=0.94,
        omega_scale=0.92,
        omega_offset=-0.01,
        delay=0.2,
        depth=True,
        range_scale=1.02,
        range_offset=0.05,
        bearing_offset=0.02,
        sigma_v=0.005,
        sigma_omega=0.01,
        sigma_rho=0.02,
        sigma_alpha=0.01,
    )
    found = calibrate(drive(hidden, seconds=400.0, outliers=0.03))
    assert found.delay == pytest.approx(0.2, abs=0.051)
    assert found.v_scale == pytest.approx(0.94, abs=0.01)
    assert found.omega_scale == pytest.approx(0.92, abs=0.03)
    assert found.omega_offset == pytest.approx(-0.01, abs=0.01)
    assert found.range_scale == pytest.approx(1.02, abs=0.01)
    assert found.range_offset == pytest.approx(0.05, abs=0.02)
    assert found.bearing_offset == pytest.approx(0.02, abs=0.003)
    assert found.outliers == pytest.approx(0.03, abs=0.02)
    # These errors are independent, so that the window changes nothing but the precision of the estimate.
    assert found.sigma_rho == pytest.approx(0.02, rel=0.3)
    assert found.sigma_alpha == pytest.approx(0.01, rel=0.3)


def test_errors_that_hang_together_count_for_more():
    recording = drive(CONSTANTS, seconds=400.0)
    slow = 0.1 * np.sin(2.0 * np.pi * recording.sighting_times / 40.0)
    together = replace(recording, ranges=recording.ranges + slow)
    alone = calibrate(together, depth=False, window=1e-3)
    assert calibrate(together, depth=False).sigma_rho > 2.0 * alone.sigma_rho


def test_the_start_is_the_true_pose_with_an_error_of_known_size():
    recording = drive(CONSTANTS, seconds=10.0)
    _, run = recording.steps()
    starts = np.array([start_near_truth(run, CONSTANTS, np.random.default_rng(i)).mean for i in range(2000)])
    # Fixed seeds; five standard deviations of a mean and of a deviation of 2000 draws.
    np.testing.assert_allclose(starts[:, :3].mean(axis=0), run.truth[0], atol=5 * 0.1 / np.sqrt(2000))
    np.testing.assert_allclose(starts[:, :3].std(axis=0), 0.1, rtol=5 / np.sqrt(4000))


def test_a_heading_that_was_not_recorded_starts_as_the_direction_of_the_first_path():
    recording = drive(CONSTANTS, seconds=10.0)
    headless = replace(recording, truth=recording.truth * [1.0, 1.0, np.nan])
    _, run = headless.steps()
    starts = [start_near_truth(run, CONSTANTS, np.random.default_rng(i)).mean[2] for i in range(200)]
    assert np.mean(starts) == pytest.approx(recording.truth[0, 2], abs=0.2)


def test_a_track_starts_where_it_is_told_and_has_a_row_for_each_instant():
    recording = drive(CONSTANTS, seconds=5.0)
    start = Gaussian(np.array([0.5, -1.0, 2.0 * np.pi, 0.0]), 1e-4 * np.eye(4))
    track = localize(recording, CONSTANTS, np.random.default_rng(0), kalman_step, start)
    np.testing.assert_allclose(track.means[0], [0.5, -1.0, 0.0, 0.0], atol=1e-12)
    assert len(track.times) == len(track.means) == len(track.covariances) == len(track.truth)
    assert (np.abs(track.means[:, 2]) <= np.pi).all()


def real(name):
    data = os.environ.get("COURSE_DATA")
    if not data or not (Path(data) / name).is_dir():
        pytest.skip(f"COURSE_DATA names no folder with {name} in it")
    return Path(data) / name


@pytest.mark.parametrize("step", FILTERS)
def test_the_real_robot_is_followed_to_within_18_cm(step):
    folder = real("mrclam6")
    constants = calibrate(read_mrclam(folder, 1))
    rmse, *_ = errors(follow(read_mrclam(folder, 3), constants, step))
    assert rmse <= 0.18


@pytest.mark.parametrize("step", FILTERS)
def test_the_labyrinth_is_left_when_the_bias_is_estimated(step):
    recording = read_uwb(real("uwb"))
    rmse, *_ = errors(follow(recording, labyrinth(recording), step))
    ignored, *_ = errors(follow(recording, labyrinth(recording, bias_sigma=0.0, bias_walk=0.0), step))
    assert rmse < 0.1 < ignored
