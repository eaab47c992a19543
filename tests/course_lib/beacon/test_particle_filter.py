"""The particle filters: the kernel's twin, the extended Kalman filter where both are right, and the source's weight.

Seeds are fixed, so that every test here has one outcome.
"""

from dataclasses import replace

import numpy as np
import pytest

from course_lib.angles import wrap
from course_lib.beacon import ekf, models, particle_filter, quadrotor
from course_lib.beacon.constants import ANGLES, POSITION, Constants, Hidden
from course_lib.beacon.particle_filter import WeightRepairs, source_log_weight
from course_lib.beacon.world import World
from course_lib.filters import Gaussian, covariance, equally_weighted, mean, normalise

CONSTANTS = Constants()
HOVER = quadrotor.hover(CONSTANTS)
RUN = World(CONSTANTS, Hidden(steps=80)).simulate(np.random.default_rng(81))
WHOLE = WeightRepairs(own=True, scaled=True, half=True, once=True)


def readings(state, rng=None):
    z = models.observe(np.atleast_2d(state)[:, :12], CONSTANTS)[0]
    if rng is not None:
        z += CONSTANTS.sigma_z * rng.standard_normal(9)
        z[4:8] = wrap(z[4:8])
    return np.append(z, [np.inf, np.inf])


@pytest.mark.parametrize("missing", [[], [0, 5], [8], [1, 2, 3, 4], range(9)])
def test_the_kernel_matches_the_models_likelihood(missing):
    rng = np.random.default_rng(82)
    states = models.sample_prior(500, replace(CONSTANTS, start_sigma=(1.0, 0.1, 2.0, 1.0, 1.0)), rng)
    z = readings(states[0], rng)
    z[missing] = np.inf
    expected = models.log_likelihood(z, states, CONSTANTS)
    np.testing.assert_allclose(particle_filter.log_likelihood(z, states, CONSTANTS), expected, rtol=1e-12, atol=1e-12)


def test_biases_are_taken_off_the_ranges():
    rng = np.random.default_rng(83)
    states = models.sample_prior(50, CONSTANTS, rng)
    z, biases = readings(states[0]), rng.standard_normal((50, 4))
    expected = [
        models.log_likelihood(z - np.concatenate([b, np.zeros(7)]), s[None], CONSTANTS)[0]
        for s, b in zip(states, biases, strict=True)
    ]
    got = particle_filter.log_likelihood(z, np.hstack([states, biases]), CONSTANTS)
    np.testing.assert_allclose(got, expected)


def follow(run, constants, seed, n=2000, **options):
    """Means (T, 12), covariances of position, and summed log-evidence, of a filter along a run."""
    rng = np.random.default_rng(seed)
    particles, log_evidence, means, spreads = equally_weighted(models.sample_prior(n, constants, rng)), 0.0, [], []
    for observation, control in zip(run.observations, run.controls, strict=True):
        particles, part = particle_filter.step(particles, observation, control, constants, rng, **options)
        log_evidence += part
        means.append(mean(particles, ANGLES))
        spreads.append(covariance(particles, ANGLES))
    return np.array(means), np.array(spreads), log_evidence


def kalman(run, constants, step=ekf.raw_step):
    gaussian, log_evidence, means, spreads = models.prior(constants), 0.0, [], []
    for observation, control in zip(run.observations, run.controls, strict=True):
        gaussian, part, _, _ = step(gaussian, observation, control, constants)
        log_evidence += part
        means.append(gaussian.mean)
        spreads.append(gaussian.covariance)
    return np.array(means), np.array(spreads), log_evidence


def test_it_agrees_with_the_kalman_filter_where_that_is_nearly_exact():
    means, spreads, log_evidence = follow(RUN, CONSTANTS, 84, n=4000)
    exact_means, exact_spreads, exact_evidence = kalman(RUN, CONSTANTS)
    offsets = means - exact_means
    offsets[:, ANGLES] = wrap(offsets[:, ANGLES])
    variances = np.diagonal(exact_spreads, axis1=1, axis2=2)
    # In standard deviations, and of the variances' ratio, over steps and columns.
    assert np.sqrt(np.mean(offsets**2 / variances)) < 0.25
    assert np.mean(np.diagonal(spreads, axis1=1, axis2=2) / variances) == pytest.approx(1.0, abs=0.1)
    assert log_evidence == pytest.approx(exact_evidence, abs=8.0)


