"""The world of the DR20: draws where it drives, where it is carried, and what its beams read."""

from dataclasses import dataclass, replace

import numpy as np

from course_lib.dr20 import models
from course_lib.dr20.constants import Constants, Hidden
from course_lib.recording import Run

#: A kidnapped robot finds itself at least this far away, in metres.
CARRIED = 2.0
#: A driver who looks turns away from what is nearer than this ahead, in metres beyond the robot's radius.
AHEAD = 0.3
#: How fast it then turns on the spot, in rad/s.
AWAY = 1.0
#: What is ahead: beams within this angle of the heading, in radians.
FRONT = np.pi / 3


@dataclass(frozen=True)
class World:
    """A map, a robot in it and its beams.

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

        In each step the robot is first carried elsewhere, if this is the time; then the command acts; then the beams
        are read. Driving, carrying and reading have separate streams.

        Parameters
        ----------
        rng : numpy.random.Generator

        Returns
        -------
        Run
            `truth` (T + 1, 3) with columns x, y, θ; `observations` (T, B) in metres, `inf` where a beam sees nothing;
            `controls` (T, 2), commanded v in m/s and ω in rad/s.
        """
        constants, hidden = self.constants, self.hidden
        motion, carrying, sensing = rng.spawn(3)
        executed = _noisier(constants, hidden.slip)
        kidnappings = set(self._kidnappings(carrying))
        driver = self._driver(motion)
        truth, controls = np.empty((hidden.steps + 1, 3)), np.empty((hidden.steps, 2))
        truth[0] = models.prior(1, constants, motion)[0]
        for k in range(hidden.steps):
            pose = truth[k : k + 1]
            controls[k] = driver(pose)
            if k in kidnappings:
                pose = self._elsewhere(pose, carrying)
            truth[k + 1] = models.transition(pose, controls[k], executed, motion)[0]
        readings = models.read(models.distances(truth[1:], constants), constants, sensing)
        readings[:, list(hidden.dead)] = np.inf
        return Run(truth, readings, controls)

    def _kidnappings(self, rng):
        """The steps before which the robot is carried elsewhere, shape (hidden.kidnaps,)."""
        part = self.hidden.steps / max(self.hidden.kidnaps, 1)
        return (part * (np.arange(self.hidden.kidnaps) + rng.uniform(0.25, 0.75, self.hidden.kidnaps))).astype(int)

    def _elsewhere(self, pose, rng):
        """A free pose away from this one, shape (1, 3)."""
        candidates = models.anywhere(1000, self.constants, rng)
        away = np.hypot(*(candidates - pose)[:, :2].T) >= CARRIED
        if not away.any():
            raise ValueError(f"no free position is {CARRIED:g} m away from ({pose[0, 0]:.3g}, {pose[0, 1]:.3g}) m")
        return candidates[np.argmax(away)][None]

    def _driver(self, rng):
        """A function of the true pose that says the next command; it keeps one for a while."""
        constants, hidden = self.constants, self.hidden
        ahead = np.abs(constants.bearings) < FRONT
        left, speed, yaw_rate, looks, side = 0, 0.0, 0.0, True, 0.0

        def command(pose):
            nonlocal left, speed, yaw_rate, looks, side
            if left == 0:
                left = int(rng.integers(hidden.shortest_segment, hidden.longest_segment, endpoint=True))
                speed = rng.uniform(hidden.slowest, hidden.fastest)
                yaw_rate = rng.uniform(-hidden.sharpest, hidden.sharpest)
                looks = rng.random() >= hidden.careless
            left -= 1
            seen = models.distances(pose, constants)[0]
            if not looks or seen[ahead].min(initial=np.inf) >= constants.radius + AHEAD:
                side = 0.0
                return speed, yaw_rate
            # To the side where there is more room, and then on to that side until the way is free.
            if side == 0.0:
                bearings = np.asarray(constants.bearings)
                side = 1.0 if seen[bearings > 0.0].sum() >= seen[bearings < 0.0].sum() else -1.0
            return 0.0, side * AWAY

        return command


def _noisier(constants, factor):
    return replace(constants, sigma_v=factor * constants.sigma_v, sigma_omega=factor * constants.sigma_omega)
