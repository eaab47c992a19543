"""Nearly right: no kernel, but a little jitter on every column at each resampling, the same whatever is known."""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import quadrotor
from course_lib.filters import Particles, systematic

N = 5000
ANGLES = [3, 4, 5]
YAW = 5


def ParticleEstimator(previous, observation, control, constants, rng):
    if previous is None:
        return Particles(draw_prior(constants, rng), np.full(N, -np.log(N)))
    states, log_weights = previous
    if 1.0 / np.sum(np.exp(2.0 * log_weights)) < 0.5 * N:
        states = states[systematic(np.exp(log_weights), rng)] + 0.02 * rng.standard_normal((N, 12))
        log_weights = np.full(N, -np.log(N))
    states = move(states, control, constants, rng)
    log_weights = log_weights + log_likelihood(observation, states, constants)
    log_weights = log_weights - log_weights.max()
    return Particles(states, log_weights - np.log(np.exp(log_weights).sum()))


def draw_prior(constants, rng):
    """First states: position and yaw about what is told, nearly level and at rest."""
    mean = np.zeros(12)
    mean[[0, 1, 2, YAW]] = constants.start
    states = mean + np.repeat(constants.start_sigma, [3, 2, 1, 3, 3]) * rng.standard_normal((N, 12))
    states[:, ANGLES] = wrap(states[:, ANGLES])
    return states


def move(states, control, constants, rng):
    """Each particle through f, with thrusts and gusts of its own."""
    sigma_u = np.sqrt(constants.k * np.abs(control))
    thrusts = control + sigma_u * rng.standard_normal((N, 4))
    states = quadrotor.f(states, thrusts, constants.Ts, constants)
    states[:, 6:9] += constants.sigma_v * np.sqrt(constants.Ts) * rng.standard_normal((N, 3))
    states[:, 9:12] += constants.sigma_w * np.sqrt(constants.Ts) * rng.standard_normal((N, 3))
    states[:, ANGLES] = wrap(states[:, ANGLES])
    return states


def log_likelihood(observation, states, constants):
    """Sum over the readings that are there of -v^2 / (2 sigma^2)."""
    r, h = constants.R / 2, constants.h / 2
    beacons = np.array([[r, r, h], [-r, r, h], [-r, -r, h], [r, -r, h]])
    result = np.zeros(N)
    for i, beacon in enumerate(beacons):
        dx, dy, dz = (beacon - states[:, :3]).T
        if np.isfinite(observation[i]):
            v = observation[i] - np.sqrt(dx**2 + dy**2 + dz**2)
            result -= 0.5 * (v / constants.sigma_rho) ** 2
        if np.isfinite(observation[4 + i]):
            v = wrap(observation[4 + i] - (np.arctan2(dy, dx) - states[:, YAW]))
            result -= 0.5 * (v / constants.sigma_alpha) ** 2
    if np.isfinite(observation[8]):
        v = observation[8] - states[:, 2]
        result -= 0.5 * (v / constants.sigma_a) ** 2
    return result
