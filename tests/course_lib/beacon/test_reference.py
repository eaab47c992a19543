"""The references: what they return, how good they are where it is hard, and what they make of biased beacons.

Seeds are fixed, so that every test here has one outcome.
"""

from dataclasses import replace

import numpy as np
import pytest

from course_lib.angles import wrap
from course_lib.beacon import ekf, models, reference
from course_lib.beacon.constants import ANGLES, POSITION, YAW, Constants, Hidden
from course_lib.beacon.reference import Estimator, ParticleEstimator
from course_lib.beacon.world import World
from course_lib.filters import Gaussian, Particles, Step, covariance, mean
from course_lib.recording import replay
from course_lib.scoring import nees

DEFAULT = Constants()
LOST_YAW = replace(DEFAULT, start_sigma=(0.5, 0.035, np.radians(120.0), 0.3, 0.1))
PRECISE = replace(DEFAULT, sigma_rho=0.02, sigma_alpha=np.radians(0.4), sigma_a=0.02)
NOISY = replace(DEFAULT, sigma_rho=0.5, sigma_alpha=np.radians(8.0), sigma_a=0.4)


def gaussian_of(step):
    if isinstance(step.posterior, Gaussian):
        return step.posterior
    return Gaussian(mean(step.posterior, ANGLES), covariance(step.posterior, ANGLES))


def follow(estimator, constants, hidden, run):
    """Position errors (m) and yaw errors (rad) from step 20 on, mean NEES then, and the last step."""
    recorded = World(constants, hidden).simulate(np.random.default_rng([91, run]))
    steps = list(replay(estimator, recorded, constants, np.random.default_rng([92, run])))
    gaussians = [gaussian_of(step) for step in steps]
    errors = recorded.truth - [gaussian.mean for gaussian in gaussians]
    late = range(20, recorded.steps + 1)
    scores = [nees(gaussians[k], recorded.truth[None, k], ANGLES)[0] for k in late]
    return np.linalg.norm(errors[20:, POSITION], axis=1), wrap(errors[20:, YAW]), np.mean(scores), steps[-1]


HARD = {
    "default": (DEFAULT, Hidden(steps=80), 0.12),
    "yaw unknown": (LOST_YAW, Hidden(steps=60), 0.12),
    "precise": (PRECISE, Hidden(steps=60), 0.035),
    "noisy": (NOISY, Hidden(steps=60), 0.45),
    "outages": (DEFAULT, Hidden(steps=60, outage=0.6), 0.16),
    "two beacons dead": (DEFAULT, Hidden(steps=60, dead=(0, 2)), 0.20),
    "one beacon biased": (DEFAULT, Hidden(steps=60, bias=(0.0, 0.5, 0.0, 0.0)), 0.14),
    "two beacons biased": (DEFAULT, Hidden(steps=60, bias=(0.4, 0.0, -0.5, 0.0)), 0.14),
    "one beacon far off, precise": (PRECISE, Hidden(steps=60, bias=(1.5, 0.0, 0.0, 0.0)), 0.04),
}


@pytest.mark.parametrize("name", HARD)
def test_the_kalman_filter_where_it_is_hard(name):
    constants, hidden, bound = HARD[name]
    errors, yaws, scores, _ = zip(*(follow(Estimator, constants, hidden, run) for run in range(3)), strict=True)
    assert np.sqrt(np.mean(np.square(errors))) < bound
    assert np.degrees(np.sqrt(np.mean(np.square(yaws)))) < 2.5
    assert np.mean(scores) < 20.0


@pytest.mark.parametrize("name", HARD)
def test_the_particle_filter_where_it_is_hard(name):
    constants, hidden, bound = HARD[name]
    error, yaw, score, _ = follow(ParticleEstimator, constants, replace(hidden, steps=40), 0)
    assert np.sqrt(np.mean(np.square(error))) < 1.2 * bound
    assert np.degrees(np.sqrt(np.mean(np.square(yaw)))) < 3.0
    assert score < 25.0


def test_what_is_returned():
    run = World(DEFAULT, Hidden(steps=3)).simulate(np.random.default_rng(93))
    for step in replay(Estimator, run, DEFAULT, np.random.default_rng(94)):
        assert isinstance(step, Step) and step.posterior.covariance.shape == (12, 12)
        np.testing.assert_allclose(step.posterior.covariance, step.posterior.covariance.T, rtol=1e-12)
    for step in replay(ParticleEstimator, run, DEFAULT, np.random.default_rng(94)):
        assert isinstance(step.posterior, Particles) and step.posterior.states.shape == (reference.COUNT, 12)
        assert np.exp(step.posterior.log_weights).sum() == pytest.approx(1.0)
        assert np.abs(step.posterior.states[:, ANGLES]).max() <= np.pi


