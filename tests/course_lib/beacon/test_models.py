"""Motion and measurement models.

Seeds are fixed; with a fresh one a statistical test would fail with the probability FALSE_ALARM or less.
"""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, norm

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.constants import ANGLES, BEARINGS, RANGES, YAW, Constants
from tests.course_lib.beacon import twins

CONSTANTS = Constants()
FALSE_ALARM = 1e-6


def states(seed, size):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.0, 1.0, (size, 12)) * np.repeat([4.0, 0.5, 1.0, 1.0], 3) + 2.0 * np.eye(12)[2]


def test_prior_samples_are_drawn_from_the_prior():
    constants = replace(CONSTANTS, start=(1.0, -2.0, 1.5, 3.0), start_sigma=(0.5, 0.1, 0.2, 0.3, 0.4))
    mean, covariance = models.prior(constants)
    drawn = models.sample_prior(20_000, constants, np.random.default_rng(1))
    assert (np.abs(drawn[:, ANGLES]) <= np.pi).all(), "yaw is wrapped"
    error = drawn - mean
    error[:, ANGLES] = wrap(error[:, ANGLES])
    for column, deviation in zip(error.T, np.sqrt(np.diag(covariance)), strict=True):
        assert kstest(column / deviation, "norm").pvalue > FALSE_ALARM / 12
    assert np.abs(np.corrcoef(error.T) - np.eye(12)).max() < 6.0 / np.sqrt(20_000)


def test_transition_without_noise_is_f():
    quiet = replace(CONSTANTS, k=0.0, sigma_v=0.0, sigma_w=0.0)
    u = quadrotor.hover(quiet) + [0.1, -0.1, 0.2, 0.0]
    start = states(2, 5)
    expected = quadrotor.f(start, u, quiet.Ts, quiet)
    expected[:, ANGLES] = wrap(expected[:, ANGLES])
    np.testing.assert_allclose(models.transition(start, u, quiet, np.random.default_rng(0)), expected)


def test_transition_spreads_as_the_process_covariance_says():
    n, u = 200_000, np.array([2.0, 2.4, 3.0, 2.2])
    start = np.zeros(12)
    start[3:6] = 0.1, -0.2, 0.5
    for gain in (1.0, 3.0):
        noisy = replace(CONSTANTS, k=0.01)
        drawn = models.transition(np.tile(start, (n, 1)), u, noisy, np.random.default_rng(3), gain)
        _, F_u = quadrotor.jacobians(start, u, noisy.Ts, noisy)
        Q = models.process_covariance(F_u, u, replace(noisy, k=gain * noisy.k))
        scale = np.sqrt(np.diag(Q))
        sampled = np.cov(drawn.T) / np.outer(scale, scale)
        # An entry's standard deviation is at most √(2 / n) = 0.0032; f is not quite linear.
        np.testing.assert_allclose(sampled, Q / np.outer(scale, scale), atol=0.02)


def test_the_sources_process_noise_vanishes_with_the_input_and_ours_does_not():
    _, F_u = quadrotor.jacobians(np.zeros(12), np.zeros(4), 0.05, CONSTANTS)
    calm = replace(CONSTANTS, sigma_v=0.0, sigma_w=0.0)
    assert not models.process_covariance(F_u, np.zeros(4), calm).any()
    assert np.linalg.matrix_rank(models.process_covariance(F_u, np.zeros(4), CONSTANTS)) == 6


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6))
def test_observations_and_their_jacobian_are_the_twins(seed):
    [state] = states(seed, 1)
    expected = twins.observe(state, CONSTANTS)
    expected[BEARINGS] = wrap(expected[BEARINGS])
    np.testing.assert_allclose(models.observe(state[None], CONSTANTS)[0], expected, atol=1e-12)
    H = twins.complex_step(lambda x: twins.observe(x, CONSTANTS), state)
    np.testing.assert_allclose(models.observation_jacobian(state, CONSTANTS), H, rtol=1e-8, atol=1e-8)


def test_a_bearing_is_counted_from_the_vehicles_heading():
    state = np.zeros(12)
    state[2] = 2.0
    np.testing.assert_allclose(
        models.observe(state[None], CONSTANTS)[0, BEARINGS], np.pi * np.array([1, 3, -3, -1]) / 4
    )
    state[YAW] = np.pi / 2
    np.testing.assert_allclose(
        models.observe(state[None], CONSTANTS)[0, BEARINGS], np.pi * np.array([-1, 1, 3, -3]) / 4
    )


def test_innovations_are_wrapped_and_missing_readings_are_no_numbers():
    observation, predicted = np.zeros(11), np.zeros((1, 9))
    observation[BEARINGS], predicted[:, BEARINGS] = 3.1, -3.1
    observation[RANGES.start] = np.inf
    [v] = models.innovation(observation, predicted)
    assert np.isnan(v[0]) and not np.isnan(v[1:]).any()
    np.testing.assert_allclose(v[BEARINGS], 6.2 - 2 * np.pi)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.lists(st.integers(0, 8), max_size=9))
def test_log_likelihood_is_the_sum_of_normal_densities_of_what_is_there(seed, missing):
    rng = np.random.default_rng(seed)
    many = states(seed, 4)
    observation = np.append(models.observe(many[:1], CONSTANTS)[0] + CONSTANTS.sigma_z * rng.standard_normal(9), [1, 1])
    v = observation[:9] - models.observe(many, CONSTANTS)
    v[:, BEARINGS] = wrap(v[:, BEARINGS])
    observation[missing] = np.inf
    there = [i for i in range(9) if i not in missing]
    expected = norm.logpdf(v[:, there], scale=CONSTANTS.sigma_z[there]).sum(axis=1)
    np.testing.assert_allclose(models.log_likelihood(observation, many, CONSTANTS), expected, rtol=1e-10, atol=1e-10)
