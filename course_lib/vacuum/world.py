"""The world of the two vacuum robots: draws the truth and what the sensors make of it."""

from dataclasses import dataclass

import numpy as np

from course_lib.recording import Run
from course_lib.vacuum import models
from course_lib.vacuum.constants import Constants, Hidden


@dataclass(frozen=True)
class World:
    """A room, its robots and its sensors.

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

        Truth and sensors have separate streams: the same robots drive whatever the sensors are.

        Parameters
        ----------
        rng : numpy.random.Generator

        Returns
        -------
        Run
            `truth` (T + 1, 6) with columns x_A, y_A, θ_A, x_B, y_B, θ_B; `observations` (T, 4) in metres, `inf` where a
            sensor is silent; `controls` (T, 2), the speeds u_A, u_B in m/s.
        """
        motion, sensing = rng.spawn(2)
        steps = self.hidden.steps
        controls = np.column_stack([self._speeds(motion), self._speeds(motion)])
        truth = np.empty((steps + 1, 6))
        truth[0] = models.prior(1, self.constants, motion)[0]
        for k in range(steps):
            truth[k + 1] = models.transition(truth[k : k + 1], controls[k], self.constants, motion)[0]
        return Run(truth, self._observe(truth[1:], sensing), controls)

    def simulate_many(self, rng, size):
        """Draw many truths under the same speeds, while all sensors are silent: what a filter has to predict.

        Parameters
        ----------
        rng : numpy.random.Generator
        size : int
            Number of truths M.

        Returns
        -------
        Run
            `truth` (T + 1, M, 6), `observations` (T, 4) all `inf`, `controls` (T, 2).
        """
        steps = self.hidden.steps
        controls = np.column_stack([self._speeds(rng), self._speeds(rng)])
        truth = np.empty((steps + 1, size, 6))
        truth[0] = models.prior(size, self.constants, rng)
        for k in range(steps):
            truth[k + 1] = models.transition(truth[k], controls[k], self.constants, rng)
        return Run(truth, np.full((steps, 4), np.inf), controls)

    def _speeds(self, rng):
        """Piecewise constant speeds of one robot, shape (T,)."""
        hidden = self.hidden
        # Enough segments even if each is the shortest.
        count = -(-hidden.steps // hidden.shortest_segment)
        lengths = rng.integers(hidden.shortest_segment, hidden.longest_segment, size=count, endpoint=True)
        speeds = rng.uniform(hidden.slowest, hidden.fastest, size=count)
        return np.repeat(speeds, lengths)[: hidden.steps]

    def _observe(self, states, rng):
        """Readings of the four sensors at each state, shape (T, 4)."""
        constants = self.constants
        shape = (len(states), 4)
        tuned_to = np.array([0, 0, 1, 1])
        wrong = rng.random(shape) < constants.s_bar
        measured = np.where(wrong, 1 - tuned_to, tuned_to)
        distance = np.take_along_axis(models.distances(states, constants), measured[:, None, :], axis=1)[:, 0]
        readings = distance + models.triangular_noise(rng.random(shape), constants.w_bar)
        return np.where(rng.random(shape) < self.hidden.report_probability, readings, np.inf)
