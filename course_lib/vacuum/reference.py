"""The reference `Estimator` of the vacuum robots: a joint bootstrap filter with little roughening."""

import numpy as np

from course_lib.angles import wrap
from course_lib.filters import ZeroLikelihoodError, equally_weighted, predict, resample, roughen, update
from course_lib.vacuum import models

#: Particles, each a pair of robots.
COUNT = 20_000
#: Roughening constant K, small because there are many particles.
ROUGHENING = 0.03


def Estimator(previous, observation, control, constants, rng):
    """One update of the particle filter.

    Parameters
    ----------
    previous : Particles or None
        What the last call returned; None at time 0.
    observation : ndarray, shape (4,), or None
        Readings in metres, `inf` where a sensor is silent.
    control : ndarray, shape (2,), or None
        Speeds u_A, u_B over the last interval in m/s.
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    Particles
        States (N, 6): x_A, y_A, θ_A, x_B, y_B, θ_B.
    """
    if previous is None:
        return equally_weighted(models.prior(COUNT, constants, rng))
    particles = resample(previous, rng)
    if particles is not previous:
        particles = equally_weighted(_roughened(particles.states, constants, rng))
    particles = predict(particles, lambda states, rng: models.transition(states, control, constants, rng), rng)
    try:
        return update(particles, models.log_likelihood(observation, particles.states, constants))[0]
    except ZeroLikelihoodError:
        return particles


def _roughened(states, constants, rng):
    room = np.array([*constants.room, 2 * np.pi] * 2)
    states = roughen(states, rng, ROUGHENING, room)
    positions = [0, 1, 3, 4]
    states[:, positions] = np.clip(states[:, positions], 0.0, room[positions])
    states[:, [2, 5]] = wrap(states[:, [2, 5]])
    return states
