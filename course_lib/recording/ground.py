"""What a robot on a plane recorded: its odometry, what it saw of landmarks, and where it was."""

from dataclasses import dataclass

import numpy as np

from course_lib.angles import wrap


@dataclass(frozen=True, eq=False)
class GroundRecording:
    """One robot's recording: K odometry readings, M sightings of L landmarks, G true poses.

    Times are in seconds from the first odometry reading and do not decrease. Positions are in the frame of the
    landmarks; headings counter-clockwise from its x-axis.

    Attributes
    ----------
    name : str
        What was read.
    clock : float
        What the recording's own clock said at time 0 (s).
    odometry_times : ndarray, shape (K,)
    odometry : ndarray, shape (K, 2)
        Forward velocity (m/s) and yaw rate (rad/s), which hold until the next reading.
    sighting_times : ndarray, shape (M,)
    sighted : ndarray of int, shape (M,)
        Which row of `landmarks`.
    ranges : ndarray, shape (M,)
        Metres, as the sensor gives them.
    bearings : ndarray, shape (M,)
        Radians, counter-clockwise from the robot's heading; `inf` where the sensor measures ranges only.
    landmarks : ndarray, shape (L, 2)
        Positions (m).
    landmark_names : ndarray of int, shape (L,)
        The recording's own numbers for them.
    truth_times : ndarray, shape (G,)
        Strictly increasing.
    truth : ndarray, shape (G, 3)
        x, y (m) and heading (rad, in [-π, π)); NaN where no heading was recorded.
    dropped_robots, dropped_unknown : int
        Sightings left out: of other robots, and of numbers that belong to nothing (misread barcodes).
    """

    name: str
    clock: float
    odometry_times: np.ndarray
    odometry: np.ndarray
    sighting_times: np.ndarray
    sighted: np.ndarray
    ranges: np.ndarray
    bearings: np.ndarray
    landmarks: np.ndarray
    landmark_names: np.ndarray
    truth_times: np.ndarray
    truth: np.ndarray
    dropped_robots: int = 0
    dropped_unknown: int = 0

    def truth_at(self, times):
        """True poses at other times than those recorded, linear in between; the heading along the shorter arc.

        Parameters
        ----------
        times : array_like, shape (N,)
            Seconds.

        Returns
        -------
        ndarray, shape (N, 3)
            NaN before the first and after the last true pose.
        """
        # Unwrapped, the heading has no seam: from 3.1 to -3.1 it passes π, not 0.
        columns = (self.truth[:, 0], self.truth[:, 1], np.unwrap(self.truth[:, 2]))
        poses = np.column_stack(
            [np.interp(times, self.truth_times, column, left=np.nan, right=np.nan) for column in columns]
        )
        poses[:, 2] = wrap(poses[:, 2])
        return poses
