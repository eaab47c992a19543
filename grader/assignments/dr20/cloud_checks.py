"""What the checks of resampling, running averages and the size of a cloud try, and the faults they know by name.

The first is statistical: it draws from fixed seeds and fails a right function with a probability of at most 1e-8.
"""

import numpy as np
from scipy.special import ndtr

from grader.lessons import expect


def resample(function):
    """Offspring: bounded in each draw, right on average, at the edges of the unit interval, of any logarithms."""
    rng = np.random.default_rng(9)
    draws = 1000
    for weights in (np.array([0.5, 0.3, 0.2]), np.array([0.0, 0.25, 0.75, 0.0]), rng.dirichlet(np.full(12, 0.4))):
        n = len(weights)
        with np.errstate(divide="ignore"):
            log_weights = np.log(weights) - 3.0
        call = f"resample(log of {np.round(weights, 3).tolist()}, minus 3, rng)"
        counts = np.empty((draws, n))
        for d in range(draws):
            counts[d] = np.bincount(_indices(function, log_weights, rng, call), minlength=n)
        share, average = n * weights, counts.mean(axis=0)
        table = f"{call}\nmean offspring: expected {np.round(share, 3).tolist()}, got {np.round(average, 3).tolist()}"
        assert not average[weights == 0].any(), f"A particle of weight zero (-inf) has offspring.\n{table}"
        # A count lies between ⌊share⌋ and ⌈share⌉, so its variance is at most 1/4; of a mean, 7 standard deviations.
        biased = np.abs(average - share) > 7 * np.sqrt(np.maximum(counts.var(axis=0), 0.25) / draws)
        if biased.any():
            if np.allclose(average, 1.0):
                reason = "The weights are not used: every particle has one offspring."
            elif not np.ptp(counts, axis=0).any():
                reason = "The same offspring in every draw: draw a number from rng."
            else:
                reason = "Offspring are biased; on average, i has N wᵢ."
            raise AssertionError(f"{reason}\n{table}")
        wild = (counts < np.floor(share - 1e-9)) | (counts > np.ceil(share + 1e-9))
        if wild.any():
            d, i = np.argwhere(wild)[0]
            raise AssertionError(
                "Right on average, but more random than it need be: draw one number u for all positions (u + n) / N, "
                f"not one for each.\n{call}: expected {np.floor(share[i]):.0f} or {np.ceil(share[i]):.0f} offspring of "
                f"index {i}, got {counts[d, i]:.0f}"
            )
    many = 2.0 * rng.standard_normal(200)
    expect.repeats(lambda rng: function(many, rng), "resample")
    _far_from_zero(function)
    _to_the_end(function)


def _indices(function, log_weights, rng, call):
    n = len(log_weights)
    with np.errstate(all="ignore"):
        result = function(log_weights, rng)
    indices = expect.array(result, (n,), call, kind="i")
    outside = (indices < 0) | (indices >= n)
    assert not outside.any(), f"{call}: index {indices[outside][0]} is outside 0 ... {n - 1}"
    return indices


def _far_from_zero(function):
    """Logarithms whose exponentials underflow: only their differences count."""
    log_weights = np.log([0.1, 0.2, 0.3, 0.4]) - 2000.0
    call = "resample(log of [0.1, 0.2, 0.3, 0.4], minus 2000, rng)"
    try:
        counts = sum(
            np.bincount(_indices(function, log_weights, np.random.default_rng(seed), call), minlength=4)
            for seed in range(100)
        )
        # 100 counts of variance 1/4 at most: 7 standard deviations.
        assert (np.abs(counts - 400 * np.array([0.1, 0.2, 0.3, 0.4])) < 35).all(), (
            f"{call}: {counts.tolist()} offspring"
        )
    except AssertionError as error:
        raise AssertionError(
            f"np.exp(-2000) is 0: subtract the largest log-weight first, for only differences count.\n{error}"
        ) from None


def _to_the_end(function):
    """The last position, where rounding has left the sum of the weights below it in every other of the cases."""
    n = 5000
    for seed in range(8):
        log_weights = np.log(np.random.default_rng(seed).random(n))
        with np.errstate(all="ignore"):
            result = function(log_weights, LargeDraw(np.random.PCG64(10)))
        indices = expect.array(result, (n,), "resample", kind="i")
        assert indices.max() < n, (
            f"Rounding leaves the last cumulative weight a little below 1: divide by it.\nresample({n} log-weights, "
            f"rng) when rng.random() is 1 - 1e-12: index {n}, one too many"
        )


