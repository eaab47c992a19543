"""Resampling schemes.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability it states.
"""

import numpy as np
import pytest
from filterpy.monte_carlo import residual_resample
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from course_lib.filters import equally_weighted, multinomial, residual, stratified, systematic
from course_lib.filters.resampling import inverse_cdf, systematic_indices

SCHEMES = [multinomial, stratified, systematic, residual]
REPETITIONS = 6_000
FALSE_ALARM = 1e-6

weight_arrays = arrays(
    float,
    st.integers(1, 40),
    elements=st.one_of(st.just(0.0), st.floats(0.0, 1.0), st.floats(5e-324, 1e-300), st.floats(1e-3, 1.0)),
).filter(lambda weights: weights.sum() > 0.0)


def offspring(scheme, weights, rng, size=None, repetitions=REPETITIONS):
    """How often each index was drawn in each repetition, shape (repetitions, N)."""
    drawn = [np.bincount(scheme(weights, rng, size), minlength=len(weights)) for _ in range(repetitions)]
    return np.array(drawn)


def assert_unbiased(scheme, weights, size=None):
    """Mean offspring of each index is size · w, within Hoeffding's bound for FALSE_ALARM over all indices.

    One repetition's offspring lie in [0, size], so that the mean of R misses its expectation by more than
    size √(log(2N / α) / 2R) with probability at most α / N.
    """
    weights = np.asarray(weights, dtype=float)
    size = size or len(weights)
    counts = offspring(scheme, weights, np.random.default_rng(11), size)
    assert (counts.sum(axis=1) == size).all()
    bound = size * np.sqrt(np.log(2 * len(weights) / FALSE_ALARM) / (2 * REPETITIONS))
    excess = np.abs(counts.mean(axis=0) - size * weights / weights.sum()).max()
    assert excess <= bound, f"offspring are off by {excess:.3f} on average, {bound:.3f} would be chance"


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(
    "weights, size",
    [
        ([0.5, 0.3, 0.2], None),
        ([0.05, 0.4, 0.0, 0.3, 0.25], None),
        ([0.05, 0.4, 0.0, 0.3, 0.25], 3),
        ([0.05, 0.4, 0.0, 0.3, 0.25], 11),
        ([0.0, 1e-9, 0.9, 0.1 - 1e-9], None),
    ],
)
def test_offspring_are_unbiased(scheme, weights, size):
    assert_unbiased(scheme, weights, size)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_same_check_rejects_filterpys_residual_resampling():
    def known_bad(weights, rng, size):
        return residual_resample(weights)

    with pytest.raises(AssertionError, match="offspring are off by"):
        assert_unbiased(known_bad, [0.5, 0.3, 0.2])


@given(weight_arrays, st.integers(0, 60), st.integers(0, 2**32 - 1))
@pytest.mark.parametrize("scheme", SCHEMES)
def test_indices_are_sorted_as_many_as_asked_for_and_never_of_zero_weight(scheme, weights, size, seed):
    indices = scheme(weights, np.random.default_rng(seed), size)
    assert indices.shape == (size,) and indices.dtype == np.int64
    assert (np.diff(indices) >= 0).all()
    assert (weights[indices] > 0.0).all()
    assert len(scheme(weights, np.random.default_rng(seed))) == len(weights)


