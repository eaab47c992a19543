"""Question 3: particle filters of the quadrotor (c), with the source's weight and with the likelihood.

A plain bootstrap filter loses this vehicle at any number of particles: tilt shows in what is measured after two
integrations only, and by then resampling has left few ancestors. `step` therefore regularises
(`course_lib.filters.regularized`); with `regularise=False` it is the bootstrap filter.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from course_lib.beacon import geometry, models
from course_lib.beacon.constants import ALTITUDE, ANGLES, BEARINGS, MEASURED, POSITION, RANGES, YAW
from course_lib.beacon.ekf import ALL, source_innovation
from course_lib.filters import Particles, bootstrap, regularized


def step(particles, observation, control, constants, rng, regularise=True, log_weight=None, gusts=True):
    """One step: resample when needed, predict, weigh.

    Parameters
    ----------
    particles : Particles
        Posterior at time k - 1: states (N, 12), or (N, 16) with four columns of what beacons add to their ranges (m).
    observation : ndarray, shape (11,)
        `inf` where missing.
    control : ndarray, shape (4,)
        Commanded thrusts u in N.
    constants : Constants
    rng : numpy.random.Generator
    regularise : bool
        Whether copies are parted by a kernel, and the likelihood is taken in parts where it leaves few particles.
    log_weight : callable, optional
        `log_weight(states (N, 12)) -> (N,)`; when left out, `log_likelihood` of the observation.
    gusts : bool
        Whether particles feel them; the source's have noise in their thrusts only.

    Returns
    -------
    particles : Particles
        Posterior at time k.
    log_evidence : float
        log p(zₖ | z₁, ..., zₖ₋₁) where the weight is a likelihood.
    """
    if log_weight is None:

        def log_weight(states):
            return log_likelihood(observation, states, constants)

    resample = regularized.resample if regularise else bootstrap.resample
    particles = resample(particles, rng, **({"angles": ANGLES} if regularise else {}))
    air = constants if gusts else replace(constants, sigma_v=0.0, sigma_w=0.0)
    states = np.empty_like(particles.states)
    states[:, :12] = models.transition(particles.states[:, :12], control, air, rng)
    states[:, 12:] = particles.states[:, 12:]
    particles = Particles(states, particles.log_weights)
    if regularise:
        return regularized.update(particles, log_weight, rng, angles=ANGLES)
    return bootstrap.update(particles, log_weight(particles.states))


def log_likelihood(observation, states, constants):
    """`models.log_likelihood` in a compiled loop; of states (N, 12), or (N, 16) as in `step`."""
    readings = np.ascontiguousarray(observation[:MEASURED], dtype=float)
    return _log_likelihood(readings, states, constants.beacons, constants.sigma_z)


@dataclass(frozen=True)
class WeightRepairs:
    """What is mended in the source's weight exp(-vᵀv / σ_v); without arguments, nothing.

    Attributes
    ----------
    own : bool
        v is the particle's: positions by its θ, less its position. As written it is the Kalman filter's, one for all.
    scaled : bool
        The exponent is vᵀ Σ⁻¹ v, a number. As written it is vᵀv over σ_v = √(Σ₁₁ + Σ₂₂ + ...): metres.
    half : bool
        The exponent has its ½.
    once : bool
        Σ = G R Gᵀ, which is what a particle leaves in doubt. As written it has the Kalman filter's H P Hᵀ too, so that
        the prior, which the cloud is, counts twice.
    """

    own: bool = False
    scaled: bool = False
    half: bool = False
    once: bool = False


def source_log_weight(observation, states, gaussian, constants, repairs=WeightRepairs()):
    """Question 3 c: logarithm of each particle's weight by the source.

    Parameters
    ----------
    observation : ndarray, shape (11,)
    states : ndarray, shape (N, 12)
    gaussian : Gaussian
        P' and X' of a Kalman filter that runs beside the particles: `ekf.predict`.
    constants : Constants
    repairs : WeightRepairs

    Returns
    -------
    ndarray, shape (N,)
        Without the normalising constant, which is the same for all. With all repairs, the likelihood of the positions
        inverted from the readings, linearised at X'.
    """
    v, H, GRG, _ = source_innovation(gaussian, observation, constants, ALL)
    Sigma = GRG if repairs.once else GRG + H @ gaussian.covariance @ H.T
    v = np.tile(v, (len(states), 1))
    if repairs.own:
        readings = (observation[RANGES], observation[BEARINGS], observation[ALTITUDE])
        positions = geometry.position(range(4), *readings, states[:, YAW, None], constants)
        differences = (positions - states[:, None, POSITION])[..., :2].reshape(len(states), 8)
        altitude = observation[ALTITUDE] - states[:, 2:3]
        v = np.hstack([differences, altitude])
        v = v[:, np.isfinite(v[0])]
    if repairs.scaled:
        square = np.einsum("ni,ni->n", v, np.linalg.solve(Sigma, v.T).T)
    else:
        square = np.einsum("ni,ni->n", v, v) / np.sqrt(np.trace(Sigma))
    return -square * (0.5 if repairs.half else 1.0)


@njit("float64[::1](float64[::1], float64[:, ::1], float64[:, ::1], float64[::1])", cache=True)
def _log_likelihood(readings, states, beacons, sigma):
    n, d = states.shape
    constant = 0.0
    for j in range(9):
        if np.isfinite(readings[j]):
            constant -= np.log(sigma[j]) + 0.5 * np.log(2.0 * np.pi)
    result = np.full(n, constant)
    for i in range(4):
        ranged, seen = np.isfinite(readings[i]), np.isfinite(readings[4 + i])
        if not (ranged or seen):
            continue
        for j in range(n):
            dx, dy = beacons[i, 0] - states[j, 0], beacons[i, 1] - states[j, 1]
            if ranged:
                dz = beacons[i, 2] - states[j, 2]
                v = readings[i] - np.sqrt(dx * dx + dy * dy + dz * dz)
                if d > 12:
                    v -= states[j, 12 + i]
                result[j] -= 0.5 * (v / sigma[i]) ** 2
            if seen:
                v = readings[4 + i] - np.arctan2(dy, dx) + states[j, 5]
                v -= 2.0 * np.pi * np.floor((v + np.pi) / (2.0 * np.pi))
                result[j] -= 0.5 * (v / sigma[4 + i]) ** 2
    if np.isfinite(readings[8]):
        for j in range(n):
            result[j] -= 0.5 * ((readings[8] - states[j, 2]) / sigma[8]) ** 2
    return result
