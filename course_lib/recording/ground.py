"""What a robot on a plane recorded: its odometry, what it saw of landmarks, and where it was."""

from dataclasses import dataclass

import numpy as np

from course_lib.angles import wrap
from course_lib.recording.run import Run


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

    def integrated(self, column, times, delay=0.0):
        """Integral of an odometry reading from its first on.

        Parameters
        ----------
        column : int
            0 for the velocity, 1 for the yaw rate.
        times : ndarray, shape (N,)
            Seconds.
        delay : float
            How long after a reading's time it begins to hold (s).

        Returns
        -------
        ndarray, shape (N,)
            In metres or radians; constant outside the recorded times.
        """
        total = np.cumsum(self.odometry[:-1, column] * np.diff(self.odometry_times))
        return np.interp(times, self.odometry_times + delay, np.concatenate([[0.0], total]))

    def steps(self, delay=0.0, longest=0.2):
        """The recording as a run, while both odometry and truth last: a step ends at each sighting, or sooner.

        Parameters
        ----------
        delay : float
            How long after a reading's time the robot follows it (s).
        longest : float
            Steps also end at multiples of this time (s) after the start, so that none is longer.

        Returns
        -------
        times : ndarray, shape (T + 1,)
            Seconds; of the run's states.
        run : Run
            Truth: x, y, θ as `truth_at` interpolates them. Controls: mean forward velocity, mean yaw rate and duration
            of the step. Observations: the range to each of the L landmarks, then the bearing to each. Sightings of the
            first instant are left out; of two of one landmark at one time the last is taken.
        """
        begin = max(self.odometry_times[0] + delay, self.truth_times[0])
        end = min(self.odometry_times[-1], self.truth_times[-1])
        within = (begin < self.sighting_times) & (self.sighting_times <= end)
        sighting_times, sighted = self.sighting_times[within], self.sighted[within]
        times = np.union1d(np.arange(begin, end, longest), sighting_times)
        durations = np.diff(times)
        means = [np.diff(self.integrated(column, times, delay)) / durations for column in (0, 1)]
        count = len(self.landmarks)
        observations = np.full((len(durations), 2 * count), np.inf)
        step = np.searchsorted(times, sighting_times) - 1
        observations[step, sighted] = self.ranges[within]
        observations[step, count + sighted] = self.bearings[within]
        return times, Run(self.truth_at(times), observations, np.column_stack([*means, durations]))
