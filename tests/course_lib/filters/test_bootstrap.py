"""The bootstrap filter against the exact Kalman filter.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import kstest, norm, ttest_1samp

from course_lib.filters import (
    Particles,
    ZeroLikelihoodError,
    bootstrap_step,
    covariance,
    effective_sample_size,
    equally_weighted,
    mean,
    multinomial,
    normalise,
    predict,
    resample,
    residual,
    roughen,
    stratified,
    systematic,
    update,
)

FALSE_ALARM = 1e-6

# A body that moves at nearly constant velocity, its position measured.
F = np.array([[1.0, 0.5], [0.0, 0.9]])
Q = np.array([[0.3, 0.1], [0.1, 0.2]])
H = np.array([[1.0, 0.0]])
R = 0.4
PRIOR_MEAN, PRIOR_COVARIANCE = np.array([0.5, -0.2]), np.array([[1.0, 0.2], [0.2, 0.5]])
OBSERVATIONS = np.array([0.3, 1.4, 0.2, -1.1, -0.8, -2.9, -1.7, -2.2])


def transition(states, rng):
    return states @ F.T + rng.standard_normal((len(states), 2)) @ np.linalg.cholesky(Q).T


def log_likelihood(observation, states):
    return -0.5 * (np.log(2 * np.pi * R) + (observation - states[:, 0]) ** 2 / R)


def draw_prior(n, rng):
    return equally_weighted(rng.multivariate_normal(PRIOR_MEAN, PRIOR_COVARIANCE, size=n))


def kalman(observations):
    """Exact log-evidence, posterior mean and covariance, in one array."""
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.x, kf.P, kf.F, kf.Q, kf.H, kf.R = PRIOR_MEAN[:, None], PRIOR_COVARIANCE, F, Q, H, np.array([[R]])
    log_evidence = 0.0
    for z in observations:
        kf.predict()
        kf.update(np.array([[z]]))
        log_evidence += kf.log_likelihood
    return np.r_[log_evidence, kf.x.ravel(), kf.P[[0, 0, 1], [0, 1, 1]]]


def particle_filter(observations, n, rng, step=bootstrap_step):
    """The same, as the particles estimate it."""
    particles, log_evidence = draw_prior(n, rng), 0.0
    for z in observations:
        particles, increment = step(particles, transition, lambda states, z=z: log_likelihood(z, states), rng)
        log_evidence += increment
    return np.r_[log_evidence, mean(particles), covariance(particles)[[0, 0, 1], [0, 1, 1]]]


def smallest_p_value(step, repetitions=20, n=5000):
    """Of six t-tests that the filter's answers, over its repetitions, scatter about the exact ones.

    The bias of a correct filter is of order 1 / n: a hundredth of the standard error of the mean here.
    """
    rng = np.random.default_rng(21)
    answers = [particle_filter(OBSERVATIONS, n, rng, step) for _ in range(repetitions)]
    return ttest_1samp(answers, kalman(OBSERVATIONS)).pvalue.min()


@pytest.mark.parametrize("scheme", [multinomial, stratified, systematic, residual])
@pytest.mark.parametrize("threshold", [0.0, 0.5, 1.0])
def test_filter_agrees_with_the_kalman_filter(scheme, threshold):
    def step(particles, transition, log_likelihood, rng):
        return bootstrap_step(particles, transition, log_likelihood, rng, scheme, threshold)

    assert smallest_p_value(step) > FALSE_ALARM / 6


def forgets_previous_weights(particles, transition, log_likelihood, rng):
    particles = predict(particles, transition, rng)
    log_weights, log_sum = normalise(log_likelihood(particles.states))
    return Particles(particles.states, log_weights), log_sum - np.log(len(log_weights))


def evidence_without_previous_weights(particles, transition, log_likelihood, rng):
    particles = predict(resample(particles, rng), transition, rng)
    log_likelihood = log_likelihood(particles.states)
    log_evidence = normalise(log_likelihood)[1] - np.log(len(log_likelihood))
    return update(particles, log_likelihood)[0], log_evidence


def resamples_before_weighing(particles, transition, log_likelihood, rng):
    particles = predict(particles, transition, rng)
    log_evidence = update(particles, log_likelihood(particles.states))[1]
    return resample(particles, rng, threshold=1.0), log_evidence


def keeps_weights_after_resampling(particles, transition, log_likelihood, rng):
    particles = predict(particles, transition, rng)
    particles, log_evidence = update(particles, log_likelihood(particles.states))
    chosen = systematic(particles.weights, rng)
    return Particles(particles.states[chosen], normalise(particles.log_weights[chosen])[0]), log_evidence


@pytest.mark.parametrize(
    "known_bad",
    [
        forgets_previous_weights,
        evidence_without_previous_weights,
        resamples_before_weighing,
        keeps_weights_after_resampling,
    ],
)
def test_the_same_check_rejects_a_wrong_filter(known_bad):
    assert smallest_p_value(known_bad) < 1e-3 * FALSE_ALARM


def test_evidence_is_unbiased_even_with_few_particles():
    # E[Ẑ] = Z exactly, at any N; its logarithm is below log Z on average, by Jensen's inequality.
    rng = np.random.default_rng(22)
    exact = kalman(OBSERVATIONS[:4])[0]
    log_ratio = np.array([particle_filter(OBSERVATIONS[:4], 20, rng)[0] for _ in range(700)]) - exact
    assert ttest_1samp(np.exp(log_ratio), 1.0).pvalue > FALSE_ALARM
    assert ttest_1samp(log_ratio, 0.0, alternative="less").pvalue < FALSE_ALARM


# predict and update


def test_predict_moves_states_and_keeps_weights():
    particles = Particles(np.arange(6.0).reshape(3, 2), np.log([0.2, 0.3, 0.5]))
    moved = predict(particles, lambda states, rng: states * rng.random(), np.random.default_rng(23))
    np.testing.assert_array_equal(moved.states, particles.states * np.random.default_rng(23).random())
    np.testing.assert_array_equal(moved.log_weights, particles.log_weights)


def test_update_is_bayes_rule():
    particles = Particles(np.zeros((3, 1)), np.log([0.2, 0.3, 0.5]))
    likelihood = np.array([0.1, 0.4, 0.02])
    posterior, log_evidence = update(particles, np.log(likelihood))
    joint = np.array([0.2, 0.3, 0.5]) * likelihood
    np.testing.assert_allclose(posterior.weights, joint / joint.sum())
    assert log_evidence == pytest.approx(np.log(joint.sum()))


def test_evidence_survives_where_likelihoods_underflow():
    particles, log_evidence = update(equally_weighted(np.zeros((4, 1))), -2000.0 - np.arange(4.0))
    np.testing.assert_allclose(particles.weights, [0.644, 0.237, 0.087, 0.032], atol=5e-4)
    assert log_evidence == pytest.approx(-2000.0 + np.log(np.exp(-np.arange(4.0)).mean()))


@pytest.mark.filterwarnings("error")
def test_an_observation_no_particle_explains_is_an_error():
    with pytest.raises(ZeroLikelihoodError, match="all 3 particles have zero likelihood"):
        update(equally_weighted(np.zeros((3, 1))), np.full(3, -np.inf))
    certain = Particles(np.zeros((2, 1)), np.array([0.0, -np.inf]))
    with pytest.raises(ZeroLikelihoodError):
        update(certain, np.array([-np.inf, 0.0]))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_log_likelihood_that_is_none_is_an_error_of_its_own(value):
    with pytest.raises(ValueError, match="must be finite or -inf") as error:
        update(equally_weighted(np.zeros((2, 1))), np.array([0.0, value]))
    assert not isinstance(error.value, ZeroLikelihoodError)


@pytest.mark.parametrize("shape", [(3, 1), (1, 3), (2,), ()])
def test_a_log_likelihood_of_another_shape_is_an_error(shape):
    with pytest.raises(ValueError, match=r"shape"):
        update(equally_weighted(np.zeros((3, 1))), np.zeros(shape))


def test_nothing_is_mutated():
    rng = np.random.default_rng(24)
    states, log_weights = rng.normal(size=(50, 2)), normalise(rng.normal(size=50))[0]
    particles = Particles(states.copy(), log_weights.copy())
    frozen = np.zeros(50)
    for array in (*particles, frozen):
        array.flags.writeable = False
    predict(particles, transition, rng)
    update(particles, frozen)
    resample(particles, rng, threshold=1.0)
    roughen(particles.states, rng, 0.1)
    bootstrap_step(particles, transition, lambda states: frozen, rng, threshold=1.0)
    np.testing.assert_array_equal(particles.states, states)
    np.testing.assert_array_equal(particles.log_weights, log_weights)


# resample


def test_resampling_waits_until_the_effective_sample_size_falls_below_the_threshold():
    rng = np.random.default_rng(25)
    particles = Particles(np.arange(4.0)[:, None], np.log([0.4, 0.3, 0.2, 0.1]))
    share = effective_sample_size(particles) / 4
    assert resample(particles, rng, threshold=share - 0.01) is particles
    resampled = resample(particles, rng, threshold=share + 0.01)
    np.testing.assert_allclose(resampled.weights, 0.25)
    assert set(resampled.states.ravel()) <= set(particles.states.ravel())


def test_the_ends_of_the_threshold():
    rng = np.random.default_rng(26)
    lost = Particles(np.arange(3.0)[:, None], np.array([0.0, -np.inf, -np.inf]))
    assert resample(lost, rng, threshold=0.0) is lost
    np.testing.assert_array_equal(resample(lost, rng, threshold=0.5).states, 0.0)
    # Equal weights are left alone, even by a scheme that would thin them out and whatever rounding does.
    for n in range(1, 100):
        particles = equally_weighted(np.zeros((n, 1)))
        assert resample(particles, rng, multinomial, threshold=1.0) is particles


def test_step_resamples_what_it_is_given_and_returns_weighted_particles():
    rng = np.random.default_rng(27)
    lost = Particles(np.arange(3.0)[:, None], np.array([-np.inf, -np.inf, 0.0]))
    particles, _ = bootstrap_step(lost, lambda states, rng: states + 1.0, lambda states: np.log([0.2, 0.3, 0.5]), rng)
    np.testing.assert_array_equal(particles.states, 3.0)
    np.testing.assert_allclose(particles.weights, [0.2, 0.3, 0.5])


# roughen


@pytest.mark.parametrize("extent", [[2.0, 30.0, 0.1], None])
def test_roughening_is_normal_with_gordons_standard_deviation(extent):
    rng = np.random.default_rng(28)
    states = rng.uniform(0.0, [1.0, 5.0, 100.0], size=(8000, 3))
    jitter = roughen(states, rng, 0.2, extent) - states
    # N^(1/3) = 20, so that σ = K E / 20.
    deviation = 0.01 * np.array(extent if extent else np.ptp(states, axis=0))
    for column, sigma in zip(jitter.T, deviation, strict=True):
        assert kstest(column, norm(scale=sigma).cdf).pvalue > FALSE_ALARM / 3
    assert np.abs(np.corrcoef(jitter.T) - np.eye(3)).max() < 0.07


def test_roughening_separates_copies():
    states = roughen(np.zeros((100, 2)), np.random.default_rng(29), 0.1, extent=[1.0, 1.0])
    assert len(np.unique(states, axis=0)) == 100
