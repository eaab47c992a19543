"""A plain bootstrap filter whose parts can be taken away, to see in the lesson what each is for."""

import numpy as np

from course_lib.angles import wrap
from course_lib.filters import ZeroLikelihoodError, equally_weighted, predict, resample, roughen, update
from course_lib.vacuum import models


def bootstrap_filter(count=2000, roughening=0.1, when_all_zero="redraw"):
    """An `Estimator` with knobs.

    Parameters
    ----------
    count : int
        Number of particles N.
    roughening : float
        Gordon's K; 0 switches roughening off.
    when_all_zero : {"redraw", "keep"}
        What happens when no particle can explain the readings: start afresh, anywhere in the room, or go on with
        the predicted particles as if no sensor had reported.

    Returns
    -------
    callable
        `Estimator(previous, observation, control, constants, rng) -> Particles`.
    """

    def estimator(previous, observation, control, constants, rng):
        if previous is None:
            return equally_weighted(models.prior(count, constants, rng))
        particles = resample(previous, rng)
        if particles is not previous and roughening:
            particles = equally_weighted(_in_room(roughen(particles.states, rng, roughening), constants))
        particles = predict(particles, lambda states, rng: models.transition(states, control, constants, rng), rng)
        try:
            return update(particles, models.log_likelihood(observation, particles.states, constants))[0]
        except ZeroLikelihoodError:
            return particles if when_all_zero == "keep" else equally_weighted(_anywhere(count, constants, rng))

    return estimator


def _in_room(states, constants):
    for columns in ([0, 1], [3, 4]):
        states[:, columns] = np.clip(states[:, columns], 0.0, constants.room)
    states[:, [2, 5]] = wrap(states[:, [2, 5]])
    return states


def _anywhere(count, constants, rng):
    low = np.array([0.0, 0.0, -np.pi] * 2)
    high = np.array([*constants.room, np.pi] * 2)
    return rng.uniform(low, high, size=(count, 6))