class LargeDraw(np.random.Generator):
    """Draws uniform numbers close to 1."""

    def random(self, size=None, **_):
        return (1 - 1e-12) * (np.ones(size) if size is not None else 1.0)

    def uniform(self, low=0.0, high=1.0, size=None):
        return low + (high - low) * self.random(size)


def averages(function):
    """The first call, a fall, a rise, and that one call does not depend on another."""
    _started(function)
    for slow, fast, w_avg in [(4.0, 3.0, 0.5), (4.0, 5.0, 9.0), (2.0, 1.0, 6.0), (1e-9, 1e-12, 1e-10)]:
        for alpha_slow, alpha_fast in [(0.05, 0.5), (0.001, 0.1)]:
            call = f"averages({w_avg:g}, {slow:g}, {fast:g}, {alpha_slow:g}, {alpha_fast:g})"
            got = _three(function(w_avg, slow, fast, alpha_slow, alpha_fast), call)
            new = (slow + alpha_slow * (w_avg - slow), fast + alpha_fast * (w_avg - fast))
            expected = np.array([*new, max(0.0, 1.0 - new[1] / new[0])])
            if np.allclose(got, expected, rtol=1e-9, atol=0.0) and got[2] >= 0.0:
                continue
            swapped = slow + alpha_fast * (w_avg - slow), fast + alpha_slow * (w_avg - fast)
            kept = alpha_slow * slow + (1 - alpha_slow) * w_avg, alpha_fast * fast + (1 - alpha_fast) * w_avg
            grown = slow + alpha_slow * w_avg, fast + alpha_fast * w_avg
            ratio = 1.0 - new[1] / new[0]
            wrong = [
                (swapped, "α is swapped: the slow average goes with alpha_slow, the small one. As in the source, "
                 "nothing is injected when the robot is carried off, and much when it is found."),
                (kept, "w ← w + α (w_avg - w) keeps 1 - α of the old average, not α."),
                (grown, "w ← w + α (w_avg - w): the old average has to shrink by α."),
                ((w_avg, w_avg), "The averages forget at once: blend each with what it was."),
                ((slow, fast), "The averages do not change: w ← w + α (w_avg - w)."),
            ]  # fmt: skip
            reasons = [name for pair, name in wrong if np.allclose(got[:2], pair, rtol=1e-9, atol=0.0)]
            if np.allclose(got[:2], new[::-1], rtol=1e-9, atol=0.0):
                reasons = ["The order: w_slow, w_fast, share."]
            elif expected[2] > 0.0 and (not got[:2].all() or np.ptp(got[:2]) == 0.0) and not reasons:
                reasons = ["The averages are reset after an injection: then nobody knows what a good likelihood is."]
            elif np.allclose(got[:2], new, rtol=1e-9, atol=0.0):
                reasons = [_share_fault(got[2], ratio, (slow, fast), new)]
            raise AssertionError(
                "\n".join([*filter(None, reasons[:1]), f"{call}\nexpected {_numbers(expected)}, got {_numbers(got)}"])
            )
    first = _three(function(3.0, 2.0, 1.0, 0.1, 0.5), "averages(3, 2, 1, 0.1, 0.5)")
    again = _three(function(3.0, 2.0, 1.0, 0.1, 0.5), "averages(3, 2, 1, 0.1, 0.5), again")
    assert np.array_equal(first, again), "averages gives something else when called again: what it needs it is given"


def _started(function):
    call = "averages(0.8, None, None, 0.05, 0.5), the first call"
    got = _three(function(0.8, None, None, 0.05, 0.5), call)
    if np.allclose(got, [0.8, 0.8, 0.0], rtol=1e-9, atol=1e-12):
        return
    reasons = []
    if np.allclose(got[:2], [0.05 * 0.8, 0.5 * 0.8]) or np.allclose(got[:2], [0.5 * 0.8, 0.05 * 0.8]):
        reasons = [
            "The averages start from zero, and then say more about α than about the readings: start both at w_avg."
        ]
    elif np.allclose(got[:2], 0.0):
        reasons = ["The averages start at zero: start both at the first w_avg."]
    raise AssertionError("\n".join([*reasons, f"{call}\nexpected {_numbers([0.8, 0.8, 0.0])}, got {_numbers(got)}"]))


