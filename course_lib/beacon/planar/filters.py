"""The quadrotor's two filters on the ground, and a recording put through them."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from course_lib.angles import wrap
from course_lib.beacon.planar.robot import (
    ANGLES,
    BIAS,
    DT,
    HEADING,
    angular,
    log_likelihood,
    motion_jacobians,
    move,
    observation_jacobian,
    observe,
    sightings,
    transition,
)
from course_lib.filters import (
    Gaussian,
    Particles,
    bootstrap_step,
    covariance,
    equally_weighted,
    extended_kalman,
    mean,
    predict,
    resample,
)

#: Standard deviations of the start about the true pose: x, y (m) and heading (rad).
START_SIGMA = (0.1, 0.1, 0.1)
#: How far the robot goes (m) before the direction it went in is taken for its true heading, where none was recorded.
DIRECTION_AFTER = 0.2


class Track(NamedTuple):
    """What a filter made of a recording.

    Attributes
    ----------
    times : ndarray, shape (T + 1,)
        Seconds.
    means : ndarray, shape (T + 1, 4)
    covariances : ndarray, shape (T + 1, 4, 4)
    truth : ndarray, shape (T + 1, 3)
        True poses; the filter saw none of them but through the start.
    log_evidence : float
        Log-likelihood of all sightings.
    """

    times: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    truth: np.ndarray
    log_evidence: float


def particle_step(particles, observation, control, constants, rng, difference=angular):
    """One step of the bootstrap filter.

    Parameters
    ----------
    particles : Particles or Gaussian
        A Gaussian is drawn from first.
    observation : ndarray, shape (2 L,)
    control : ndarray, shape (3,)
    constants : Constants
    rng : numpy.random.Generator
    difference : callable
        As in `planar.log_likelihood`.

    Returns
    -------
    particles : Particles
    log_evidence : float
    """
    if isinstance(particles, Gaussian):
        particles = equally_weighted(rng.multivariate_normal(*particles, size=constants.N))

    def successors(states, rng):
        return transition(states, control, constants, rng)

    def likelihood(states):
        return log_likelihood(observation, states, constants, difference)

    if not np.isfinite(observation).any():
        return predict(resample(particles, rng), successors, rng), 0.0
    return bootstrap_step(particles, successors, likelihood, rng)


def kalman_step(gaussian, observation, control, constants, rng=None, difference=angular):
    """One step of the extended Kalman filter, one sighting after the other; those beyond the gate are left out.

    Parameters and returns as in `particle_step`, with a Gaussian of dimension 4 for the particles; nothing is random.
    """
    gaussian, log_evidence = _predict(gaussian, control, constants), 0.0
    for sighting in zip(*sightings(observation), strict=True):
        gaussian, log_likelihood_of_it = _correct(gaussian, *sighting, constants, difference)
        log_evidence += log_likelihood_of_it
    return gaussian, log_evidence


def dead_reckoning(gaussian, observation, control, constants, rng=None):
    """A step that looks at nothing. Parameters and returns as in `kalman_step`."""
    return _predict(gaussian, control, constants), 0.0


def start_near_truth(run, constants, rng):
    """Where the filters start: the true first pose plus an error of START_SIGMA, of which they know the size.

    Parameters
    ----------
    run : Run
        As `GroundRecording.steps` makes it. Where no heading was recorded, the direction of the first 0.2 m of the
        true path stands for the first.
    constants : Constants
    rng : numpy.random.Generator
        Draws the error.

    Returns
    -------
    Gaussian
        Of dimension 4.
    """
    pose = run.truth[0].copy()
    if np.isnan(pose[HEADING]):
        way = run.truth[:, :2] - pose[:2]
        dx, dy = way[np.argmax(np.hypot(*way.T) > DIRECTION_AFTER)]
        pose[HEADING] = np.arctan2(dy, dx)
    mean = np.append(pose + START_SIGMA * rng.standard_normal(3), 0.0)
    return Gaussian(mean, np.diag(np.square([*START_SIGMA, constants.bias_sigma])))


def localize(recording, constants, rng, step=particle_step, start=None):
    """Follow a robot through a recording.

    Parameters
    ----------
    recording : GroundRecording
    constants : Constants
    rng : numpy.random.Generator
    step : callable
        `particle_step` or `kalman_step`, or one like them.
    start : Gaussian, optional
        Of dimension 4; `start_near_truth` when left out. Truth is used for nothing else.

    Returns
    -------
    Track
        Steps end at each sighting and every 0.2 s.
    """
    times, run = recording.steps(constants.delay)
    belief = start_near_truth(run, constants, rng) if start is None else start
    moments, total = [moments_of(belief)], 0.0
    for observation, control in zip(run.observations, run.controls, strict=True):
        belief, log_evidence = step(belief, observation, control, constants, rng)
        total += log_evidence
        moments.append(moments_of(belief))
    means, covariances = (np.array(each) for each in zip(*moments, strict=True))
    return Track(times, means, covariances, run.truth, float(total))


def moments_of(belief):
    """Mean and covariance, as a Gaussian, of particles or of a Gaussian; the mean heading in [-π, π)."""
    if isinstance(belief, Particles):
        return Gaussian(mean(belief, ANGLES), covariance(belief, ANGLES))
    wrapped = belief.mean.copy()
    wrapped[HEADING] = wrap(wrapped[HEADING])
    return Gaussian(wrapped, belief.covariance)


def _predict(gaussian, control, constants):
    F_x, F_u = motion_jacobians(gaussian.mean, control, constants)
    mean = move(gaussian.mean[None], control, constants)[0]
    # Q = F_u Σ_u F_uᵀ; the mean of white noise over Δt has the variance σ²/Δt
    Q = F_u @ np.diag([constants.sigma_v**2, constants.sigma_omega**2]) @ F_u.T / control[DT]
    Q[BIAS, BIAS] = constants.bias_walk**2 * control[DT]
    return extended_kalman.predict(gaussian, mean, F_x, Q)


def _correct(gaussian, row, measured_range, measured_bearing, constants, difference):
    ranges, bearings = observe(gaussian.mean[None], [row], constants)
    H = observation_jacobian(gaussian.mean, row, constants)
    innovation, variances, spans = [measured_range - ranges[0, 0]], [constants.sigma_rho**2], [constants.range_span]
    if np.isfinite(measured_bearing):
        innovation.append(difference(measured_bearing, bearings[0, 0]))
        variances.append(constants.sigma_alpha**2)
        spans.append(constants.bearing_span)
    H, R = H[: len(innovation)], np.diag(variances)
    if extended_kalman.nis(gaussian, innovation, H, R) > _gate(constants.gate, len(innovation)):
        return gaussian, np.log(constants.outliers) - np.log(spans).sum()
    gaussian, log_evidence = extended_kalman.update(gaussian, innovation, H, R)
    return gaussian, np.log1p(-constants.outliers) + log_evidence


@lru_cache
def _gate(quantile, dimension):
    return chi2.ppf(quantile, dimension)
