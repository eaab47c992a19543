import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import multivariate_normal, vonmises

from course_lib.filters import (
    Gaussian,
    Particles,
    covariance,
    effective_sample_size,
    entropy,
    equally_weighted,
    mean,
    mode,
    normalise,
)

log_weight_arrays = arrays(float, st.integers(1, 30), elements=st.floats(-700.0, 700.0))


def particles_of(states, weights):
    return Particles(np.asarray(states, dtype=float), normalise(np.log(weights))[0])


# normalise


@given(log_weight_arrays, st.floats(-1e6, 1e6))
def test_normalised_weights_sum_to_one_and_forget_a_common_factor(log_weights, factor):
    normalised, log_sum = normalise(log_weights)
    assert np.exp(normalised).sum() == pytest.approx(1.0)
    shifted, shifted_sum = normalise(log_weights + factor)
    np.testing.assert_allclose(shifted, normalised, atol=1e-6)
    assert shifted_sum == pytest.approx(log_sum + factor, abs=1e-6)


def test_log_sum_is_the_logarithm_of_the_sum():
    assert normalise(np.log([0.5, 1.5, 3.0]))[1] == pytest.approx(np.log(5.0))


def test_a_weight_of_zero_stays_zero():
    np.testing.assert_allclose(np.exp(normalise([-np.inf, 0.0, 0.0])[0]), [0.0, 0.5, 0.5])


def test_weights_that_underflow_keep_their_ratios():
    log_weights = -2000.0 - np.arange(4.0)
    np.testing.assert_allclose(np.exp(normalise(log_weights)[0]), [0.644, 0.237, 0.087, 0.032], atol=5e-4)
    # Known-bad: the constant that filters add to avoid a division by zero makes all weights alike.
    underflown = np.exp(log_weights) + 1e-300
    np.testing.assert_array_equal(underflown / underflown.sum(), 0.25)


@pytest.mark.filterwarnings("error")
def test_all_weights_zero_is_told_without_a_warning():
    log_weights, log_sum = normalise(np.full(3, -np.inf))
    assert log_sum == -np.inf
    assert np.isnan(log_weights).all()


# effective sample size


@given(log_weight_arrays)
def test_effective_sample_size_lies_between_one_and_n(log_weights):
    size = effective_sample_size(Particles(np.zeros((len(log_weights), 1)), normalise(log_weights)[0]))
    assert 1.0 - 1e-9 <= size <= len(log_weights) * (1.0 + 1e-9)


