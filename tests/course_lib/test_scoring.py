"""Errors and scores of a posterior.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.distance import cdist
from scipy.stats import binomtest, chi2, chisquare, kstest, multivariate_normal, norm

from course_lib.filters import Gaussian, Particles, covariance, equally_weighted, mean, normalise
from course_lib.scoring import best_share_error, energy_score, kernel_score, nees, region_rank, thin

FALSE_ALARM = 1e-6

distance_arrays = arrays(float, st.integers(1, 40), elements=st.floats(0.0, 10.0))


def equal(n):
    return np.full(n, 1.0 / n)


# the exercise's measure


@given(distance_arrays)
def test_best_half_is_the_exercises_measure(distances):
    distances = np.r_[distances, distances[::-1] + 1.0]
    expected = np.sort(distances)[: len(distances) // 2].mean()
    assert best_share_error(distances, equal(len(distances))) == pytest.approx(expected)


def test_of_an_odd_number_half_of_the_middle_particle_counts():
    assert best_share_error(np.array([5.0, 1.0, 2.0]), equal(3)) == pytest.approx((1.0 + 0.5 * 2.0) / 1.5)
    assert best_share_error(np.array([7.0]), equal(1)) == pytest.approx(7.0)


@given(distance_arrays, st.data())
def test_a_particle_of_weight_m_counts_as_m_particles(distances, data):
    copies = data.draw(arrays(int, len(distances), elements=st.integers(0, 5)))
    copies[0] += 1 + copies.sum() % 2  # at least one particle; their number is made even below
    copies[-1] += copies.sum() % 2
    duplicated = np.sort(np.repeat(distances, copies))
    expected = duplicated[: len(duplicated) // 2].mean()
    assert best_share_error(distances, copies / copies.sum()) == pytest.approx(expected, abs=1e-9)


def test_weight_far_away_is_paid_for_however_many_light_particles_lie_near():
    distances = np.r_[np.zeros(99), 4.0]
    assert best_share_error(distances, np.r_[np.full(99, 1e-9), 1.0 - 99e-9]) == pytest.approx(4.0, abs=1e-5)
    assert best_share_error(distances, np.r_[np.zeros(99), 1.0]) == pytest.approx(4.0)


def test_shares_other_than_one_half():
    distances, weights = np.array([3.0, 1.0, 2.0, 4.0]), np.array([0.1, 0.2, 0.3, 0.4])
    assert best_share_error(distances, weights, share=1.0) == pytest.approx(distances @ weights)
    assert best_share_error(distances, weights, share=0.2) == pytest.approx(1.0)
    assert best_share_error(distances, weights, share=0.25) == pytest.approx((0.2 * 1.0 + 0.05 * 2.0) / 0.25)


# energy score


@given(st.integers(1, 12), st.integers(1, 5), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_energy_score_is_its_definition(n, truths, dimensions, seed):
    rng = np.random.default_rng(seed)
    points, truths, weights = rng.normal(size=(n, dimensions)), rng.normal(size=(truths, dimensions)), rng.random(n)
    weights /= weights.sum()
    expected = (weights @ cdist(points, truths)).mean() - 0.5 * weights @ cdist(points, points) @ weights
    assert energy_score(points, weights, truths) == pytest.approx(expected)
    to_truth, to_others = (0.7 * (1.0 - np.exp(-cdist(points, others) / 0.7)) for others in (truths, points))
    expected = (weights @ to_truth).mean() - 0.5 * weights @ to_others @ weights
    assert energy_score(points, weights, truths, scale=0.7) == pytest.approx(expected)


def test_energy_score_of_one_point_is_its_distance():
    assert energy_score([[0.0, 0.0]], [1.0], [[3.0, 4.0]]) == pytest.approx(5.0)


@given(st.integers(0, 2**32 - 1))
def test_energy_score_splits_a_weight_without_noticing(seed):
    rng = np.random.default_rng(seed)
    points, truth = rng.normal(size=(5, 2)), rng.normal(size=(1, 2))
    copies = rng.integers(1, 4, size=5)
    duplicated = energy_score(np.repeat(points, copies, axis=0), equal(copies.sum()), truth)
    assert energy_score(points, copies / copies.sum(), truth) == pytest.approx(duplicated)


@pytest.mark.parametrize("shift, scale", [(0.5, 1.0), (0.0, 0.6), (0.0, 1.6), (0.3, 0.8)])
def test_no_forecast_scores_better_than_the_truths_own_distribution(shift, scale):
    # The mean difference of the scores over 4000 truths, in standard errors, by a one-sided z-test.
    rng = np.random.default_rng(31)
    sample, truths = rng.normal(size=(1000, 2)), rng.normal(size=(4000, 2))

    def scores(points):
        spread = cdist(points, points).mean()
        return cdist(truths, points).mean(axis=1) - 0.5 * spread

    assert scores(sample).mean() == pytest.approx(energy_score(sample, equal(1000), truths))
    loss = scores(shift + scale * sample) - scores(sample)
    assert norm.sf(loss.mean() / (loss.std() / np.sqrt(len(loss)))) < FALSE_ALARM


def test_where_distances_count_no_more_than_the_scale_one_cannot_be_more_wrong():
    points, truth = np.zeros((1, 2)), np.array([[30.0, 40.0]])
    assert energy_score(points, [1.0], truth) == pytest.approx(50.0)
    assert energy_score(points, [1.0], truth, scale=0.3) == pytest.approx(0.3)
    assert energy_score(points, [1.0], [[3e-4, 4e-4]], scale=0.3) == pytest.approx(5e-4, rel=1e-3)
    # In two places at once, both of them wrong, costs half as much; in neither in particular, too.
    assert energy_score([[0.0, 0.0], [9.0, 9.0]], equal(2), truth, scale=0.3) == pytest.approx(0.3 * 0.75)


# kernel score


@given(st.integers(1, 12), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_kernel_score_is_its_definition(n, dimensions, seed):
    rng = np.random.default_rng(seed)
    points, truth, weights = rng.normal(size=(n, dimensions)), rng.normal(size=dimensions), rng.random(n)
    weights /= weights.sum()

    def kernel(a, b):
        return np.exp(-0.5 * cdist(a, b) ** 2)

    expected = 0.5 * weights @ kernel(points, points) @ weights - weights @ kernel(points, truth[None])[:, 0] + 0.5
    assert kernel_score(points, weights, truth) == pytest.approx(expected, abs=1e-12)


def test_kernel_score_between_right_and_wrong():
    truth = np.array([1.0, 2.0])
    assert kernel_score([truth], [1.0], truth) == 0.0
    assert kernel_score([truth + 1e8], [1.0], truth) == pytest.approx(1.0)
    assert kernel_score(truth + 1e8 + np.random.default_rng(9).normal(size=(50, 2)), equal(50), truth) <= 1.0
    nowhere = 1e3 * np.random.default_rng(37).random((1000, 2))
    assert kernel_score(nowhere, equal(1000), truth) == pytest.approx(0.5, abs=1e-2)
    assert kernel_score([truth + 0.1], [1.0], truth) == pytest.approx(0.01, rel=1e-2)
    # To bet on one of two places that are equally likely costs more than to say that one does not know.
    honest = kernel_score([truth, truth + 9.0], equal(2), truth)
    assert honest == pytest.approx(0.25) and honest < 0.5 * (0.0 + 1.0)


def test_two_centres_game_the_best_half_and_not_the_energy_score():
    rng = np.random.default_rng(32)
    honest, truths = rng.normal(size=(1000, 2)), rng.normal(size=(500, 2))
    # The best two centres for a standard normal lie at ±√(2/π) on a line through the middle.
    gamed = np.repeat([[-1.0, 0.0], [1.0, 0.0]], 500, axis=0) * np.sqrt(2.0 / np.pi)

    def best_half(points):
        return np.mean([best_share_error(distances, equal(1000)) for distances in cdist(truths, points)])

    assert best_half(gamed) < 0.95 * best_half(honest)
    assert energy_score(gamed, equal(1000), truths) > 1.05 * energy_score(honest, equal(1000), truths)


# coverage


@pytest.mark.parametrize("n", [2, 4, 9])
def test_rank_of_a_truth_exchangeable_with_the_sample_is_uniform_however_small_the_sample(n):
    rng = np.random.default_rng(33)
    draws = rng.normal(size=(6000, n + 1, 2)) * [1.0, 3.0]
    ranks = [round(n * region_rank(draw[1:], equal(n), draw[0])) for draw in draws]
    assert chisquare(np.bincount(ranks, minlength=n + 1)).pvalue > FALSE_ALARM


def test_rank_in_a_weighted_sample_is_uniform():
    # The sample comes from a wider normal and is weighed into the truth's.
    rng = np.random.default_rng(34)
    ranks = []
    for _ in range(500):
        points, truth = 1.5 * rng.normal(size=(600, 2)), rng.normal(size=2)
        weights = np.exp(normalise(-0.5 * (points**2).sum(axis=1) * (1.0 - 1.5**-2))[0])
        ranks.append(region_rank(points, weights, truth))
    assert kstest(ranks, "uniform").pvalue > FALSE_ALARM


@pytest.mark.parametrize("scale, alternative", [(0.6, "less"), (1.6, "greater")])
def test_an_overconfident_sample_covers_too_little_and_an_overcautious_one_too_much(scale, alternative):
    rng = np.random.default_rng(35)
    ranks = [region_rank(scale * rng.normal(size=(100, 2)), equal(100), rng.normal(size=2)) for _ in range(600)]
    assert binomtest(sum(rank <= 0.9 for rank in ranks), len(ranks), 0.9, alternative).pvalue < FALSE_ALARM


def test_rank_at_the_centre_and_outside():
    points = np.random.default_rng(36).normal(size=(200, 2))
    assert region_rank(points, equal(200), np.zeros(2)) < 0.05
    assert region_rank(points, equal(200), np.array([30.0, 0.0])) == pytest.approx(1.0)


@pytest.mark.parametrize("copies", [1, 2, 50])
def test_one_place_is_right_there_and_nowhere_else(copies):
    points = np.repeat([[1.0, 2.0]], copies, axis=0)
    assert region_rank(points, equal(copies), np.array([1.0, 2.0])) == 0.0
    assert region_rank(points, equal(copies), np.array([1.0, 2.1])) == pytest.approx(1.0)


# normalised estimation error squared


def a_gaussian(rng, d):
    root = rng.normal(size=(d, d)) * 10.0 ** rng.uniform(-3, 3, size=(d, 1))
    return Gaussian(rng.normal(size=d), root @ root.T)


@pytest.mark.parametrize("d", [1, 2, 6])
def test_nees_of_truths_drawn_from_the_gaussian_is_chi_square(d):
    rng = np.random.default_rng(41)
    gaussian = a_gaussian(rng, d)
    values = nees(gaussian, rng.multivariate_normal(*gaussian, size=20_000, method="eigh"))
    assert kstest(values, chi2(d).cdf).pvalue > FALSE_ALARM
    # Mean d and variance 2d, by z-tests: a squared deviation has the variance 12 d (d + 4) - (2d)² = 8 d (d + 6).
    assert abs(values.mean() - d) < norm.isf(FALSE_ALARM / 2) * np.sqrt(2 * d / 20_000)
    squares = (values - d) ** 2
    assert abs(squares.mean() - 2 * d) < norm.isf(FALSE_ALARM / 2) * np.sqrt(8 * d * (d + 6) / 20_000)


@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_nees_is_twice_what_the_density_lost_since_its_peak(d, seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(d, d)) + 3.0 * np.eye(d)
    gaussian, truths = Gaussian(rng.normal(size=d), root @ root.T + 0.1 * np.eye(d)), rng.normal(size=(3, d))
    density = multivariate_normal(*gaussian)
    expected = 2.0 * np.atleast_1d(density.logpdf(gaussian.mean) - density.logpdf(truths))
    np.testing.assert_allclose(nees(gaussian, truths), expected, rtol=1e-6, atol=1e-9)


def test_nees_knows_that_a_full_turn_is_no_error():
    gaussian = Gaussian(np.array([1.0, np.pi - 0.1]), np.diag([0.04, 0.01]))
    truths = np.array([[1.0, -np.pi + 0.1], [1.2, np.pi - 0.1 - 6.0 * np.pi]])
    np.testing.assert_allclose(nees(gaussian, truths, angles=(1,)), [4.0, 1.0])
    assert nees(gaussian, truths)[0] > 1000.0
    np.testing.assert_allclose(truths[0], [1.0, -np.pi + 0.1])


def test_nees_where_the_gaussian_is_certain():
    flat = Gaussian(np.zeros(2), np.outer([1.0, 2.0], [1.0, 2.0]))
    np.testing.assert_allclose(nees(flat, np.array([[1.5, 3.0], [1.5, 3.1]])), [2.25, np.inf])
    sure = Gaussian(np.ones(3), np.zeros((3, 3)))
    np.testing.assert_allclose(nees(sure, np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.1]])), [0.0, np.inf])


# thinning


def test_thinning_keeps_the_weighted_mean_and_spread():
    rng = np.random.default_rng(37)
    particles = Particles(rng.normal(size=(4000, 2)), normalise(rng.normal(size=4000))[0])
    thinned = thin(particles, 1000, rng)
    assert thinned.states.shape == (1000, 2)
    np.testing.assert_allclose(thinned.weights, 1e-3)
    # Independent draws would be off by 5 standard deviations of 1/√1000 = 0.16 at most, with probability 1e-6.
    np.testing.assert_allclose(mean(thinned), mean(particles), atol=0.16)
    np.testing.assert_allclose(covariance(thinned), covariance(particles), atol=0.23)


def test_few_particles_of_unequal_weight_become_equally_weighted_ones():
    particles = Particles(np.arange(4.0)[:, None], np.log([0.5, 0.25, 0.125, 0.125]))
    thinned = thin(particles, 100, np.random.default_rng(38))
    assert np.bincount(thinned.states.ravel().astype(int))[0] == 2
    np.testing.assert_allclose(thinned.weights, 0.25)


def test_few_equally_weighted_particles_stay_as_they_are():
    particles = equally_weighted(np.arange(4.0)[:, None])
    assert thin(particles, 4, np.random.default_rng(39)) is particles
    assert len(thin(particles, 3, np.random.default_rng(39)).states) == 3
