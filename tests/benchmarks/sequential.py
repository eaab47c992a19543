"""Whether the interval of the points holds what it says when episodes end early, and how many episodes that saves.

Classes are synthetic, so that the truth is known: in each variant a share is 0, 1 or drawn from a beta distribution,
with chances like those of real submissions, or of what is hardest to bound: a rare 0 among 1s, a rare 1 among 0s.
"""

import time

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import beta, norm

from grader.assignments import assignments
from grader.grading.grade import WIDTH, most_episodes
from grader.grading.sequential import CONFIDENCE, bounds, schedule

#: Sequences that are bounded together: as many as fit a cache.
CHUNK = 500
#: Without a cap: classes, rounds that are drawn, and episodes from one look to the next.
FEW, MANY_ROUNDS, EVERY = 100, 16, 8


def _good(rng, strata):
    """Full marks nearly always, else most of them."""
    zero, one = np.zeros(strata), 1.0 - rng.choice([0.0, 0.02, 0.1], strata, p=[0.6, 0.2, 0.2])
    return zero, one, np.full(strata, 4.0), np.full(strata, 2.0)


def _faulty(rng, strata):
    """Right in some variants, wrong in some, and in between in the rest."""
    zero, one = np.moveaxis(rng.dirichlet([0.3, 0.3, 0.3], strata), -1, 0)[:2]
    return zero, one, rng.uniform(0.5, 4.0, strata), rng.uniform(0.5, 4.0, strata)


def _spread(rng, strata):
    """Shares of 0.3 to 0.9 everywhere."""
    return np.zeros(strata), np.zeros(strata), np.full(strata, 5.0), rng.uniform(2.0, 5.0, strata)


def _rare_zeros(rng, strata):
    """All or nothing, and nearly always all."""
    zero = np.full(strata, np.exp(rng.uniform(np.log(0.003), np.log(0.1))))
    return zero, 1.0 - zero, np.ones(strata), np.ones(strata)


def _rare_ones(rng, strata):
    """All or nothing, and nearly always nothing."""
    zero, one, *rest = _rare_zeros(rng, strata)
    return one, zero, *rest


KINDS = {
    "good": _good,
    "faulty": _faulty,
    "shares of 0.3 to 0.9": _spread,
    "1, rarely 0": _rare_zeros,
    "0, rarely 1": _rare_ones,
}


def draw(kind, order, weights, count, rng):
    """Submissions of a kind.

    Returns
    -------
    shares : ndarray, shape (count, len(order))
    truth : ndarray, shape (count,)
        The stratified means from which they are drawn.
    """
    shares, truth = np.empty((count, len(order))), np.empty(count)
    for i in range(count):
        zero, one, a, b = kind(rng, len(weights))
        truth[i] = weights @ (one + (1.0 - zero - one) * a / (a + b))
        lot = rng.random(len(order))
        between = rng.beta(a[order], b[order])
        shares[i] = np.where(lot < zero[order], 0.0, np.where(lot < (zero + one)[order], 1.0, between))
    return shares, truth


def stratified(shares, order, weights, width):
    """The interval that `bounds` gives for the stratified mean: (low, high)."""
    return np.concatenate(
        [bounds(shares[i : i + CHUNK], order, weights, width) for i in range(0, len(shares), CHUNK)], axis=-1
    )


def naive(shares, order, weights, width):
    """The normal 95 % interval of the stratified mean, as if it were looked at once."""
    member = (order[: shares.shape[1], None] == np.arange(len(weights))).astype(float)
    count = member.sum(axis=0)
    mean = shares @ member / count
    # Not within strata: after one episode of each, that would always be zero.
    deviation = shares.std(axis=1, ddof=1)
    half = norm.ppf(0.5 + CONFIDENCE / 2.0) * deviation * np.sqrt((weights**2 / count).sum())
    return np.array([mean @ weights - half, mean @ weights + half])


def per_stratum(shares, order, weights, width):
    """Bounds of every stratum by itself, that hold together by Bonferroni's inequality."""
    seen = order[: shares.shape[1]]
    confidence = 1.0 - (1.0 - CONFIDENCE) / len(weights)
    parts = [
        bounds(shares[:, seen == stratum], np.zeros(np.sum(order == stratum), int), np.ones(1), width, confidence)
        for stratum in range(len(weights))
    ]
    return np.einsum("v,vij->ij", weights, np.array(parts))


def per_round(shares, order, weights, width, length):
    """Whole rounds, each one share."""
    rounds, planned = shares.shape[1] // length, len(order) // length
    member = (order[:length, None] == np.arange(len(weights))) * 1.0
    means = shares[:, : rounds * length].reshape(len(shares), rounds, length) @ (member / member.sum(axis=0)) @ weights
    return np.array(bounds(means, np.zeros(planned, int), np.ones(1), width))