@pytest.mark.parametrize(
    "weights, expected",
    [([1.0], 1.0), ([0.0, 1.0, 0.0], 1.0), ([0.25] * 4, 4.0), ([0.5, 0.5, 0.0], 2.0), ([0.6, 0.4], 1.0 / 0.52)],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_effective_sample_size_counts_the_particles_that_matter(weights, expected):
    assert effective_sample_size(particles_of(np.zeros((len(weights), 1)), weights)) == pytest.approx(expected)


# mean and covariance


def test_mean_and_covariance_without_angles_are_numpys():
    rng = np.random.default_rng(1)
    states, weights = rng.normal(size=(50, 3)) @ rng.normal(size=(3, 3)), rng.random(50)
    particles = particles_of(states, weights)
    np.testing.assert_allclose(mean(particles), np.average(states, axis=0, weights=weights))
    np.testing.assert_allclose(covariance(particles), np.cov(states.T, aweights=weights, ddof=0))


def test_mean_and_covariance_across_the_seam_are_those_of_the_unwrapped_headings():
    rng = np.random.default_rng(2)
    offset, weights = rng.uniform(-0.3, 0.3, size=400), rng.random(400)
    position = 2.0 * offset + rng.normal(size=400)
    # Symmetric about the seam, so that the circular mean is exactly there.
    offset, position, weights = np.r_[offset, -offset], np.r_[position, -position], np.r_[weights, weights]
    heading = np.where(offset < 0.0, np.pi + offset, -np.pi + offset)
    particles = particles_of(np.column_stack([position, heading]), weights)
    centre = mean(particles, angles=[1])
    assert centre[0] == pytest.approx(0.0, abs=1e-12)
    assert abs(centre[1]) == pytest.approx(np.pi)
    np.testing.assert_allclose(
        covariance(particles, angles=[1]), np.cov(position, offset, aweights=weights, ddof=0), atol=1e-12
    )
    # Known-bad: the same without saying that the column is an angle.
    assert abs(mean(particles)[1]) < 0.5
    assert covariance(particles)[1, 1] > 5.0


def test_statistics_leave_the_particles_alone():
    states = np.random.default_rng(3).uniform(-np.pi, np.pi, size=(30, 2))
    particles = equally_weighted(states.copy())
    for statistic in (mean, covariance, mode, entropy):
        statistic(particles, angles=[1])
    mode(particles, angles=[1])[:] = 9.0
    np.testing.assert_array_equal(particles.states, states)


# mode


def test_mode_lies_in_the_heavier_cluster_where_the_mean_lies_between():
    rng = np.random.default_rng(4)
    states = np.r_[rng.normal(0.0, 0.3, size=(300, 2)), rng.normal(10.0, 0.3, size=(300, 2))]
    particles = particles_of(states, np.repeat([0.7, 0.3], 300))
    np.testing.assert_allclose(mode(particles), [0.0, 0.0], atol=0.6)
    np.testing.assert_allclose(mean(particles), [3.0, 3.0], atol=0.1)
    assert (states == mode(particles)).all(axis=1).any()


def test_mode_is_defined_for_equal_weights():
    states = np.r_[np.linspace(-1, 1, 40) ** 3, [5.0, 5.1, 5.2]][:, None]
    assert abs(mode(equally_weighted(states))[0]) < 0.5


def test_mode_sees_a_cluster_that_the_seam_cuts_in_two():
    rng = np.random.default_rng(5)
    cut = np.pi + rng.normal(0.0, 0.1, size=500)
    whole = 1.5 + rng.normal(0.0, 0.1, size=350)
    heading = (np.r_[cut, whole] + np.pi) % (2 * np.pi) - np.pi
    assert abs(mode(equally_weighted(heading[:, None]), angles=[0])[0]) > 3.0


def test_mode_sees_a_cluster_opposite_to_the_circular_mean():
    # Two lesser clusters either side of zero outvote the greatest one, which lies at the seam.
    rng = np.random.default_rng(6)
    heading = np.repeat([-0.6, 0.6, np.pi], [320, 320, 360]) + rng.normal(0.0, 0.03, size=1000)
    particles = equally_weighted((heading[:, None] + np.pi) % (2 * np.pi) - np.pi)
    assert abs(mean(particles, angles=[0])[0]) < 0.5
    assert abs(mode(particles, angles=[0])[0]) > 3.0


# entropy


def test_entropy_of_a_gaussian_is_exact():
    covariance = np.array([[2.0, 0.3], [0.3, 0.5]])
    assert entropy(Gaussian(np.zeros(2), covariance)) == pytest.approx(multivariate_normal(cov=covariance).entropy())


def test_entropy_of_a_gaussian_on_a_line_is_minus_infinity():
    assert entropy(Gaussian(np.zeros(2), np.ones((2, 2)))) == -np.inf


def test_entropy_of_particles_comes_near_that_of_their_density():
    # The kernels widen the variance by 1 + N^(-1/3), and so raise the entropy by log(1 + 2000^(-1/3)) = 0.08 nats.
    covariance = np.array([[2.0, 0.3], [0.3, 0.5]])
    states = np.random.default_rng(7).multivariate_normal([1.0, 2.0], covariance, size=2000)
    assert entropy(equally_weighted(states)) == pytest.approx(multivariate_normal(cov=covariance).entropy(), abs=0.1)


def test_entropy_of_weighted_particles_is_that_of_the_density_they_stand_for():
    # Uniform on [-5, 5]², weighed into a standard normal of entropy log(2πe).
    states = np.random.default_rng(8).uniform(-5.0, 5.0, size=(3000, 2))
    particles = particles_of(states, np.exp(-0.5 * (states**2).sum(axis=1)))
    assert entropy(particles) == pytest.approx(np.log(2 * np.pi * np.e), abs=0.15)


def test_entropy_on_the_circle_has_no_seam():
    uniform = np.linspace(-np.pi, np.pi, 1000, endpoint=False)[:, None]
    assert entropy(equally_weighted(uniform), angles=[0]) == pytest.approx(np.log(2 * np.pi), abs=1e-3)
    concentrated = vonmises(4.0, loc=np.pi).rvs(2000, random_state=np.random.default_rng(9))
    expected = vonmises(4.0).entropy()
    assert entropy(equally_weighted(concentrated[:, None]), angles=[0]) == pytest.approx(expected, abs=0.05)
