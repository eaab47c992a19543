"""The labyrinth of TU Chemnitz: a small robot with wheel speeds and ultra-wideband ranges to four anchors.

References
----------
T. Pfeifer, P. Protzel, *Robust sensor fusion with self-tuning mixture models*, IROS 2018. The data are part of libRSF,
CC BY-SA 4.0.
"""

import numpy as np

from course_lib.recording.ground import GroundRecording
from course_lib.recording.text import RecordingError, data_folder, read_lines, to_table

SOURCE = "datasets/Indoor_UWB of https://github.com/TUC-ProAut/libRSF"
#: What follows the word that begins a line.
COLUMNS = {
    "range2": "time range variance x y anchor snr",
    "odom2diff": "time left right sideways half_track left_variance right_variance sideways_variance",
    "point2": "time x y xx xy yx yy",
}


def read_uwb(folder):
    """Read the labyrinth's recording.

    Its readme calls the first wheel velocity the right one and the fifth number the distance between the wheels. The
    robot turns the other way and half as fast: libRSF's own predictor (`PredictMotionDifferential2D`) takes the first
    for the left wheel and twice the number for the distance, and so does this reader.

    Parameters
    ----------
    folder : str or Path
        Holds `Indoor_UWB_Input.txt` and `Indoor_UWB_GT.txt`.

    Returns
    -------
    GroundRecording
        Bearings are `inf` and true headings NaN: neither was measured.

    Raises
    ------
    RecordingError
        The folder or a file is missing, a line is malformed, or an anchor is in two places.
    """
    names = ("Indoor_UWB_Input.txt", "Indoor_UWB_GT.txt")
    folder = data_folder(folder, names, SOURCE)
    readings = _read(folder / names[0], "range2", "odom2diff")
    ranges, odometry = readings["range2"], readings["odom2diff"]
    truth = _read(folder / names[1], "point2")["point2"]
    # The truth has one row a reading; a repeated time would make interpolation ambiguous.
    truth = truth[np.r_[True, np.diff(truth[:, 0]) > 0.0]]
    anchors, first, sighted = np.unique(ranges[:, 5], return_index=True, return_inverse=True)
    positions = ranges[first, 3:5]
    moved = (ranges[:, 3:5] != positions[sighted]).any(axis=1)
    if moved.any():
        anchor = ranges[np.argmax(moved), 5]
        raise RecordingError(f"{folder / names[0]}: anchor {anchor:.0f} is in two places: give them two numbers")
    left, right, half_track = odometry[:, 1], odometry[:, 2], odometry[:, 4]
    clock = odometry[0, 0]
    return GroundRecording(
        name="UWB labyrinth",
        clock=clock,
        odometry_times=odometry[:, 0] - clock,
        odometry=np.column_stack([(left + right) / 2.0, (right - left) / (2.0 * half_track)]),
        sighting_times=ranges[:, 0] - clock,
        sighted=sighted,
        ranges=ranges[:, 1],
        bearings=np.full(len(ranges), np.inf),
        landmarks=positions,
        landmark_names=anchors.astype(int),
        truth_times=truth[:, 0] - clock,
        truth=np.column_stack([truth[:, 1:3], np.full(len(truth), np.nan)]),
    )


def _read(path, *kinds):
    """A table for each kind of line in a file that must hold these and no other."""
    lines = {kind: [] for kind in kinds}
    for number, (kind, *words) in read_lines(path):
        if kind not in lines:
            raise RecordingError(
                f"{path}, line {number}: a line must begin with {' or '.join(kinds)}, not {kind!r}: delete the line"
            )
        lines[kind].append((number, words))
    return {kind: to_table(path, lines[kind], COLUMNS[kind].split()) for kind in kinds}
