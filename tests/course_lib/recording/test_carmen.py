"""CARMEN logs: what is read, and what is said of logs that cannot be."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from course_lib.recording import RecordingError, read_carmen

LINES = (
    "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
    "PARAM robot_length 0.40 nohost 0",
    "ODOM 0.0 0.0 0.0 0.1 0.2 0.0 99.5 host 0.5",
    "FLASER 3 1.0 2.5 81.83 5.0 6.0 3.2 0.5 0.6 -0.1 100.0 host 1.0",
    "FLASER 3 1.1 2.4 90.00 5.1 6.1 3.1 0.6 0.7 -0.2 100.5 host 1.5",
)
ROBOTLASER = (
    "ROBOTLASER1 0 -0.5 1.0 0.5 8.0 0.01 0 3 1.0 8.0 2.0 2 7 9 5.0 6.0 3.2 0.5 0.6 -0.1 0 0 0 0 0 50.0 host 1.0"
)


def log(folder, lines=LINES, name="run.clf"):
    path = folder / name
    text = "\n".join(lines) + "\n"
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return path


@pytest.mark.parametrize("name", ["run.clf", "run.log", "run.clf.gz"])
def test_what_is_read(tmp_path, name):
    path = log(tmp_path, name=name)
    (tmp_path / "notes.txt").write_text("not a log")
    for where in (tmp_path, str(path)):
        recording = read_carmen(where)
        assert recording.name == name
        np.testing.assert_array_equal(recording.times, [0.0, 0.5])
        np.testing.assert_array_equal(recording.ranges, [[1.0, 2.5, np.inf], [1.1, 2.4, np.inf]])
        np.testing.assert_allclose(recording.corrected, [[5.0, 6.0, 3.2 - 2.0 * np.pi], [5.1, 6.1, 3.1]])
        np.testing.assert_allclose(recording.odometry, [[0.5, 0.6, -0.1], [0.6, 0.7, -0.2]])
        assert recording.ignored == {"#": 1, "PARAM": 1, "ODOM": 1}


@pytest.mark.parametrize("beams, last", [(180, 89.0), (181, 90.0), (361, 90.0)])
def test_beams_are_a_degree_apart_or_half_of_one(tmp_path, beams, last):
    line = f"FLASER {beams} {'1.0 ' * beams} 0 0 0 0 0 0 1.0 host 1.0"
    bearings = np.degrees(read_carmen(log(tmp_path, [line])).bearings)
    np.testing.assert_allclose(bearings[[0, -1]], [-90.0, last])


def test_newer_scans_are_read_where_there_are_no_older_ones(tmp_path):
    recording = read_carmen(log(tmp_path, [ROBOTLASER]))
    np.testing.assert_allclose(recording.bearings, [-0.5, 0.0, 0.5])
    np.testing.assert_array_equal(recording.ranges, [[1.0, np.inf, 2.0]])
    np.testing.assert_allclose(recording.corrected, [[5.0, 6.0, 3.2 - 2.0 * np.pi]])
    np.testing.assert_allclose(recording.odometry, [[0.5, 0.6, -0.1]])
    both = read_carmen(log(tmp_path, [*LINES, ROBOTLASER]))
    assert len(both.times) == 2 and both.ignored["ROBOTLASER1"] == 1


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("2.4", "2.4x", "line 5: could not convert string to float: '2.4x'"),
        ("2.4", "nan", "line 5: a number is not finite"),
        ("2.4", "-2.4", "line 5: a range is negative"),
        ("1.1 2.4", "2.4", "line 5: 14 words expected in this FLASER, 13 found"),
        ("FLASER 3 1.1", "FLASER x 1.1", "line 5: a number of readings expected as word 2, x found"),
        ("FLASER 3 1.1", "FLASER 99999999 1.1", "line 5: a number of readings expected"),
        (LINES[4], "FLASER", "line 5: a number of readings expected as word 2, nothing found"),
        ("100.5", "99.5", "line 5: time goes back"),
        ("FLASER 3 1.1", "FLASER 4 1.1 1.1", "line 5: other beams than in the scan before"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_with_file_and_line(tmp_path, old, new, message):
    path = log(tmp_path, [line.replace(old, new) for line in LINES])
    with pytest.raises(RecordingError) as caught:
        read_carmen(path)
    assert "run.clf" in str(caught.value) and message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("cut", [20, -6])
def test_newer_scans_that_are_cut_short(tmp_path, cut):
    with pytest.raises(RecordingError, match="line 1: "):
        read_carmen(log(tmp_path, [ROBOTLASER[:cut]]))


def test_logs_that_are_not_there(tmp_path):
    with pytest.raises(RecordingError, match="must hold one CARMEN log, but holds none"):
        read_carmen(tmp_path)
    with pytest.raises(RecordingError, match="gone.clf cannot be read"):
        read_carmen(tmp_path / "gone.clf")
    log(tmp_path)
    log(tmp_path, name="other.log")
    with pytest.raises(RecordingError, match=r"holds other\.log, run\.clf"):
        read_carmen(tmp_path)


def test_logs_that_cannot_be_read(tmp_path):
    with pytest.raises(RecordingError, match="holds no FLASER or ROBOTLASER1 message"):
        read_carmen(log(tmp_path, LINES[:3]))
    path = log(tmp_path, name="cut.clf.gz")
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(RecordingError, match=r"cut\.clf\.gz cannot be read"):
        read_carmen(path)
    path.write_bytes(b"FLASER, but not compressed")
    with pytest.raises(RecordingError, match=r"cut\.clf\.gz cannot be read"):
        read_carmen(path)
    (tmp_path / "bytes.log").write_bytes(b"\xff\xfe")
    with pytest.raises(RecordingError, match=r"bytes\.log cannot be read"):
        read_carmen(tmp_path / "bytes.log")


@pytest.mark.skipif("COURSE_DATA" not in os.environ, reason="COURSE_DATA names no folder of recordings")
def test_the_intel_log():
    recording = read_carmen(Path(os.environ["COURSE_DATA"]) / "intel")
    assert recording.ranges.shape == (910, 180) and recording.ignored == {"#": 2}