def test_the_plain_bootstrap_filter_is_lost():
    means, _, _ = follow(RUN, CONSTANTS, 85, regularise=False)
    error = np.linalg.norm(means[-20:, POSITION] - RUN.truth[-20:, POSITION], axis=1)
    best = np.linalg.norm(follow(RUN, CONSTANTS, 85)[0][-20:, POSITION] - RUN.truth[-20:, POSITION], axis=1)
    assert np.sqrt(np.mean(error**2)) > 4 * np.sqrt(np.mean(best**2))


def test_without_gusts_particles_move_by_their_thrusts_noise_alone():
    rng = np.random.default_rng(86)
    particles = equally_weighted(np.tile(models.prior(CONSTANTS).mean, (2000, 1)))
    still, windy = (
        particle_filter.step(particles, np.full(11, np.inf), HOVER, CONSTANTS, rng, gusts=gusts)[0]
        for gusts in (False, True)
    )
    # Level and thrust along z: sideways nothing pushes but the air.
    assert np.ptp(still.states[:, 6]) < 1e-3 < 0.1 < np.ptp(windy.states[:, 6])


# The source's weight


def weights_of(repairs, z, states, gaussian):
    return np.exp(normalise(source_log_weight(z, states, gaussian, CONSTANTS, repairs))[0])


def doubtful():
    """A cloud and the Gaussian it was drawn from, doubtful in position, and readings of its truth."""
    rng = np.random.default_rng(87)
    constants = replace(CONSTANTS, start_sigma=(0.3, 0.01, 0.02, 0.1, 0.1))
    states = models.sample_prior(20_000, constants, rng)
    return states, models.prior(constants), readings(states[0], rng)


def test_as_written_all_particles_weigh_the_same():
    states, gaussian, z = doubtful()
    for repairs in (WeightRepairs(), WeightRepairs(scaled=True, half=True, once=True)):
        np.testing.assert_allclose(weights_of(repairs, z, states, gaussian), 1 / len(states))


def position_variance(weights, states):
    centre = weights @ states[:, POSITION]
    return weights @ (states[:, POSITION] - centre) ** 2


def test_each_of_the_other_defects_changes_the_posterior():
    states, gaussian, z = doubtful()
    exact = position_variance(np.exp(normalise(models.log_likelihood(z, states, CONSTANTS))[0]), states)
    full = position_variance(weights_of(WHOLE, z, states, gaussian), states)
    np.testing.assert_allclose(full / exact, 1.0, atol=0.2)
    ratio = {
        name: (position_variance(weights_of(replace(WHOLE, **{name: False}), z, states, gaussian), states) / full).max()
        for name in ("scaled", "half", "once")
    }
    # Without the ½ the likelihood is squared; with the prior in Σ, readings count less than they should.
    assert ratio["half"] < 0.75
    assert ratio["once"] > 1.3
    assert ratio["scaled"] > 1.3


def test_its_exponent_is_in_metres():
    # The same vehicle in centimetres: every length a hundred times, and the exponent with it.
    states, gaussian, z = doubtful()
    large = replace(CONSTANTS, R=1000.0, h=400.0, sigma_rho=10.0, sigma_a=10.0)
    scale = np.repeat([100.0, 1.0, 100.0, 1.0], 3)
    z_large = np.where(np.isin(range(11), [0, 1, 2, 3, 8]), 100.0, 1.0) * z
    gaussian_large = Gaussian(gaussian.mean * scale, gaussian.covariance * np.outer(scale, scale))
    for repairs, factor in ((WeightRepairs(own=True), 100.0), (WHOLE, 1.0)):
        metres = source_log_weight(z, states, gaussian, CONSTANTS, repairs)
        centimetres = source_log_weight(z_large, states * scale, gaussian_large, large, repairs)
        np.testing.assert_allclose(centimetres, factor * metres, rtol=1e-6)


def test_missing_readings_leave_rows_out_of_the_sources_weight():
    states, gaussian, z = doubtful()
    z[[0, 6]] = np.inf
    whole = weights_of(WHOLE, z, states, gaussian)
    exact = position_variance(np.exp(normalise(models.log_likelihood(z, states, CONSTANTS))[0]), states)
    assert np.isfinite(whole).all() and np.all(position_variance(whole, states) > 0.9 * exact)
