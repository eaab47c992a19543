"""The interval of the points: what it is in cases known by heart, and that it covers the truth when one stops early."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import norm

from grader.grading.sequential import LARGEST_OFFSET, LEAST_OFFSET, bounds, offsets, schedule, soonest

WIDTH, GAIN = 0.15, np.log(2.0 / 0.05)


@st.composite
def sequences(draw):
    """Shares, schedule and weights of a few strata."""
    counts = draw(st.lists(st.integers(1, 4), min_size=1, max_size=5))
    order = schedule(counts, draw(st.integers(len(counts), 40)))
    share = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
    shares = draw(st.lists(share, min_size=1, max_size=len(order)))
    weights = np.array(draw(st.lists(st.floats(0.01, 1.0), min_size=len(counts), max_size=len(counts))))
    return np.array(shares), order, weights / weights.sum()


def stratified_mean(shares, order, weights):
    means = [shares[order[: len(shares)] == v].mean() for v in range(len(weights))]
    return weights @ means


# The schedule.


def test_a_schedule_is_interleaved():
    assert schedule([3, 2, 1], 12).tolist() == [0, 1, 2, 0, 1, 0] * 2


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(1, 7), min_size=1, max_size=8), st.integers(1, 60))
def test_every_prefix_of_a_schedule_is_nearly_proportional(counts, length):
    order = schedule(counts, length)
    assert len(order) == length
    assert sorted(order[: len(counts)]) == list(range(len(counts)))[:length]
    for end in range(0, length + 1, sum(counts)):
        assert np.bincount(order[:end], minlength=len(counts)).tolist() == [end // sum(counts) * n for n in counts]
    for end in range(1, length + 1):
        progress = np.bincount(order[:end], minlength=len(counts)) / counts
        # Nobody is ahead of another by more than its own next visit and the last round of it.
        assert (progress - 1.0 / np.array(counts) <= progress.min() + 1e-9).all()


# Analytic cases.


def test_before_any_episode_anything_is_possible():
    low, high = bounds(np.zeros(0), schedule([1, 2], 30), [0.5, 0.5], WIDTH)
    assert (low, high) == (0.0, 1.0)


def test_a_stratum_that_was_not_seen_may_be_worth_anything():
    order = schedule([1, 1, 1], 300)
    shares = np.ones(2)
    low, high = bounds(shares, order, [0.25, 0.25, 0.5], WIDTH)
    assert low <= 0.5 and high == 1.0
    # Nor do all the episodes of the others tell of it.
    order = np.array([0] * 500 + [1])
    low, high = bounds(np.ones(500), order, [0.4, 0.6], WIDTH)
    assert 0.35 <= low <= 0.4 and high == 1.0


@pytest.mark.parametrize("episodes", [1, 5, 40])
def test_one_stratum_by_hand(episodes):
    # log of the product of (1 + a) / (m + a) is the gain.
    shares, order = np.ones(episodes), np.zeros(40, int)
    a = offsets(shares, order, np.ones(1), WIDTH, GAIN)
    low, high = bounds(shares, order, [1.0], WIDTH)
    assert high == 1.0
    if low > 0.0:
        assert np.log((1.0 + a) / (low + a)).sum() == pytest.approx(GAIN, abs=1e-6)
    else:
        assert np.log((1.0 + a) / a).sum() <= GAIN


def test_equal_strata_share_the_evidence():
    # Full marks in 20 strata, two episodes each: nearly what 40 episodes of one stratum say, whose stakes are alike.
    order = schedule([1] * 20, 40)
    low, high = bounds(np.ones(40), order, np.full(20, 0.05), WIDTH)
    [one, _] = bounds(np.ones(40), np.zeros(40, int), [1.0], WIDTH)
    assert high == 1.0 and one - 0.02 < low <= one + 1e-9
    # Not far from the most that 40 episodes can say: 1 - (α / 2)^(1 / 40).
    assert 0.85 < low < 0.025 ** (1 / 40)


@settings(max_examples=40, deadline=None)
@given(sequences())
def test_upper_and_lower_bound_are_mirror_images(sequence):
    shares, order, weights = sequence
    low, high = bounds(shares, order, weights, WIDTH)
    mirrored_low, mirrored_high = bounds(1.0 - shares, order, weights, WIDTH)
    assert low == pytest.approx(1.0 - mirrored_high, abs=1e-9)
    assert high == pytest.approx(1.0 - mirrored_low, abs=1e-9)


# The optimiser.


@pytest.mark.parametrize("seed", range(12))
def test_the_bound_is_what_a_general_optimiser_finds(seed):
    rng = np.random.default_rng(seed)
    counts = rng.integers(1, 5, rng.integers(2, 12))
    order, weights = schedule(counts, 60), rng.dirichlet(rng.choice([0.3, 3.0], len(counts)))
    means = rng.choice([0.0, 0.3, 0.8, 1.0], len(counts))
    seen = order[: rng.integers(len(counts), 61)]
    shares = np.where(rng.random(len(seen)) < means[seen], rng.choice([1.0, 0.9, 0.4], len(seen)), 0.0)
    a = offsets(shares, order, weights, WIDTH, GAIN)
    found = minimize(
        lambda m: weights @ m,
        np.full(len(counts), 0.999),
        jac=lambda m: weights,
        bounds=[(0.0, 1.0)] * len(counts),
        constraints={"type": "ineq", "fun": lambda m: GAIN - np.log((shares + a) / (m[seen] + a)).sum()},
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-12},
    )
    assert found.success
    assert bounds(shares, order, weights, WIDTH)[0] == pytest.approx(found.fun, abs=1e-6)


# Invariants.


@settings(max_examples=40, deadline=None)
@given(sequences())
def test_bounds_are_in_order_and_contain_the_mean(sequence):
    shares, order, weights = sequence
    low, high = bounds(shares, order, weights, WIDTH)
    assert 0.0 <= low <= high <= 1.0
    if len(np.unique(order[: len(shares)])) == len(weights):
        assert low - 1e-9 <= stratified_mean(shares, order, weights) <= high + 1e-9


@settings(max_examples=40, deadline=None)
@given(sequences(), st.randoms())
def test_the_names_of_strata_do_not_matter(sequence, random):
    shares, order, weights = sequence
    names = list(range(len(weights)))
    random.shuffle(names)
    renamed = np.empty(len(names))
    renamed[names] = weights
    one = np.array(bounds(shares, order, weights, WIDTH))
    other = np.array(bounds(shares, np.array(names)[order], renamed, WIDTH))
    assert one == pytest.approx(other, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(sequences(), st.floats(0.0, 1.0))
def test_a_stratum_that_is_worth_nothing_refutes_nothing(sequence, share):
    shares, order, weights = sequence
    one = np.array(bounds(shares, order, weights, WIDTH))
    weights = np.append(weights, 0.0)
    assert np.array(bounds(shares, order, weights, WIDTH)) == pytest.approx(one, abs=1e-9)
    # Seen or not.
    low, high = bounds(np.append(shares, [share] * 30), np.append(order, [len(weights) - 1] * 30), weights, WIDTH)
    assert 0.0 <= low <= high <= 1.0
    only = np.full(30, len(weights) - 1)
    assert bounds(np.full(30, share), only, weights, WIDTH) == (0.0, 1.0)


@settings(max_examples=40, deadline=None)
@given(sequences())
def test_what_is_staked_knows_the_past_alone(sequence):
    shares, order, weights = sequence
    whole = offsets(shares, order, weights, WIDTH, GAIN)
    assert ((whole >= LEAST_OFFSET) & (whole <= LARGEST_OFFSET)).all()
    for t in range(len(shares)):
        other = np.append(shares[:t], 1.0 - shares[t:])
        assert offsets(other, order, weights, WIDTH, GAIN)[: t + 1] == pytest.approx(whole[: t + 1], abs=1e-12)


def test_many_sequences_at_once_are_those_one_by_one():
    order, rng = schedule([2, 1, 3], 30), np.random.default_rng(0)
    shares, weights = rng.random((4, 5, 20)).round(1), np.array([0.2, 0.5, 0.3])
    low, high = bounds(shares, order, weights, WIDTH)
    assert low.shape == high.shape == (4, 5)
    for i, j in np.ndindex(4, 5):
        alone = np.array(bounds(shares[i, j], order, weights, WIDTH))
        assert alone == pytest.approx(np.array([low[i, j], high[i, j]]), abs=1e-9)


# Validity.


@pytest.mark.parametrize("chances", [(0.5, 0.5), (0.95, 0.05), (0.02, 0.6)])
def test_the_capital_is_a_martingale_and_the_truth_is_refuted_rarely(chances):
    """All 2^11 outcomes of two strata with shares 0 or 1: no simulation, no false alarm."""
    order, weights, chances = schedule([1, 2], 11), np.array([0.5, 0.5]), np.array(chances)
    shares = np.array(list(itertools.product([0.0, 1.0], repeat=11)))
    probability = np.where(shares == 1.0, chances[order], 1.0 - chances[order]).prod(axis=1)
    a = offsets(shares, order, weights, WIDTH, GAIN)
    capital = np.cumprod((shares + a) / (chances[order] + a), axis=1)
    for t in range(11):
        assert probability @ capital[:, t] == pytest.approx(1.0, abs=1e-12)
        # Given what came before, too.
        before = capital[:, t - 1] if t else np.ones(len(shares))
        for past in set(map(tuple, shares[:, :t])) if t < 5 else ():
            same = (shares[:, :t] == past).all(axis=1)
            given_past = probability[same] / probability[same].sum()
            assert given_past @ capital[same, t] == pytest.approx(before[same][0], rel=1e-9)
    covered = np.ones(len(shares), bool)
    for t in range(1, 12):
        low, high = bounds(shares[:, :t], order, weights, WIDTH)
        covered &= (low <= weights @ chances + 1e-12) & (weights @ chances <= high + 1e-12)
    assert probability @ covered >= 0.95


# Coverage when stopping early. Seeds are fixed, so that these cannot fail by chance.

COUNTS = [4, 1, 1, 2]
ORDER, WEIGHTS = schedule(COUNTS, 40), np.array(COUNTS) / sum(COUNTS)
#: Chances of a 1 per stratum, else 0.
WORST = [(0.97, 0.97, 0.97, 0.97), (0.03, 0.03, 0.03, 0.03), (1.0, 0.9, 0.0, 1.0), (0.5, 0.7, 0.2, 0.9)]


def ours(shares):
    return bounds(shares, ORDER, WEIGHTS, 0.3)


def naive(shares):
    half = norm.ppf(0.975) * shares.std(axis=1, ddof=1) / np.sqrt(shares.shape[1])
    return shares.mean(axis=1) - half, shares.mean(axis=1) + half


def coverage(rule, chances, classes=1000):
    """How often the truth is in the interval at which one stops: at a width of 0.3, or at the end."""
    rng = np.random.default_rng(1)
    shares, truth = (rng.random((classes, len(ORDER))) < np.array(chances)[ORDER]) * 1.0, WEIGHTS @ chances
    interval, running = np.tile([[0.0], [1.0]], classes), np.arange(classes)
    for t in range(8, len(ORDER) + 1, 4):
        interval[:, running] = rule(shares[running, :t])
        running = running[np.diff(interval[:, running], axis=0)[0] >= 0.3]
    return np.mean((interval[0] <= truth + 1e-12) & (truth <= interval[1] + 1e-12))


@pytest.mark.parametrize("chances", WORST)
def test_the_truth_is_covered_when_one_stops_early(chances):
    assert coverage(ours, chances) >= 0.95


def test_stopping_at_a_narrow_normal_interval_does_not_cover():
    # Known to be wrong: all that were perfect so far have no variance, and end with an interval of no width.
    assert coverage(naive, WORST[0]) < 0.5
    assert coverage(naive, WORST[1]) < 0.5


def test_narrower_with_more_episodes():
    shares = (np.random.default_rng(2).random((200, 40)) < 0.8) * 1.0
    widths = [np.diff(ours(shares[:, :t]), axis=0).mean() for t in (8, 16, 24, 40)]
    assert widths == sorted(widths, reverse=True) and widths[-1] < 0.45


@pytest.mark.parametrize("width", [0.1, 0.15, 0.3])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_no_interval_is_narrow_sooner_than_it_is_looked_for(width, share):
    least = int(soonest(width))
    for strata in (1, 5):
        order = schedule([1] * strata, 2 * least)
        low, high = bounds(np.full(least, share), order, np.full(strata, 1 / strata), width)
        assert high - low >= width
    assert soonest(1.0) == 0.0
