"""CARMEN logs: a robot that carries a laser scanner, as they are found in Radish, the robotics data set repository.

A line is a message: its name, its fields, and when and where it was sent. Of a log corrected by SLAM, the laser's pose
in `FLASER` is the corrected one; of a raw log it is odometry, as the second pose always is.

References
----------
M. Montemerlo, N. Roy, S. Thrun, *Perspectives on standardization in mobile robot programming: the Carnegie Mellon
navigation (CARMEN) toolkit*, IROS 2003. D. Hähnel, *Intel Research Lab*, Radish, 2003.
"""

import gzip
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from course_lib.angles import wrap
from course_lib.recording.text import RecordingError

SOURCE = "a log of Radish, e.g. of the Intel Research Lab,"
ENDINGS = (".clf", ".log", ".clf.gz", ".log.gz")
#: What a SICK scanner says when nothing came back (m).
MAXIMUM = 81.83


@dataclass(frozen=True, eq=False)
class LaserRecording:
    """M scans of B beams, and where the robot was.

    Attributes
    ----------
    name : str
        The file that was read.
    times : ndarray, shape (M,)
        Seconds from the first scan; not decreasing.
    ranges : ndarray, shape (M, B)
        Metres; `inf` where nothing came back.
    bearings : ndarray, shape (B,)
        Directions of the beams (rad), counter-clockwise from the heading.
    odometry : ndarray, shape (M, 3)
        x, y (m), heading (rad, in [-π, π)) as the wheels have it.
    corrected : ndarray, shape (M, 3)
        The same as SLAM has it, in the frame of the map; odometry again in a log that was not corrected.
    ignored : dict of str to int
        Messages that were not read: how many of each.
    """

    name: str
    times: np.ndarray
    ranges: np.ndarray
    bearings: np.ndarray
    odometry: np.ndarray
    corrected: np.ndarray
    ignored: dict = field(default_factory=dict)


def read_carmen(path, maximum=MAXIMUM):
    """Read the scans of a log.

    They are the `FLASER` messages, or the `ROBOTLASER1` ones where there are none. All others, among them `PARAM` and
    `ODOM` (each scan comes with the odometry of its time), are counted.

    Parameters
    ----------
    path : str or Path
        A log (.clf or .log, also with .gz after it), or a folder that holds one.
    maximum : float
        Readings of this and above mean that nothing came back (m). `ROBOTLASER1` says itself what its largest range is;
        the smaller of the two holds.

    Returns
    -------
    LaserRecording

    Raises
    ------
    RecordingError
        There is no log, or more than one, or it cannot be read; or a line in it is malformed.
    """
    path = _log(Path(path))
    messages, comments = [], 0
    for number, line in enumerate(_text(path).splitlines(), 1):
        if line.lstrip().startswith("#"):
            comments += 1
        elif words := line.split():
            messages.append((number, words))
    counts = Counter(words[0] for _, words in messages)
    kind = next((name for name in _READERS if counts[name]), None)
    if kind is None:
        raise RecordingError(f"{path} holds no {' or '.join(_READERS)} message: get {SOURCE} or one with scans in it")
    scans = [_scan(path, number, words, maximum) for number, words in messages if words[0] == kind]
    _check(path, [number for number, words in messages if words[0] == kind], scans)
    times, ranges, bearings, odometry, corrected = (np.array(column) for column in zip(*scans, strict=True))
    ignored = {name: count for name, count in counts.items() if name != kind}
    if comments:
        ignored["#"] = comments
    odometry[:, 2], corrected[:, 2] = wrap(odometry[:, 2]), wrap(corrected[:, 2])
    return LaserRecording(path.name, times - times[0], ranges, bearings[0], odometry, corrected, ignored)


def _log(path):
    if not path.is_dir():
        return path
    logs = sorted(file for file in path.iterdir() if file.name.lower().endswith(ENDINGS))
    if len(logs) != 1:
        names = ", ".join(log.name for log in logs) or f"none that ends in {', '.join(ENDINGS)}"
        raise RecordingError(f"{path} must hold one CARMEN log, but holds {names}: get {SOURCE} or name the file")
    return logs[0]


def _text(path):
    try:
        data = path.read_bytes()
        return (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read ({error}): copy it again from its source") from None


def _scan(path, number, words, maximum):
    """Time, ranges, bearings, odometry and corrected pose of one message."""
    try:
        time, ranges, bearings, odometry, corrected, maximum = _READERS[words[0]](words, maximum)
    except _MalformedError as error:
        raise RecordingError(f"{path}, line {number}: {error}: mend or delete the line") from None
    return time, np.where(ranges >= maximum, np.inf, ranges), bearings, odometry, corrected


class _MalformedError(ValueError):
    pass


def _flaser(words, maximum):
    # FLASER n r_1 .. r_n x y θ odom_x odom_y odom_θ t host t
    beams = _count(words, 1)
    _check_length(words, 2 + beams + 9)
    ranges = _ranges(words[2 : 2 + beams])
    numbers = _numbers(words[2 + beams : 2 + beams + 7])
    # Nothing in the message says so: scanners of this time cover 180°, in steps of 1° or (361 beams) half of it.
    bearings = -np.pi / 2 + np.pi / (beams - beams % 2) * np.arange(beams)
    return numbers[6], ranges, bearings, numbers[3:6], numbers[:3], maximum


def _robotlaser(words, maximum):
    # ROBOTLASER1 type start fov step maximum accuracy mode n r_1 .. r_n m remission_1 .. remission_m
    #   laser_x laser_y laser_θ robot_x robot_y robot_θ tv rv forward side turn_axis t host t
    beams = _count(words, 8)
    remissions = _count(words, 9 + beams, least=0)
    after = 9 + beams + 1 + remissions
    _check_length(words, after + 14)
    start, _, step, largest = _numbers(words[2:6])
    ranges = _ranges(words[9 : 9 + beams])
    numbers = _numbers(words[after : after + 12])
    bearings = start + step * np.arange(beams)
    return numbers[11], ranges, bearings, numbers[3:6], numbers[:3], min(maximum, largest)


_READERS = {"FLASER": _flaser, "ROBOTLASER1": _robotlaser}


def _count(words, position, least=2):
    word = words[position] if position < len(words) else "nothing"
    if not (word.isascii() and word.isdigit() and least <= int(word) <= 100_000):
        raise _MalformedError(f"a number of readings expected as word {position + 1}, {word} found")
    return int(word)


def _check_length(words, expected):
    if len(words) != expected:
        raise _MalformedError(f"{expected} words expected in this {words[0]}, {len(words)} found")


def _numbers(words):
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError as error:
        raise _MalformedError(str(error)) from None
    if not np.isfinite(numbers).all():
        raise _MalformedError("a number is not finite")
    return numbers


def _ranges(words):
    ranges = _numbers(words)
    if (ranges < 0.0).any():
        raise _MalformedError("a range is negative")
    return ranges


def _check(path, numbers, scans):
    for number, before, scan in zip(numbers[1:], scans, scans[1:], strict=False):
        if scan[0] < before[0]:
            raise RecordingError(f"{path}, line {number}: time goes back: sort the file by its time column")
        if not np.array_equal(scan[2], before[2]):
            raise RecordingError(f"{path}, line {number}: other beams than in the scan before: one scanner to a file")
