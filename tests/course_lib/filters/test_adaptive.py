"""Augmented MCL's averages and KLD-sampling: closed forms, twins, and the faults that others shipped.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, chi2, entropy

from course_lib.filters import Particles, adaptive, bins, equally_weighted, normalise

FALSE_ALARM = 1e-6
WIDTHS = (0.5, 0.5, np.radians(10.0))


def cloud(rng, n=300, spread=1.0):
    states = np.column_stack([rng.normal(0.0, spread, (n, 2)), 3.0 + rng.normal(0.0, spread, n)])
    return Particles(states, normalise(rng.standard_normal(n))[0])


# Averages


def test_averages_are_the_books_recursion():
    likelihoods = np.random.default_rng(1).exponential(size=30)
    slow = fast = likelihoods[0]
    running = adaptive.averages(None, np.log(likelihoods[0]), 0.05, 0.5)
    assert running.share == 0.0
    for w in likelihoods[1:]:
        slow, fast = slow + 0.05 * (w - slow), fast + 0.5 * (w - fast)
        running = adaptive.averages(running, np.log(w), 0.05, 0.5)
        assert np.exp(running) == pytest.approx([slow, fast])
        assert running.share == pytest.approx(max(0.0, 1.0 - fast / slow))


@given(st.floats(-1e4, 1e4), st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=8))
def test_units_of_the_likelihood_do_not_matter(shift, logs):
    # A constant factor, such as the unit of the ranges, cancels: also where exp() of it is 0 or inf.
    running = shifted = None
    for value in logs:
        running = adaptive.averages(running, value, 0.01, 0.3)
        shifted = adaptive.averages(shifted, value + shift, 0.01, 0.3)
    assert shifted.share == pytest.approx(running.share, abs=1e-9)


def test_a_likelihood_of_zero_calls_for_particles_and_no_likelihood_ever_for_none():
    running = adaptive.averages(adaptive.averages(None, 0.0, 0.0, 1.0), -np.inf, 0.0, 1.0)
    assert running.share == 1.0
    running = adaptive.averages(adaptive.averages(None, -np.inf, 0.1, 0.5), -np.inf, 0.1, 0.5)
    assert running.share == 0.0
    assert adaptive.averages(running, 0.0, 0.1, 0.5).share == 0.0


@pytest.mark.parametrize("rates", [(0.7, 0.3), (0.3, 0.3), (-0.1, 0.3), (0.1, 1.5), (np.nan, 0.3)])
def test_rates_out_of_order_are_refused(rates):
    with pytest.raises(ValueError, match="0 <= alpha_slow < alpha_fast <= 1"):
        adaptive.averages(None, 0.0, *rates)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_likelihood_that_is_none_is_refused(value):
    with pytest.raises(ValueError, match="mean likelihood must be finite"):
        adaptive.averages(None, value, 0.1, 0.3)


# Of a share: a hundred steps with logarithms below 20, whose last digit is 4e-15, and two roundings in each.
ROUNDING = 1e-12


def shares(alpha_slow, alpha_fast, reset=False, lost=20):
    """The share of random particles while a tracked robot (likelihood 1) is lost (1e-6) and finds itself again."""
    running, result = None, []
    for w in [1.0] * 50 + [1e-6] * lost + [1.0] * 50:
        running = adaptive.averages(running, np.log(w), alpha_slow, alpha_fast)
        result.append(running.share)
        if reset and running.share > ROUNDING:
            running = None
    return np.array(result)


def test_particles_come_while_the_robot_is_lost_and_then_stop():
    share = shares(0.01, 0.3)
    assert share[:50].max() < ROUNDING and share[51:70].min() > 0.4 and share[90:].max() < 0.01


def test_swapped_rates_do_it_the_other_way_round():
    # The source's 0.7 and 0.3, which `averages` refuses: written out.
    slow = fast = 1.0
    share = []
    for w in [1e-6] * 20 + [1.0] * 5:
        slow, fast = slow + 0.7 * (w - slow), fast + 0.3 * (w - fast)
        share.append(max(0.0, 1.0 - fast / slow))
    assert max(share[:20]) == 0.0
    assert share[20] > 0.5


def test_averages_reset_after_an_injection_forget_what_good_was():
    assert np.count_nonzero(shares(0.01, 0.3)[50:70] > ROUNDING) == 20
    assert np.count_nonzero(shares(0.01, 0.3, reset=True)[50:70] > ROUNDING) == 1


# Injection


def test_injection_replaces_each_particle_with_the_probability():
    rng, n = np.random.default_rng(2), 20_000
    particles = cloud(rng, n)
    injected = adaptive.inject(particles, 0.3, lambda m, rng: np.full((m, 3), 100.0), rng)
    replaced = injected.states[:, 0] == 100.0
    assert binom(n, 0.3).ppf(FALSE_ALARM / 2) <= replaced.sum() <= binom(n, 0.3).isf(FALSE_ALARM / 2)
    np.testing.assert_array_equal(injected.states[~replaced], particles.states[~replaced])
    np.testing.assert_array_equal(injected.log_weights, particles.log_weights)


def test_a_share_of_less_than_one_particle_is_not_rounded_away():
    rng, particles = np.random.default_rng(3), equally_weighted(np.zeros((100, 3)))
    count = sum(
        int(adaptive.inject(particles, 0.001, lambda m, rng: np.ones((m, 3)), rng).states[:, 0].sum())
        for _ in range(1000)
    )
    assert binom(100_000, 0.001).ppf(FALSE_ALARM / 2) <= count <= binom(100_000, 0.001).isf(FALSE_ALARM / 2)


def test_all_or_none():
    rng, particles = np.random.default_rng(4), cloud(np.random.default_rng(5))
    assert adaptive.inject(particles, 0.0, None, rng) is particles
    assert (adaptive.inject(particles, 1.0, lambda m, rng: np.full((m, 3), 9.0), rng).states == 9.0).all()
    assert np.abs(particles.states).max() < 9.0


# KLD-sampling: the bound


def test_bound_is_wilson_and_hilfertys_quantile():
    k = np.arange(2, 500)
    exact = chi2(k - 1).isf(0.01) / (2 * 0.05)
    np.testing.assert_allclose(adaptive.kld_bound(k, 0.05, 0.01)[5:], exact[5:], rtol=2e-3)
    np.testing.assert_allclose(adaptive.kld_bound(k, 0.05, 0.01), exact, rtol=0.02)
    assert adaptive.kld_bound(3, 0.05, 0.01) == adaptive.kld_bound([3], 0.05, 0.01)[0]


@pytest.mark.filterwarnings("error")
def test_one_bin_needs_no_draws():
    np.testing.assert_array_equal(adaptive.kld_bound([0, 1], 0.05, 0.01), 0.0)
    assert np.all(np.diff(adaptive.kld_bound(np.arange(1, 100), 0.05, 0.01)) > 0.0)


def test_the_bound_keeps_what_it_promises():
    # Histograms of n draws from 30 bins are farther than ε from the distribution in a share of about δ.
    rng, epsilon, delta, trials = np.random.default_rng(6), 0.05, 0.05, 2000
    p = rng.dirichlet(np.full(30, 5.0))
    n = int(np.ceil(adaptive.kld_bound(30, epsilon, delta)))
    farther = (entropy(rng.multinomial(n, p, trials) / n, p, axis=1) > epsilon).sum()
    # χ² is the limit of 2 n KL; at this n its tail is within a factor of two.
    assert binom(trials, delta / 2).ppf(FALSE_ALARM) <= farther <= binom(trials, 2 * delta).isf(FALSE_ALARM)


@pytest.mark.parametrize("epsilon, delta", [(0.0, 0.1), (-1.0, 0.1), (0.1, 0.0), (0.1, 1.0), (np.nan, 0.1)])
def test_impossible_bounds_are_refused(epsilon, delta):
    with pytest.raises(ValueError, match="epsilon > 0 and 0 < delta < 1"):
        adaptive.kld_bound(5, epsilon, delta)


# KLD-sampling: the draws


def bin_of(state, widths, angles):
    """The twin's bin: a tuple."""
    result = []
    for c, (value, width) in enumerate(zip(state, widths, strict=True)):
        if c in angles:
            around = int(np.ceil(2 * np.pi / width - 1e-9))
            result.append(int(np.floor(value / (2 * np.pi / around))) % around)
        else:
            result.append(int(np.floor(value / width)))
    return tuple(result)