@given(weight_arrays, st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_systematic_offspring_are_the_expectation_rounded_down_or_up(weights, size, seed):
    weights = weights / weights.sum()
    expected = size * weights
    counts = np.bincount(systematic(weights, np.random.default_rng(seed), size), minlength=len(weights))
    # Where the expectation is a whole number but for rounding, either side of it is right.
    assert (np.floor(expected - 1e-9) <= counts).all() and (counts <= np.ceil(expected + 1e-9)).all()


@given(weight_arrays, st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_residual_offspring_are_at_least_the_expectation_rounded_down(weights, size, seed):
    weights = weights / weights.sum()
    expected = size * weights
    counts = np.bincount(residual(weights, np.random.default_rng(seed), size), minlength=len(weights))
    assert (counts >= np.floor(expected * (1.0 + 1e-13))).all()


@pytest.mark.parametrize("scheme", [stratified, systematic, residual])
def test_equal_weights_give_each_particle_one_offspring(scheme):
    rng = np.random.default_rng(12)
    for n in range(1, 300):
        weights = equally_weighted(np.zeros((n, 1))).weights
        np.testing.assert_array_equal(scheme(weights, rng), np.arange(n))


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("error", [-1e-16, 1e-16, -1e-9, 1e-9])
def test_weights_need_not_sum_to_one_exactly(scheme, error):
    weights = np.full(10, 0.1)
    weights[-1] += error
    indices = scheme(weights, np.random.default_rng(13), 1000)
    assert indices.max() == 9 and indices.shape == (1000,)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_one_particle_may_hold_all_the_weight(scheme):
    for i in range(4):
        np.testing.assert_array_equal(scheme(np.eye(4)[i], np.random.default_rng(14)), np.full(4, i))


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(
    "weights, message",
    [
        ([], "must have shape"),
        ([[0.5, 0.5]], "must have shape"),
        ([0.5, -0.1, 0.6], "finite and non-negative"),
        ([0.5, np.nan], "finite and non-negative"),
        ([0.5, np.inf], "finite and non-negative"),
        ([0.0, 0.0], "one of them positive"),
    ],
)
def test_weights_that_are_none_are_refused(scheme, weights, message):
    with pytest.raises(ValueError, match=message):
        scheme(weights, np.random.default_rng(15))


def test_schemes_differ_in_variance_as_the_source_says():
    # Σᵢ var(nᵢ); multinomial's is exact: size Σ w (1 - w). Each pair differs by many times its sampling error.
    weights = np.array([0.03, 0.17, 0.1, 0.2, 0.22, 0.28])
    variance = {
        scheme.__name__: offspring(scheme, weights, np.random.default_rng(16)).var(axis=0).sum() for scheme in SCHEMES
    }
    assert variance["multinomial"] == pytest.approx(6 * (weights * (1 - weights)).sum(), rel=0.05)
    assert variance["multinomial"] > 1.1 * variance["residual"]
    assert variance["multinomial"] > 1.1 * variance["stratified"]
    assert variance["residual"] > 1.1 * variance["systematic"]
    assert variance["stratified"] > 1.1 * variance["systematic"]


# the kernel and its twin


def inverse_cdf_numpy(weights, positions):
    cumulative = np.cumsum(weights)
    last = np.flatnonzero(weights)[-1]
    return np.minimum(np.searchsorted(cumulative, positions * cumulative[-1], side="right"), last)


@given(weight_arrays, st.lists(st.floats(0.0, 1.0), max_size=50))
@example(np.array([0.0, 5e-324, 0.0]), [0.0, 0.5, 1.0])
@example(np.array([0.25, 0.0, 0.25, 0.5, 0.0]), [0.0, 0.25, 0.5, np.nextafter(1.0, 0.0), 1.0])
def test_kernel_equals_its_numpy_twin(weights, positions):
    positions = np.sort(np.array(positions, dtype=float))
    np.testing.assert_array_equal(inverse_cdf(weights, positions), inverse_cdf_numpy(weights, positions))


@given(st.lists(st.integers(0, 8), min_size=1, max_size=20), st.lists(st.integers(0, 255), max_size=50))
def test_kernel_equals_the_search_in_normalised_cumulative_weights(counts, positions):
    # Weights are multiples of 2⁻¹⁰ that sum to a power of two, positions of 2⁻⁸: no rounding on either side.
    total = sum(counts)
    counts.append((1 << total.bit_length()) - total)
    weights, positions = np.array(counts) / 1024, np.sort(positions) / 256
    cumulative = np.cumsum(weights)
    expected = np.searchsorted(cumulative / cumulative[-1], positions, side="right")
    np.testing.assert_array_equal(inverse_cdf(weights, positions), expected)


def systematic_numpy(weights, shift, size):
    """The index of each child, from the partial sums: the textbook's systematic resampling."""
    cumulative = np.cumsum(weights)
    return np.searchsorted(size * (cumulative / cumulative[-1]), np.arange(size) + shift, side="right")


@pytest.mark.parametrize("size", [0, 1, 100, 1000, 5000])
@pytest.mark.parametrize("power", [0.0, 1.0, 30.0])
def test_systematic_kernel_equals_its_numpy_twin(size, power):
    rng = np.random.default_rng(1)
    weights = rng.random(1000) ** power
    weights[rng.random(1000) < 0.3] = 0.0
    shift = rng.random()
    indices = systematic_indices(weights, shift, size)
    np.testing.assert_array_equal(indices, systematic_numpy(weights, shift, size))
    np.testing.assert_array_equal(indices, inverse_cdf(weights, (np.arange(size) + shift) / size))


@given(st.lists(st.integers(0, 8), min_size=1, max_size=20), st.integers(0, 255), st.integers(0, 50))
def test_systematic_kernel_is_exact_where_nothing_is_rounded(counts, shift, size):
    # Weights are multiples of 2⁻¹⁰ that sum to a power of two, the shift one of 2⁻⁸.
    total = sum(counts)
    counts.append((1 << total.bit_length()) - total)
    weights, shift = np.array(counts) / 1024, shift / 256
    np.testing.assert_array_equal(systematic_indices(weights, shift, size), systematic_numpy(weights, shift, size))


def test_systematic_kernel_never_takes_an_index_of_zero_weight():
    for weights in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.5, 0.0], [0.0, 5e-324, 0.0]):
        for shift in (0.0, 0.5, 1.0 - 2**-53):
            assert np.all(np.array(weights)[systematic_indices(np.array(weights), shift, 7)] > 0.0)
