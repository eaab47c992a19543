"""Files of the UWB labyrinth: what is read, and what is said of files that cannot be."""

import os
from pathlib import Path

import numpy as np
import pytest

from course_lib.recording import RecordingError, read_uwb

INPUT = """\
range2 0.1 2.95 0.01 -0.02 -0.01 105 0
odom2diff 0.1 0.10 0.30 0 0.08 0.0001 0.0001 0.0001
range2 0.2 1.60 0.01 -0.02 2.365 107 0
odom2diff 0.2 0.20 0.20 0 0.08 0.0001 0.0001 0.0001
range2 0.3 2.90 0.01 -0.02 -0.01 105 0
odom2diff 0.3 0 0 0 0.08 0.0001 0.0001 0.0001
"""
TRUTH = "point2 0.1 1.6 2.2 0 0 0 0\npoint2 0.2 1.7 2.2 0 0 0 0\npoint2 0.2 1.7 2.2 0 0 0 0\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "Indoor_UWB_Input.txt").write_text(INPUT)
    (tmp_path / "Indoor_UWB_GT.txt").write_text(TRUTH)
    return tmp_path


def test_what_is_read(folder):
    recording = read_uwb(folder)
    assert recording.clock == 0.1
    np.testing.assert_allclose(recording.odometry_times, [0.0, 0.1, 0.2])
    np.testing.assert_allclose(recording.landmarks, [[-0.02, -0.01], [-0.02, 2.365]])
    np.testing.assert_array_equal(recording.landmark_names, [105, 107])
    np.testing.assert_array_equal(recording.sighted, [0, 1, 0])
    np.testing.assert_allclose(recording.ranges, [2.95, 1.60, 2.90])
    assert np.isinf(recording.bearings).all()
    # A time that is there twice would make the truth between two values.
    np.testing.assert_allclose(recording.truth, [[1.6, 2.2, np.nan], [1.7, 2.2, np.nan]])


def test_the_first_wheel_is_the_left_one_and_the_number_half_their_distance(folder):
    recording = read_uwb(folder)
    np.testing.assert_allclose(recording.odometry, [[0.2, 0.2 / 0.16], [0.2, 0.0], [0.0, 0.0]])


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("range2 0.2", "range3 0.2", "line 3: a line must begin with range2 or odom2diff, not 'range3'"),
        ("1.60", "far", "line 3: could not convert string to float: 'far'"),
        ("0.30 0 0.08", "0.30 0.08", "line 2: 8 numbers expected"),
        ("2.90 0.01 -0.02", "2.90 0.01 -0.03", "anchor 105 is in two places"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_with_file_and_line(folder, old, new, message):
    assert old in INPUT
    (folder / "Indoor_UWB_Input.txt").write_text(INPUT.replace(old, new))
    with pytest.raises(RecordingError) as caught:
        read_uwb(folder)
    assert "Indoor_UWB_Input.txt" in str(caught.value) and message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_where_to_get_what_is_missing(folder):
    with pytest.raises(RecordingError, match="there is no folder .*nowhere: get datasets/Indoor_UWB of https"):
        read_uwb(folder / "nowhere")
    (folder / "Indoor_UWB_GT.txt").unlink()
    with pytest.raises(RecordingError, match="lacks Indoor_UWB_GT.txt"):
        read_uwb(folder)


def test_the_real_recording():
    data = os.environ.get("COURSE_DATA")
    if not data or not (Path(data) / "uwb").is_dir():
        pytest.skip("COURSE_DATA names no folder with uwb in it")
    recording = read_uwb(Path(data) / "uwb")
    assert (len(recording.ranges), len(recording.odometry), len(recording.landmarks)) == (233, 233, 4)