def stop(shares, order, weights, rule, width, looks):
    """Look after these numbers of episodes and stop when the interval is narrow, or at the last.

    Returns
    -------
    interval : ndarray, shape (2, n)
    episodes : ndarray, shape (n,)
    narrow : ndarray of bool, shape (n,)
    """
    interval = np.tile([[0.0], [1.0]], len(shares))
    episodes, running = np.full(len(shares), looks[-1]), np.arange(len(shares))
    for look in looks:
        low, high = rule(shares[running, :look], order, weights, width)
        if rule is not naive:
            low, high = np.maximum(low, interval[0, running]), np.minimum(high, interval[1, running])
        interval[:, running] = low, high
        done = high - low < width
        episodes[running[done]] = look
        running = running[~done]
        if not len(running):
            break
    return interval, episodes, np.diff(interval, axis=0)[0] < width


def sequential(console: Console, runs):
    """Coverage when stopping early, what other rules do, and the episodes saved; each class has one of each kind."""
    start = time.perf_counter()
    assignment = assignments()["vacuum"]
    counts = [variant.episodes for variant in assignment.variants]
    points = np.array([variant.points for variant in assignment.variants], float)
    weights, width, cap = points / points.sum(), WIDTH / points.sum(), most_episodes(assignment)
    order, rng = schedule(counts, cap), np.random.default_rng(0)
    looks = range(len(counts), cap + 1)
    coverage = Table(
        "submissions", "covered", "its interval", "episodes", "width", "naive: covered", "its interval", "episodes",
        title=f"{runs} classes; stop when 95 % intervals are narrower than {WIDTH:g} points, or after {cap} episodes",
    )  # fmt: skip
    others = Table(
        "submissions", "this one", "bounds per variant", "bounds of rounds", "normal, looked at once",
        title=f"Mean widths in points after {cap} episodes",
    )  # fmt: skip
    totals = np.zeros((2, 3))
    for name, kind in track(KINDS.items(), "classes", console=console):
        shares, truth = draw(kind, order, weights, runs, rng)
        row = [name]
        for i, rule in enumerate((stratified, naive)):
            interval, episodes, _ = stop(shares, order, weights, rule, width, looks)
            # In floating point a mean of ones may miss 1 by its last digit.
            covered = (interval[0] <= truth + 1e-12) & (truth <= interval[1] + 1e-12)
            totals[i] += covered.sum(), runs, episodes.sum()
            row += [*_chance(covered.sum(), runs), f"{episodes.mean():.1f}"]
            if rule is stratified:
                row.append(f"{points.sum() * np.diff(interval, axis=0).mean():.1f}")
        coverage.add_row(*row)
        some = shares[: max(runs // 10, 2)]
        widths = [
            points.sum() * np.diff(rule(some, order, weights, width), axis=0).clip(0.0, 1.0).mean()
            for rule in (stratified, per_stratum, lambda *a: per_round(*a, sum(counts)), naive)
        ]
        others.add_row(name, *(f"{value:.1f}" for value in widths))
    coverage.add_section()
    coverage.add_row(
        "all",
        *_chance(*totals[0, :2]),
        f"{totals[0, 2] / totals[0, 1]:.1f}",
        "",
        *_chance(*totals[1, :2]),
        f"{totals[1, 2] / totals[1, 1]:.1f}",
    )
    console.print(coverage)
    console.print(others)
    _savings(console, counts, weights, width, rng)
    console.print(f"Took {time.perf_counter() - start:.0f} s.\n")


def _savings(console, counts, weights, width, rng):
    """Episodes until all of a class have the width: when each stops by itself, and when all are given as many."""
    order = schedule(counts, MANY_ROUNDS * sum(counts))
    looks = range(EVERY * -(-len(counts) // EVERY), len(order) + 1, EVERY)
    table = Table(
        "submissions", "episodes until narrow", "a fixed number for 95 of 100", "for all", "saved beside that",
        title=f"Episodes until the interval is narrower than {WIDTH:g} points, without a cap, in {FEW} classes",
    )  # fmt: skip
    every = []
    for name, kind in track(KINDS.items(), "without a cap", console=console):
        shares, _ = draw(kind, order, weights, FEW, rng)
        _, episodes, narrow = stop(shares, order, weights, stratified, width, looks)
        every.append(episodes)
        table.add_row(name, *_spent(episodes, narrow.all()))
    table.add_section()
    table.add_row("all", *_spent(np.concatenate(every), True))
    console.print(table)


def _spent(episodes, narrow):
    most = episodes.max()
    return (
        f"{episodes.mean():.0f}",
        f"{np.quantile(episodes, 0.95):.0f}",
        f"{most}" if narrow else f"more than {most}",
        f"{1.0 - episodes.mean() / most:.0%}",
    )


def _chance(hits, count):
    """A relative frequency in per cent and Clopper and Pearson's 95 % interval of the chance."""
    low = beta.ppf(0.025, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, count - hits) if hits < count else 1.0
    return f"{hits / count:.2%}", f"{low:.2%} to {high:.2%}"