def test_both_start_with_the_prior():
    prior = models.prior(DEFAULT)
    np.testing.assert_array_equal(Estimator(None, None, None, DEFAULT, None).posterior.mean, prior.mean)
    cloud = ParticleEstimator(None, None, None, DEFAULT, np.random.default_rng(95)).posterior
    deviations = np.sqrt(np.diag(prior.covariance))
    np.testing.assert_allclose(mean(cloud, ANGLES) / deviations, prior.mean / deviations, atol=0.1)
    np.testing.assert_allclose(cloud.states.std(axis=0), deviations, rtol=0.1)


def test_same_seed_same_particles():
    run = World(DEFAULT, Hidden(steps=3)).simulate(np.random.default_rng(96))
    one, two = (list(replay(ParticleEstimator, run, DEFAULT, np.random.default_rng(97)))[-1] for _ in range(2))
    np.testing.assert_array_equal(one.posterior.states, two.posterior.states)


def test_evidence_tells_sound_beacons_from_biased():
    sound = follow(Estimator, DEFAULT, Hidden(), 1)[3].memory
    biased = follow(Estimator, DEFAULT, Hidden(bias=(0.0, 0.0, 0.3, 0.0)), 1)[3].memory
    assert sound.log_probabilities[1] < -5.0 and biased.log_probabilities[0] < -50.0
    estimate, spread = biased.beliefs[1].mean[12:], np.sqrt(np.diag(biased.beliefs[1].covariance)[12:])
    assert np.abs((estimate - [0.0, 0.0, 0.3, 0.0]) / spread).max() < 4.0
    assert spread.max() < 0.05


def test_with_sound_beacons_it_is_the_raw_kalman_filter():
    run = World(DEFAULT, Hidden(steps=200)).simulate(np.random.default_rng(98))
    last, gaussian = list(replay(Estimator, run, DEFAULT, None))[-1].posterior, models.prior(DEFAULT)
    for observation, control in zip(run.observations, run.controls, strict=True):
        gaussian = ekf.raw_step(gaussian, observation, control, DEFAULT).posterior
    deviations = np.sqrt(np.diag(gaussian.covariance))
    np.testing.assert_allclose((last.mean - gaussian.mean) / deviations, 0.0, atol=0.01)
    np.testing.assert_allclose(np.sqrt(np.diag(last.covariance)) / deviations, 1.0, atol=0.01)


@pytest.mark.parametrize("degrees", [150.0, 176.0, 180.0, -179.0, -100.0])
def test_bearings_wrap_to_the_same_side(degrees):
    # The true yaw is this far from the prior's mean; the plain filter's innovations cancel near half a turn.
    state = models.prior(LOST_YAW).mean
    state[[0, 1, YAW]] = 1.0, -0.7, np.radians(degrees)
    rng, step = np.random.default_rng(99), Estimator(None, None, None, LOST_YAW, None)
    z = np.append(models.observe(state[None], LOST_YAW)[0], [np.inf, np.inf])
    z[:9] += LOST_YAW.sigma_z * rng.standard_normal(9)
    z[4:8] = wrap(z[4:8])
    posterior = Estimator(step, z, np.full(4, LOST_YAW.mass * LOST_YAW.g / 4), LOST_YAW, rng).posterior
    assert np.degrees(abs(wrap(posterior.mean[YAW] - state[YAW]))) < 5.0
    assert np.linalg.norm(posterior.mean[POSITION] - state[POSITION]) < 0.4


def test_mixing_takes_moments_on_the_circle():
    means = np.zeros((2, 16))
    means[:, YAW], means[:, 0] = [3.1, -3.1], [1.0, 2.0]
    beliefs = (Gaussian(means[0, :12], 0.01 * np.eye(12)), Gaussian(means[1], 0.03 * np.eye(16)))
    mixed = reference._mixed(reference.Hypotheses(beliefs, np.log([0.5, 0.5])))
    assert abs(mixed.mean[YAW]) == pytest.approx(np.pi) and mixed.mean[0] == pytest.approx(1.5)
    assert mixed.covariance[0, 0] == pytest.approx(0.02 + 0.25)
    assert mixed.covariance[YAW, YAW] == pytest.approx(0.02 + (np.pi - 3.1) ** 2)
