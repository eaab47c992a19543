"""The references of the beacon unit's assignments: `Estimator` and `ParticleEstimator`.

Both weigh two hypotheses by their evidence: that every beacon's range is unbiased, and that each has a constant bias
of its own, which is then estimated with the state. Where beacons are sound the first wins, and nothing is lost.

The Kalman filter is (b) of `ekf`, with one thing more: what is left to a start whose yaw may be off by more than a
quarter turn. H is linear in yaw, so the size of the error is no matter, but the innovations of four bearings near half
a turn wrap to different sides; they are wrapped to the same one.
"""

from typing import NamedTuple

import numpy as np

from course_lib.angles import circular_mean, wrap
from course_lib.beacon import models, particle_filter, quadrotor
from course_lib.beacon.constants import ANGLES, BEARINGS, MEASURED, RANGES
from course_lib.filters import Gaussian, Particles, Step, equally_weighted, extended_kalman, normalise

#: Probability before any reading that beacons are biased, and the standard deviation of their biases then, in metres.
BIASED, BIAS_SIGMA = 0.1, 0.5
#: Particles altogether.
COUNT = 5000
#: A cloud is given up when the other is this much more probable, as a logarithm.
DECIDED = 12.0


class Hypotheses(NamedTuple):
    """What both references remember.

    Attributes
    ----------
    beliefs : tuple of Gaussian or Particles
        One or both of: dimension 12; dimension 16, the last four the biases of the ranges in metres.
    log_probabilities : ndarray, shape (len(beliefs),)
        Normalised.
    """

    beliefs: tuple
    log_probabilities: np.ndarray


def Estimator(previous, observation, control, constants, rng):
    """One step of the extended Kalman filter.

    Parameters
    ----------
    previous : Step or None
        What the last call returned; None at time 0.
    observation : array_like, shape (11,), or None
        `inf` where missing.
    control : array_like, shape (4,), or None
        Commanded thrusts in N.
    constants : Constants
    rng : numpy.random.Generator
        Not used.

    Returns
    -------
    Step
        The posterior, a `Gaussian` of dimension 12 with the moments of both hypotheses, and the `Hypotheses`.
    """
    if previous is None:
        prior = models.prior(constants)
        mean = np.append(prior.mean, np.zeros(4))
        covariance = np.diag(np.append(np.diag(prior.covariance), np.full(4, BIAS_SIGMA**2)))
        memory = Hypotheses((prior, Gaussian(mean, covariance)), np.log([1.0 - BIASED, BIASED]))
        return Step(prior, memory)
    outcomes = [_kalman_step(belief, observation, control, constants) for belief in previous.memory.beliefs]
    memory = _weighed(previous.memory, outcomes)
    return Step(_mixed(memory), memory)


def ParticleEstimator(previous, observation, control, constants, rng):
    """One step of the regularised particle filter.

    Parameters
    ----------
    previous, observation, control, constants, rng
        As in `Estimator`.

    Returns
    -------
    Step
        The posterior, `COUNT` `Particles` of dimension 12, and the `Hypotheses`.
    """
    if previous is None:
        states = models.sample_prior(COUNT, constants, rng)
        sound, off = states[: COUNT // 2], states[COUNT // 2 :]
        off = np.hstack([off, BIAS_SIGMA * rng.standard_normal((len(off), 4))])
        memory = Hypotheses((equally_weighted(sound), equally_weighted(off)), np.log([1.0 - BIASED, BIASED]))
        return Step(equally_weighted(states), memory)
    observation = np.asarray(observation, dtype=float)
    outcomes = [
        particle_filter.step(belief, observation, control, constants, rng) for belief in previous.memory.beliefs
    ]
    memory = _decided(_weighed(previous.memory, outcomes))
    states = np.vstack([belief.states[:, :12] for belief in memory.beliefs])
    log_weights = np.concatenate(
        [belief.log_weights + log for belief, log in zip(memory.beliefs, memory.log_probabilities, strict=True)]
    )
    return Step(Particles(states, log_weights), memory)


def _kalman_step(gaussian, observation, control, constants):
    """(Gaussian, log_evidence) after one step, of dimension 12, or of 16 with biases."""
    d = len(gaussian.mean)
    moved, F_x, F_u = quadrotor.linearised(
        gaussian.mean[:12].copy(), np.array(control, dtype=float), constants.Ts, quadrotor.parameters(constants)
    )
    F, Q = np.eye(d), np.zeros((d, d))
    F[:12, :12], Q[:12, :12] = F_x, models.process_covariance(F_u, control, constants)
    gaussian = extended_kalman.predict(gaussian, np.append(moved, gaussian.mean[12:]), F, Q, ANGLES)
    predicted, H = models.observe(gaussian.mean[None, :12], constants)[0], np.zeros((MEASURED, d))
    H[:, :12] = models.observation_jacobian(gaussian.mean[:12], constants)
    if d > 12:
        predicted[RANGES] += gaussian.mean[12:]
        H[RANGES, 12:] = np.eye(4)
    v = _innovation(observation, predicted)
    there = np.isfinite(v)
    return extended_kalman.update(gaussian, v[there], H[there], np.diag(constants.sigma_z[there] ** 2), ANGLES)


def _innovation(observation, predicted):
    """`models.innovation`, the bearings' within half a turn of their mean."""
    v = models.innovation(observation, predicted)
    heard = np.flatnonzero(np.isfinite(v[BEARINGS])) + BEARINGS.start
    if len(heard):
        common = circular_mean(v[heard], np.ones(len(heard)))
        v[heard] = common + wrap(v[heard] - common)
    return v


def _weighed(memory, outcomes):
    """Bayes' rule for hypotheses: each is multiplied by the evidence of its filter."""
    beliefs, log_evidences = zip(*outcomes, strict=True)
    return Hypotheses(beliefs, normalise(memory.log_probabilities + np.array(log_evidences))[0])


def _mixed(memory):
    """The first 12 dimensions of both Gaussians as one of the same moments."""
    weights = np.exp(memory.log_probabilities)
    origin = memory.beliefs[int(np.argmax(weights))].mean[:12]
    offsets = np.array([belief.mean[:12] - origin for belief in memory.beliefs])
    offsets[:, list(ANGLES)] = wrap(offsets[:, list(ANGLES)])
    centre = weights @ offsets
    covariance = ((offsets - centre).T * weights) @ (offsets - centre)
    covariance += sum(w * belief.covariance[:12, :12] for w, belief in zip(weights, memory.beliefs, strict=True))
    mean = origin + centre
    mean[list(ANGLES)] = wrap(mean[list(ANGLES)])
    return Gaussian(mean, covariance)


def _decided(memory):
    """Without the cloud that is improbable beyond recovery; the other has its particles: copies, until they move."""
    if len(memory.beliefs) == 1 or np.ptp(memory.log_probabilities) < DECIDED:
        return memory
    states, log_weights = memory.beliefs[int(np.argmax(memory.log_probabilities))]
    doubled = Particles(np.vstack([states, states]), np.tile(log_weights - np.log(2.0), 2))
    return Hypotheses((doubled,), np.zeros(1))
