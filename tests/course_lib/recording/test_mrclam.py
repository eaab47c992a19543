"""Files in the MRCLAM format: what is read, and what is said of files that cannot be."""

import os
from pathlib import Path

import numpy as np
import pytest

from course_lib.recording import RecordingError, read_mrclam

FILES = {
    "Barcodes.dat": "# Subject #    Barcode #\n  1 \t 5\n  2 \t 14\n  6 \t 63\n  7 \t 81\n",
    "Landmark_Groundtruth.dat": "# Subject #\n  6 \t 0.5 \t -4.0 \t 0.1 \t 0.2\n  7 \t 1.5 \t 2.0 \t 0.1 \t 0.1\n",
    "Robot3_Odometry.dat": "# Time [s]\n100.5 \t 0.1 \t -0.4\n100.6 \t 0.2 \t  0.0\n",
    "Robot3_Measurement.dat": "100.55 63 3.0 0.1\n100.55 5 2.0 0.2\n100.6 81 1.0 -0.3\n100.7 99 1.0 0.0\n",
    "Robot3_Groundtruth.dat": "100.0 1.0 2.0 6.2\n100.6 1.1 2.1 0.1\n",
}


@pytest.fixture
def folder(tmp_path):
    """A data set of two landmarks and two robots, of which robot 3's files are there."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def change(folder, name, old, new):
    path = folder / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_what_is_read(folder):
    recording = read_mrclam(folder, 3)
    assert recording.clock == 100.5
    np.testing.assert_allclose(recording.odometry_times, [0.0, 0.1], atol=1e-9)
    np.testing.assert_allclose(recording.odometry, [[0.1, -0.4], [0.2, 0.0]])
    np.testing.assert_allclose(recording.sighting_times, [0.05, 0.1], atol=1e-9)
    np.testing.assert_array_equal(recording.sighted, [0, 1])
    np.testing.assert_allclose(recording.ranges, [3.0, 1.0])
    np.testing.assert_allclose(recording.bearings, [0.1, -0.3])
    np.testing.assert_allclose(recording.landmarks, [[0.5, -4.0], [1.5, 2.0]])
    np.testing.assert_array_equal(recording.landmark_names, [6, 7])
    np.testing.assert_allclose(recording.truth_times, [-0.5, 0.1], atol=1e-9)
    np.testing.assert_allclose(recording.truth, [[1.0, 2.0, 6.2 - 2.0 * np.pi], [1.1, 2.1, 0.1]])


def test_other_robots_and_misread_barcodes_are_dropped_and_counted(folder):
    recording = read_mrclam(folder, 3)
    assert (recording.dropped_robots, recording.dropped_unknown) == (1, 1)


@pytest.mark.parametrize(
    "name, old, new, message",
    [
        ("Robot3_Odometry.dat", "0.2", "0.2x", "line 3: could not convert string to float: '0.2x'"),
        ("Robot3_Odometry.dat", "100.6", "100.4", "line 3: time goes back"),
        ("Robot3_Odometry.dat", "0.2", "nan", "line 3: a number is not finite"),
        ("Robot3_Measurement.dat", "81 1.0", "81", "line 3: 4 numbers expected (time barcode range bearing), 3 found"),
        ("Robot3_Groundtruth.dat", "100.6 1.1 2.1 0.1", "100.6 1.1 2.1 0.1 7", "line 2: 4 numbers expected"),
        ("Landmark_Groundtruth.dat", "  7 ", "  8 ", "lacks subject 7 of Barcodes.dat"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_with_file_and_line(folder, name, old, new, message):
    change(folder, name, old, new)
    with pytest.raises(RecordingError) as caught:
        read_mrclam(folder, 3)
    assert name in str(caught.value) and message in str(caught.value) and ": " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_barcodes_of_another_data_set_are_noticed(folder):
    change(folder, "Barcodes.dat", "63", "64")
    change(folder, "Barcodes.dat", "81", "82")
    with pytest.raises(RecordingError, match="none of its barcodes belongs to a landmark"):
        read_mrclam(folder, 3)


def test_an_empty_file_is_refused(folder):
    (folder / "Robot3_Measurement.dat").write_text("# nothing\n")
    with pytest.raises(RecordingError, match="Robot3_Measurement.dat holds no line of time barcode range bearing"):
        read_mrclam(folder, 3)


def test_a_file_that_is_not_text_is_refused(folder):
    (folder / "Barcodes.dat").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordingError, match="Barcodes.dat cannot be read"):
        read_mrclam(folder, 3)


def test_where_to_get_what_is_missing(folder):
    with pytest.raises(RecordingError, match="there is no folder .*nowhere: get a data set of http://asrl.utias"):
        read_mrclam(folder / "nowhere", 3)
    with pytest.raises(RecordingError, match="lacks Robot1_Odometry.dat, Robot1_Measurement.dat, Robot1_Ground"):
        read_mrclam(folder, 1)
    with pytest.raises(RecordingError, match="there is no robot 6 in MRCLAM: choose one of 1 to 5"):
        read_mrclam(folder, 6)


def test_the_real_data_set():
    data = os.environ.get("COURSE_DATA")
    if not data or not (Path(data) / "mrclam6").is_dir():
        pytest.skip("COURSE_DATA names no folder with mrclam6 in it")
    recording = read_mrclam(Path(data) / "mrclam6", 3)
    assert len(recording.odometry) == 61158 and len(recording.truth) == 56977
    assert (len(recording.ranges), recording.dropped_robots, recording.dropped_unknown) == (4348, 1277, 2)
    assert recording.landmarks.shape == (15, 2)