def _share_fault(share, ratio, old, new):
    for wrong, name in [
        (ratio, "The share is negative while the readings fit better than they used to: max(0, ...)."),
        (max(0.0, 1.0 - new[0] / new[1]), "The ratio is upside down: 1 - w_fast / w_slow."),
        (1.0 - new[0] / new[1], "The ratio is upside down: 1 - w_fast / w_slow."),
        (abs(ratio), "The share is 0 where w_fast is above w_slow: max(0, ...), not the absolute value."),
        (max(0.0, 1.0 - old[1] / old[0]), "The share is that of the old averages: take the new ones."),
        (new[1] / new[0], "The share is 1 - w_fast / w_slow."),
        (min(1.0, new[1] / new[0]), "The share is 1 - w_fast / w_slow."),
        (max(0.0, new[0] - new[1]), "The share is a ratio, 1 - w_fast / w_slow, not a difference."),
    ]:
        if np.isclose(share, wrong, rtol=1e-9, atol=1e-15):
            return name
    return ""


def _three(value, call):
    assert isinstance(value, tuple | list | np.ndarray) and len(value) == 3, (
        f"{call}: expected w_slow, w_fast, share, got {type(value).__name__}"
    )
    return np.array([float(expect.array(part, (), f"{call}: {name}")) for part, name in
                     zip(value, ("w_slow", "w_fast", "share"), strict=True)])  # fmt: skip


def _numbers(values):
    return "w_slow {:.4g}, w_fast {:.4g}, share {:.4g}".format(*values)


def kld(function):
    """Fox's bound, rounded up, in an order that shows what is remembered."""
    got = _count(function(1, 0.05, 2.326), "kld_size(1, 0.05, 2.326)")
    assert 0 <= got <= 1, f"kld_size(1, 0.05, 2.326): one bin needs one particle, got {got:g}"
    cases = [(k, epsilon, z) for epsilon, z in [(0.05, 2.326), (0.02, 1.645), (0.05, 1.645)] for k in (500, 2, 3, 40)]
    seen = {}
    for k, epsilon, z in [*cases, *cases[:2]]:
        call = f"kld_size({k}, {epsilon:g}, {z:g})"
        got = _count(function(k, epsilon, z), call)
        expected = np.ceil(_fox(k - 1, epsilon, z))
        if got != expected:
            raise AssertionError(
                "\n".join(
                    filter(
                        None, [_kld_fault(got, k, epsilon, z, seen), f"{call}: expected {expected:.0f}, got {got:g}"]
                    )
                )
            )
        seen[k, epsilon, z] = got


def _fox(f, epsilon, z, power=3, root=np.sqrt, scale=2.0):
    with np.errstate(all="ignore"):
        part = np.float64(2.0) / (9.0 * f)
        return f / (scale * epsilon) * (1.0 - part + root(part) * z) ** power


def _kld_fault(got, k, epsilon, z, seen):
    f = k - 1
    for other in [(k, epsilon), (k,), (epsilon, z)]:
        earlier = [value for key, value in seen.items() if set(other) <= set(key) and key != (k, epsilon, z)]
        if got in earlier and got != np.ceil(_fox(k, epsilon, z)):
            return "The result of an earlier call: k, ε and z may all be others now, so compute it anew."
    for wrong, name in [
        (_fox(f, epsilon, z), "Round up: the bound is how many are needed at least."),
        (_fox(k, epsilon, z), "The degrees of freedom are k - 1, not k."),
        (_fox(f, epsilon, -z), "The sign of z: to be surer takes more particles."),
        (_fox(f, epsilon, ndtr(z)), "z is the quantile itself, not a probability."),
        (_fox(f, epsilon, ndtr(-z)), "z is the quantile itself, not a probability."),
        (_fox(f, epsilon, z, power=2), "The bracket is cubed: Wilson and Hilferty's approximation."),
        (_fox(f, epsilon, z, power=1), "The bracket is cubed: Wilson and Hilferty's approximation."),
        (_fox(f, epsilon, z, root=lambda part: part), "The factor of z is the root of 2 / (9 (k - 1))."),
        (_fox(f, epsilon, z, scale=1.0), "The factor in front is (k - 1) / (2 ε)."),
        (_fox(f, epsilon, 0.0), "z is not used."),
        (f / (2 * epsilon), "The bracket is missing: (1 - 2/(9(k-1)) + √(2/(9(k-1))) z)³."),
    ]:
        if np.isfinite(wrong) and got in (np.floor(wrong), np.ceil(wrong), np.round(wrong)):
            return name
    return ""


def _count(value, call):
    number = expect.array(value, (), call, kind="l")
    assert np.isfinite(number), f"{call}: got {number}; with one bin nothing is divided: 1"
    assert isinstance(value, int | np.integer) and not isinstance(value, bool), (
        f"{call}: expected an int, got {type(value).__name__} {float(number):g}"
    )
    return int(value)
