"""The quadrotor's world: flies the truth along random waypoints and draws what the sensors make of it."""

from dataclasses import dataclass

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.constants import ALTITUDE, BEARINGS, RANGES, YAW, Constants, Hidden
from course_lib.recording import Run


@dataclass(frozen=True)
class World:
    """A room, its beacons and its vehicle.

    Attributes
    ----------
    constants : Constants
        What an estimator is told.
    hidden : Hidden
        What it is not.
    """

    constants: Constants = Constants()
    hidden: Hidden = Hidden()

    def simulate(self, rng):
        """Draw one run.

        Truth and sensors have separate streams: the same vehicle flies whatever the sensors are. Its controller knows
        the true state. An estimator that takes the thrusts as given and does not ask why they were chosen is none the
        less consistent where it is linear: its errors do not depend on them.

        Parameters
        ----------
        rng : numpy.random.Generator

        Returns
        -------
        Run
            `truth` (T + 1, 12), `observations` (T, 11) with `inf` for what is missing, `controls` (T, 4), the
            commanded thrusts in N.
        """
        motion, sensing = rng.spawn(2)
        constants, hidden = self.constants, self.hidden
        controls = np.empty((hidden.steps, 4))
        truth = np.empty((hidden.steps + 1, 12))
        truth[0] = models.sample_prior(1, constants, motion)[0]
        hold = max(round(hidden.interval / constants.Ts), 1)
        for k in range(hidden.steps):
            if k % hold == 0:
                target = self._waypoint(motion)
            controls[k] = quadrotor.fly_to(truth[k], target, constants)
            truth[k + 1] = models.transition(truth[k : k + 1], controls[k], constants, motion, hidden.gain)[0]
        return Run(truth, self._observe(truth[1:], sensing), controls)

    def _waypoint(self, rng):
        """x, y, z and yaw of a random target, shape (4,)."""
        constants = self.constants
        x, y = self.hidden.reach * constants.R / 2 * rng.uniform(-1.0, 1.0, 2)
        return np.array([x, y, constants.h * rng.uniform(0.25, 0.75), rng.uniform(-np.pi, np.pi)])

    def _observe(self, states, rng):
        """Readings of all sensors at each state, shape (T, 11)."""
        constants, hidden = self.constants, self.hidden
        readings = models.observe(states, constants)
        readings += constants.sigma_z * rng.standard_normal(readings.shape)
        readings[:, RANGES] += hidden.bias
        readings[:, BEARINGS] = wrap(readings[:, BEARINGS])
        missing = rng.random(readings.shape) < hidden.outage
        missing[:, ALTITUDE] = False
        missing[:, [column for beacon in hidden.dead for column in (beacon, 4 + beacon)]] = True
        readings[missing] = np.inf
        return np.column_stack([readings, self._look(states, rng)])

    def _look(self, states, rng):
        """Horizontal range and bearing of the obstacle's point nearest to each state, shape (T, 2)."""
        constants = self.constants
        noise = rng.standard_normal((len(states), 2)) * [constants.sigma_r, constants.sigma_beta]
        if not self.hidden.obstacles:
            return np.full_like(noise, np.inf)
        boxes = np.array(self.hidden.obstacles)
        offset = np.clip(states[:, None, :2], boxes[:, :2], boxes[:, 3:5]) - states[:, None, :2]
        distance = np.linalg.norm(offset, axis=2)
        # A sensor that looks level sees no box that ends below it or begins above it.
        level = (boxes[:, 2] <= states[:, None, 2]) & (states[:, None, 2] <= boxes[:, 5])
        distance[~level | (distance > self.hidden.sight)] = np.inf
        nearest = np.argmin(distance, axis=1)
        rows = np.arange(len(states))
        bearing = np.arctan2(offset[rows, nearest, 1], offset[rows, nearest, 0]) - states[:, YAW]
        seen = np.column_stack([distance[rows, nearest] + noise[:, 0], wrap(bearing + noise[:, 1])])
        seen[~np.isfinite(distance[rows, nearest])] = np.inf
        return seen