def kld_twin(particles, rng, widths, epsilon, delta, least, most, angles):
    """`kld_resample` as the book has it, with a set."""
    cumulative = np.cumsum(particles.weights)
    occupied, parents = set(), []
    while len(parents) < most and (
        len(parents) < least or len(parents) < adaptive.kld_bound(len(occupied), epsilon, delta)
    ):
        parents.append(int(np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right")))
        occupied.add(bin_of(particles.states[parents[-1]], widths, angles))
    return particles.states[parents]


@given(
    st.integers(0, 10**6),
    st.integers(1, 60),
    st.floats(0.01, 3.0),
    st.sampled_from([(1, 1), (1, 400), (30, 200), (50, 50)]),
    st.sampled_from([(), (2,), (0, 2)]),
)
def test_kld_resampling_matches_its_twin(seed, n, spread, bounds, angles):
    particles = cloud(np.random.default_rng(seed), n, spread)
    ours, theirs = np.random.default_rng(seed), np.random.default_rng(seed)
    drawn = adaptive.kld_resample(particles, ours, WIDTHS, 0.1, 0.05, *bounds, angles)
    expected = kld_twin(particles, theirs, WIDTHS, 0.1, 0.05, *bounds, angles)
    np.testing.assert_array_equal(drawn.states, expected)
    np.testing.assert_array_equal(drawn.weights, equally_weighted(expected).weights)
    # Not one random number more than there are draws.
    assert ours.random() == theirs.random()


def test_every_particle_is_drawn_by_its_weight():
    rng, n, size = np.random.default_rng(7), 20, 40_000
    states = np.column_stack([np.arange(n), np.zeros((n, 2))])
    particles = Particles(states, normalise(rng.standard_normal(n))[0])
    drawn = adaptive.kld_resample(particles, rng, WIDTHS, least=size, most=size)
    counts = np.bincount(drawn.states[:, 0].astype(int), minlength=n)
    expected = size * particles.weights
    assert ((counts - expected) ** 2 / expected).sum() < chi2(n - 1).isf(FALSE_ALARM)


def test_particles_of_no_weight_are_never_drawn():
    log_weights = np.full(10, -np.inf)
    log_weights[4] = 0.0
    particles = Particles(np.arange(30.0).reshape(10, 3), log_weights)
    drawn = adaptive.kld_resample(particles, np.random.default_rng(8), WIDTHS, least=500, most=500)
    assert (drawn.states == particles.states[4]).all()


def test_the_size_follows_the_cloud():
    rng = np.random.default_rng(9)
    sizes = [
        len(adaptive.kld_resample(cloud(rng, 5000, spread), rng, WIDTHS, least=50, most=20_000, angles=(2,)).states)
        for spread in (0.001, 0.05, 0.3, 2.0)
    ]
    assert sizes == sorted(sizes) and sizes[0] < 200 and sizes[-1] > 5000


def test_the_bound_is_of_the_bins_now_and_not_of_those_before():
    # A cached bound would keep the size that the wide cloud needed, or the narrow one.
    rng = np.random.default_rng(10)
    narrow, wide = cloud(rng, 2000, 0.01), cloud(rng, 2000, 1.0)
    first = len(adaptive.kld_resample(narrow, np.random.default_rng(11), WIDTHS, least=10).states)
    adaptive.kld_resample(wide, rng, WIDTHS, least=10)
    assert len(adaptive.kld_resample(narrow, np.random.default_rng(11), WIDTHS, least=10).states) == first


def test_the_seam_of_the_circle_is_no_border():
    # Headings a little left and right of π, as wrapped numbers 2π apart, need what headings about 0.1 need.
    rng = np.random.default_rng(12)
    offsets = rng.uniform(-0.05, 0.05, 500)
    across = np.column_stack([np.zeros((500, 2)), np.where(offsets < 0.0, np.pi + offsets, -np.pi + offsets)])
    odd = (1.0, 1.0, 2 * np.pi / 37)  # the seam lies in the middle of a bin
    for states in (across, across + [0.0, 0.0, 6 * np.pi]):
        drawn = adaptive.kld_resample(equally_weighted(states), rng, odd, least=10, angles=(2,))
        assert len(drawn.states) == 10
    assert len(adaptive.kld_resample(equally_weighted(across), rng, odd, least=10).states) > 10


def test_a_sum_of_weights_below_one_still_ends():
    # Half of all clouds' cumulative weights end below 1: an index past the end, in the filters that forget it.
    particles = Particles(np.zeros((3, 3)), np.log([0.2, 0.2, 0.2]))
    drawn = adaptive.kld_resample(particles, np.random.default_rng(13), WIDTHS, least=1000, most=1000)
    assert len(drawn.states) == 1000


def test_impossible_arguments_are_refused():
    particles, rng = cloud(np.random.default_rng(14)), np.random.default_rng(15)
    for arguments, message in [
        ({"least": 0}, "1 <= least <= most"),
        ({"least": 10, "most": 9}, "1 <= least <= most"),
        ({"epsilon": 0.0}, "epsilon > 0"),
        ({"widths": (1.0, 1.0)}, "positive width of bin for each column"),
        ({"widths": (1.0, 0.0, 1.0)}, "positive width of bin for each column"),
        ({"widths": (1e-12, 1e-12, 1e-12)}, "too small"),
    ]:
        with pytest.raises(ValueError, match=message):
            adaptive.kld_resample(particles, rng, **({"widths": WIDTHS} | arguments))
    with pytest.raises(ValueError, match="one of them positive"):
        adaptive.kld_resample(Particles(particles.states, np.full(300, -np.inf)), rng, WIDTHS)
    with pytest.raises(ValueError, match="must be finite"):
        adaptive.kld_resample(equally_weighted([[0.0, np.nan, 0.0]]), rng, WIDTHS)


# Bins


@given(st.integers(0, 10**6), st.integers(1, 80), st.floats(1e-3, 1e3), st.sampled_from([(), (2,), (0, 1, 2)]))
def test_two_particles_share_a_key_where_they_share_a_bin(seed, n, spread, angles):
    states = cloud(np.random.default_rng(seed), n, spread).states
    keys, counts = bins.number(*bins.columns(states, WIDTHS, angles))
    tuples = [bin_of(state, WIDTHS, angles) for state in states]
    assert len(set(keys)) == len(set(tuples)) == len(set(zip(keys, tuples, strict=True)))
    assert keys.min() >= 0 and keys.max() < np.prod(counts, dtype=float)
