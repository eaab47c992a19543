"""UTIAS MRCLAM: wheeled robots with a camera among barcoded landmarks, with motion-capture truth.

References
----------
K. Y. K. Leung, Y. Halpern, T. D. Barfoot, H. H. T. Liu, *The UTIAS multi-robot cooperative localization and mapping
dataset*, International Journal of Robotics Research 30(8), 2011. For educational use.
"""

import numpy as np

from course_lib.angles import wrap
from course_lib.recording.ground import GroundRecording
from course_lib.recording.text import RecordingError, data_folder, read_lines, to_table

SOURCE = "a data set of http://asrl.utias.utoronto.ca/datasets/mrclam"
#: Subjects 1 to 5 are the robots themselves.
ROBOTS = 5


def read_mrclam(folder, robot):
    """Read what one robot of a data set recorded.

    Velocities are the commands the robot was given, which it follows late. Sightings name a barcode; those of other
    robots and of barcodes that belong to nothing (misread) are dropped and counted.

    Parameters
    ----------
    folder : str or Path
        Holds `Barcodes.dat`, `Landmark_Groundtruth.dat` and `RobotN_Groundtruth.dat`, `RobotN_Measurement.dat`,
        `RobotN_Odometry.dat`.
    robot : int
        N, from 1 to 5.

    Returns
    -------
    GroundRecording

    Raises
    ------
    RecordingError
        The folder or a file is missing, or a line in one is malformed, or the landmarks are not those of the barcodes.
    """
    if robot not in range(1, ROBOTS + 1):
        raise RecordingError(f"there is no robot {robot} in MRCLAM: choose one of 1 to {ROBOTS}")
    own = [f"Robot{robot}_{what}.dat" for what in ("Odometry", "Measurement", "Groundtruth")]
    folder = data_folder(folder, ["Barcodes.dat", "Landmark_Groundtruth.dat", *own], SOURCE)
    landmarks = _read(folder, "Landmark_Groundtruth.dat", "subject x y x_deviation y_deviation")
    names = landmarks[:, 0].astype(int)
    rows_of_barcodes = _rows_of_barcodes(folder, names)
    odometry = _read(folder, own[0], "time velocity yaw_rate")
    sightings = _read(folder, own[1], "time barcode range bearing")
    truth = _read(folder, own[2], "time x y heading")
    clock = odometry[0, 0]

    rows = np.array([rows_of_barcodes.get(barcode, -2) for barcode in sightings[:, 1]])
    kept = sightings[rows >= 0]
    if not len(kept):
        raise RecordingError(
            f"{folder / own[1]}: none of its barcodes belongs to a landmark: Barcodes.dat must be of the same data set"
        )
    return GroundRecording(
        name=f"MRCLAM robot {robot}",
        clock=clock,
        odometry_times=odometry[:, 0] - clock,
        odometry=odometry[:, 1:],
        sighting_times=kept[:, 0] - clock,
        sighted=rows[rows >= 0],
        ranges=kept[:, 2],
        bearings=wrap(kept[:, 3]),
        landmarks=landmarks[:, 1:3],
        landmark_names=names,
        truth_times=truth[:, 0] - clock,
        truth=np.column_stack([truth[:, 1:3], wrap(truth[:, 3])]),
        dropped_robots=int(np.sum(rows == -1)),
        dropped_unknown=int(np.sum(rows == -2)),
    )


def _read(folder, name, columns):
    path = folder / name
    return to_table(path, read_lines(path), columns.split())


def _rows_of_barcodes(folder, names):
    """Row of the landmark that carries each barcode; -1 for those of robots."""
    rows = {name: row for row, name in enumerate(names)}
    barcodes = {}
    for subject, barcode in _read(folder, "Barcodes.dat", "subject barcode"):
        if subject > ROBOTS and subject not in rows:
            raise RecordingError(
                f"{folder / 'Landmark_Groundtruth.dat'} lacks subject {subject:.0f} of Barcodes.dat: "
                "take both files from the same data set"
            )
        barcodes[barcode] = -1 if subject <= ROBOTS else rows[subject]
    return barcodes
