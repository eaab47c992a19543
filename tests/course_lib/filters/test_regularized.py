"""The regularised filter: moments it keeps, copies it parts, and the Kalman filter's answers where that is exact.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, norm

from course_lib.angles import wrap
from course_lib.filters import (
    Gaussian,
    Particles,
    ZeroLikelihoodError,
    bootstrap,
    covariance,
    effective_sample_size,
    equally_weighted,
    extended_kalman,
    mean,
    normalise,
    regularized,
)

FALSE_ALARM = 1e-6


def cloud(rng, n=300, d=3):
    """Correlated, with an angle in column 1 that straddles the seam, and uneven weights."""
    states = rng.standard_normal((n, d)) @ rng.standard_normal((d, d))
    states[:, 1] = wrap(0.1 * states[:, 1] + 3.0)
    return Particles(states, normalise(rng.standard_normal(n))[0])


@given(st.integers(0, 10**6), st.integers(2, 40), st.sampled_from([(), (1,), (0, 2)]))
def test_moments_match_their_twins(seed, n, angles):
    particles = cloud(np.random.default_rng(seed), n)
    mask = np.isin(range(3), angles)
    centre, spread = regularized.moments(particles.states, particles.weights, mask)
    np.testing.assert_allclose(centre, mean(particles, angles), atol=1e-12)
    np.testing.assert_allclose(spread, covariance(particles, angles), atol=1e-9)


def test_spread_matches_its_twin():
    rng = np.random.default_rng(51)
    states, centre, root = rng.uniform(-3.0, 3.0, (40, 3)), np.array([1.0, 3.0, -1.0]), rng.standard_normal((3, 3))
    parents, noise = rng.integers(40, size=60), rng.standard_normal((60, 3))
    children = regularized.spread(states, parents, centre, root, noise, 0.8, np.array([False, True, False]))
    deviations = states[parents] - centre
    deviations[:, 1] = wrap(deviations[:, 1])
    expected = centre + 0.8 * deviations + noise @ root.T
    expected[:, 1] = wrap(expected[:, 1])
    np.testing.assert_allclose(children, expected, atol=1e-12)


@pytest.mark.parametrize("scale", [0.3, 1.0, 100.0])
def test_resampling_keeps_mean_and_covariance(scale):
    rng, n = np.random.default_rng(52), 20_000
    particles = cloud(rng, n)
    resampled = regularized.resample(particles, rng, threshold=1.0, angles=[1], scale=scale)
    m, P = mean(particles, [1]), covariance(particles, [1])
    # Whitened by what it should have: a mean of 3 numbers with variance at most 2 / n (the offspring's and the
    # kernel's), and second moments, whose kurtosis here is at most 6, within 5.5 standard deviations each.
    offset = wrap(mean(resampled, [1]) - m)
    assert n / 2 * offset @ np.linalg.solve(P, offset) < chi2(3).isf(FALSE_ALARM)
    root = np.linalg.cholesky(P)
    ratio = np.linalg.solve(root, np.linalg.solve(root, covariance(resampled, [1])).T)
    assert np.abs(ratio - np.eye(3)).max() < 5.5 * np.sqrt(6.0 / n)
    assert np.all(resampled.states[:, 1] >= -np.pi) and np.all(resampled.states[:, 1] < np.pi)


def test_copies_part():
    rng = np.random.default_rng(53)
    weights = np.full(100, 1e-6)
    weights[:10] = 1.0
    particles = Particles(cloud(rng, 100).states, normalise(np.log(weights))[0])
    assert len(np.unique(bootstrap.resample(particles, rng).states, axis=0)) <= 12
    assert len(np.unique(regularized.resample(particles, rng, angles=[1]).states, axis=0)) == 100


def test_resampling_waits_as_the_bootstrap_filters_does():
    rng = np.random.default_rng(54)
    particles = cloud(rng)
    share = effective_sample_size(particles) / 300
    assert regularized.resample(particles, rng, threshold=share - 0.01) is particles
    assert regularized.resample(particles, rng, threshold=share + 0.01) is not particles


@pytest.mark.filterwarnings("error")
def test_a_cloud_of_one_particle_stays_where_it_is():
    particles = Particles(np.tile([1.0, 3.1, -2.0], (50, 1)), normalise(np.arange(50.0))[0])
    resampled = regularized.resample(particles, np.random.default_rng(55), angles=[1])
    np.testing.assert_allclose(resampled.states, particles.states, atol=1e-9)


def test_root_of_a_singular_covariance():
    factor = np.random.default_rng(56).standard_normal((4, 2)) * np.array([[1e6], [1.0], [1e-4], [0.0]])
    root = regularized.square_root(factor @ factor.T)
    scale = np.maximum(np.abs(factor).max(axis=1), 1e-4)
    np.testing.assert_allclose((root @ root.T - factor @ factor.T) / np.outer(scale, scale), 0.0, atol=1e-12)


def test_bandwidth_is_the_textbooks():
    # In one dimension Silverman's (4 / 3n)^(1/5).
    assert regularized.bandwidth(1000, 1) == pytest.approx((4.0 / 3000.0) ** 0.2)
    assert regularized.bandwidth(5000, 12) == pytest.approx(0.5430, abs=1e-4)


# Taking the likelihood in parts


def gaussian_likelihood(z, sigma):
    return lambda states: norm(z, sigma).logpdf(states).sum(axis=1)


@pytest.mark.parametrize("sigma", [3.0, 0.1, 0.01])
def test_parts_lead_to_the_posterior_however_precise_the_readings(sigma):
    # A prior N(0, I) in 4 dimensions; all at once, σ = 0.01 leaves one particle in 10⁸.
    rng, n, z = np.random.default_rng(57), 4000, np.array([1.0, -0.5, 0.3, 0.0])
    variance = 1.0 / (1.0 + sigma**-2)
    exact_mean, exact_evidence = z * variance / sigma**2, norm(0.0, np.hypot(1.0, sigma)).logpdf(z).sum()
    answers = []
    for _ in range(20):
        prior = equally_weighted(rng.standard_normal((n, 4)))
        particles, log_evidence = regularized.update(prior, gaussian_likelihood(z, sigma), rng)
        answers.append([log_evidence, *(mean(particles) - exact_mean) / np.sqrt(variance)])
        assert np.diag(covariance(particles)) / variance == pytest.approx(1.0, abs=0.3)
    answers = np.array(answers)
    # Each answer's error is a few hundredths; the kernel's approximation costs no more than that.
    assert np.abs(answers[:, 1:].mean(axis=0)).max() < 0.05
    assert answers[:, 0].mean() == pytest.approx(exact_evidence, abs=0.15)


def test_all_at_once_is_the_bootstrap_filters_update():
    rng = np.random.default_rng(58)
    particles, likelihood = cloud(rng), gaussian_likelihood(0.0, 1.0)
    expected, log_evidence = bootstrap.update(particles, likelihood(particles.states))
    for share in (0.0, 0.01):
        got, evidence = regularized.update(particles, likelihood, rng, share)
        np.testing.assert_array_equal(got.log_weights, expected.log_weights)
        assert evidence == log_evidence


def test_an_absurd_reading_ends_in_a_bounded_number_of_parts():
    calls = []

    def likelihood(states):
        calls.append(len(states))
        return gaussian_likelihood(1e9, 1e-3)(states)

    particles, log_evidence = regularized.update(
        cloud(np.random.default_rng(59)), likelihood, np.random.default_rng(60)
    )
    assert len(calls) == regularized.MOST_PARTS
    assert np.isfinite(log_evidence) and np.isfinite(particles.states).all()


def test_an_impossible_reading_is_an_error():
    particles = cloud(np.random.default_rng(61))
    with pytest.raises(ZeroLikelihoodError):
        regularized.update(particles, lambda states: np.full(len(states), -np.inf), np.random.default_rng(62))
    with pytest.raises(ValueError, match="must be finite"):
        regularized.update(particles, lambda states: np.full(len(states), np.nan), np.random.default_rng(62))


# The case it is for: what is measured shows the noise two integrations later

STEP = 0.05
F = np.array([[1.0, STEP, STEP**2 / 2], [0.0, 1.0, STEP], [0.0, 0.0, 1.0]])
Q = np.diag([0.0, 0.0, 0.02**2])
H, R = np.array([[1.0, 0.0, 0.0]]), np.array([[0.05**2]])
PRIOR = Gaussian(np.zeros(3), np.eye(3))


def errors(resample, n=500, steps=150, seed=63):
    """Over the second half, against the Kalman filter's Gaussian, in its standard deviations: the RMS distance of the
    mean, and the mean variance."""
    rng = np.random.default_rng(seed)
    truth, gaussian = rng.standard_normal(3), PRIOR
    particles, squares, variances = equally_weighted(rng.standard_normal((n, 3))), [], []
    for _ in range(steps):
        truth = F @ truth + np.sqrt(Q) @ rng.standard_normal(3)
        z = H @ truth + 0.05 * rng.standard_normal(1)
        gaussian = extended_kalman.predict(gaussian, F @ gaussian.mean, F, Q)
        gaussian, _ = extended_kalman.update(gaussian, z - H @ gaussian.mean, H, R)
        particles = resample(particles, rng)
        states = particles.states @ F.T + rng.standard_normal((n, 3)) @ np.sqrt(Q)
        particles = bootstrap.update(Particles(states, particles.log_weights), norm(z, 0.05).logpdf(states[:, 0]))[0]
        offset = mean(particles) - gaussian.mean
        squares.append(offset @ np.linalg.solve(gaussian.covariance, offset) / 3)
        variances.append(np.trace(np.linalg.solve(gaussian.covariance, covariance(particles))) / 3)
    return np.sqrt(np.mean(squares[steps // 2 :])), np.mean(variances[steps // 2 :])


def test_it_follows_where_the_bootstrap_filter_is_lost():
    distance, variance = errors(regularized.resample)
    assert distance < 0.4 and 0.8 < variance < 1.1
    distance, variance = errors(bootstrap.resample)
    assert distance > 3.0 and variance < 0.5


def kernel_without_shrinkage(particles, rng):
    """Regularised as before Liu and West: the kernel's variance is added at every resampling."""
    if effective_sample_size(particles) >= 0.5 * len(particles.states):
        return particles
    P, n = covariance(particles), len(particles.states)
    noise = rng.standard_normal((n, 3)) @ (regularized.bandwidth(n, 3) * np.linalg.cholesky(P)).T
    return equally_weighted(bootstrap.resample(particles, rng, threshold=1.0).states + noise)


def roughened(particles, rng):
    resampled = bootstrap.resample(particles, rng)
    if resampled is particles:
        return particles
    return equally_weighted(bootstrap.roughen(resampled.states, rng, 0.2))


def test_a_kernel_alone_adds_variance_and_jitter_without_correlations_does_not_help():
    assert errors(kernel_without_shrinkage)[1] > 1.15
    assert errors(roughened)[0] > 3.0
