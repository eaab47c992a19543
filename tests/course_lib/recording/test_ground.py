"""What a robot on the ground recorded: truth between its instants, and the recording as a run."""

import numpy as np
import pytest

from course_lib.recording import GroundRecording


def recording(**parts):
    """Two odometry readings, one sighting and three true poses, but for what is told."""
    default = {
        "name": "made up",
        "clock": 0.0,
        "odometry_times": np.array([0.0, 1.0, 2.0]),
        "odometry": np.array([[1.0, 0.0], [2.0, 0.5], [0.0, 0.0]]),
        "sighting_times": np.array([0.5]),
        "sighted": np.array([1]),
        "ranges": np.array([3.0]),
        "bearings": np.array([0.1]),
        "landmarks": np.array([[0.0, 0.0], [3.0, 0.0]]),
        "landmark_names": np.array([6, 7]),
        "truth_times": np.array([0.0, 1.0, 2.0]),
        "truth": np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.2], [2.0, 2.0, 0.4]]),
    }
    return GroundRecording(**(default | parts))


def test_truth_is_linear_between_its_instants_and_nowhere_else():
    between = recording().truth_at([-0.1, 0.0, 0.25, 1.5, 2.0, 2.1])
    np.testing.assert_allclose(between[1:5, :2], [[0.0, 0.0], [0.25, 0.5], [1.5, 2.0], [2.0, 2.0]])
    np.testing.assert_allclose(between[1:5, 2], [0.0, 0.05, 0.3, 0.4], atol=1e-12)
    assert np.isnan(between[[0, 5]]).all()


@pytest.mark.parametrize("first, last, half", [(3.1, -3.1, -np.pi), (-3.0, 3.0, -np.pi), (0.2, -0.2, 0.0)])
def test_a_heading_is_interpolated_along_the_shorter_arc(first, last, half):
    truth = np.array([[0.0, 0.0, first], [0.0, 0.0, last]])
    heading = recording(truth_times=np.array([0.0, 1.0]), truth=truth).truth_at([0.5])[0, 2]
    assert np.abs(np.exp(1j * heading) - np.exp(1j * half)) < 1e-12
    assert -np.pi <= heading < np.pi


def test_headings_that_were_not_recorded_stay_unknown_and_positions_do_not():
    truth = np.array([[0.0, 0.0, np.nan], [1.0, 2.0, np.nan]])
    pose = recording(truth_times=np.array([0.0, 1.0]), truth=truth).truth_at([0.5])[0]
    np.testing.assert_allclose(pose, [0.5, 1.0, np.nan])


def test_steps_end_at_sightings_and_are_short_enough():
    times, run = recording().steps(longest=0.4)
    np.testing.assert_allclose(times, [0.0, 0.4, 0.5, 0.8, 1.2, 1.6])
    np.testing.assert_allclose(run.controls[:, 2], np.diff(times))
    # At 0.5 s landmark 1 is seen: columns are ranges, then bearings.
    np.testing.assert_allclose(run.observations[1], [np.inf, 3.0, np.inf, 0.1])
    assert np.isinf(np.delete(run.observations, 1, axis=0)).all()
    np.testing.assert_allclose(run.truth, recording().truth_at(times))


def test_controls_are_means_over_their_step_of_readings_that_hold_until_the_next():
    times, run = recording().steps(longest=0.4)
    # The step from 0.8 to 1.2 s has half of the first reading and half of the second.
    np.testing.assert_allclose(run.controls[times[:-1] == 0.8, :2], [[1.5, 0.25]])
    assert run.controls[:, 0] @ run.controls[:, 2] == pytest.approx(1.0 + 2.0 * 0.6)


def test_a_delayed_reading_acts_later():
    times, run = recording().steps(delay=0.3, longest=0.1)
    assert times[0] == pytest.approx(0.3)
    after = times[:-1] >= 1.3 - 1e-9
    np.testing.assert_allclose(run.controls[~after, 0], 1.0)
    np.testing.assert_allclose(run.controls[after, 0], 2.0)


def test_a_run_lasts_as_long_as_odometry_and_truth_both_do():
    times, _ = recording(truth_times=np.array([0.7, 1.0, 1.3])).steps()
    assert 0.7 <= times[0] < times[-1] <= 1.3


def test_sightings_at_one_instant_share_a_step():
    twice = {"sighting_times": np.array([0.5, 0.5]), "sighted": np.array([0, 1])}
    _, run = recording(**twice, ranges=np.array([1.0, 2.0]), bearings=np.array([0.1, 0.2])).steps(longest=10.0)
    np.testing.assert_allclose(run.observations, [[1.0, 2.0, 0.1, 0.2]])
