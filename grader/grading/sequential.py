"""How sure the points are: a confidence sequence for a stratified mean, at which one may look after every episode.

A submission's points are Σ w_v μ_v: each variant v of the world is a stratum that is worth the share w_v of the points,
and μ_v is the mean, over all episodes that could be drawn, of the share in [0, 1] that one of them earns. Episodes come
one at a time, in an order of variants that is fixed beforehand.

Suppose that the means are m = (m_v), and bet against it: start with a capital of 1, and after episode i, of variant v
and share x_i, multiply it by

    (x_i + a_i) / (m_v + a_i),        a_i > 0 chosen from earlier episodes alone.

This is Waudby-Smith and Ramdas's bet 1 + λ (x_i - m_v) with the stake λ = 1 / (m_v + a_i). If m is the truth, each
factor is nonnegative and 1 on average, whatever came before: the capital is a martingale, though the strata take turns,
and by Ville's inequality it ever reaches 2/α with probability α/2 at most. So the m that have not made us so rich,

    Σ_i log((x_i + a_i) / (m_v(i) + a_i)) <= log(2/α),

contain the truth after every episode at once, with probability 1 - α/2: looking often and stopping when one likes costs
nothing. The least Σ w_v m_v among them is a lower bound of the points; the same of 1 - x_i gives an upper one. Each
logarithm is convex in m_v, and they are added, so the bound is a convex programme with one multiplier.

Why such stakes. With stakes c / m_v, which make the sum convex too, a stratum that earns nothing costs log(1 - c) each
time, and c has to be learned in each stratum, of which there are many and of episodes few. Here it costs nothing, for
its m_v can be 0. Bounds of each stratum put together, or of rounds in which each has its turn, are much wider:
`python -m tests.benchmarks sequential` measures it.

References
----------
I. Waudby-Smith and A. Ramdas, "Estimating means of bounded random variables by betting", Journal of the Royal
Statistical Society B 86 (2024), 1-27.
J. V. Spertus, M. Sridhar and P. B. Stark, "Sequential stratified inference for the mean" (2024).
"""

import numpy as np

#: That the interval contains the points, after all episodes at once.
CONFIDENCE = 0.95

#: Before anything is seen: a share's mean and its variance within a stratum, and how many episodes these weigh.
PRIOR_MEAN, PRIOR_VARIANCE = (0.5, 4.0), (0.2, 16.0)
#: Episodes that the mean over all strata weighs in the guess at one's own.
POOLED = 0.25
#: Of the offsets a. The least decides what one zero costs a submission that was perfect until then: log(11).
LEAST_OFFSET, LARGEST_OFFSET = 0.1, 3.0
#: Stakes are chosen for this share of the episodes that the width seems to take: the variance is often guessed too
#: large at first. Simulated faulty submissions need 143 episodes with 0.5, 147 with 1 and 269 with 0.25; good ones
#: need 50, 57 and 39.
HURRY = 0.5

_ITERATIONS = 60


def schedule(counts, length):
    """Strata in the order in which they are visited: rounds of `counts` each, and within them evenly interleaved.

    Parameters
    ----------
    counts : sequence of int
        How often each stratum occurs in a round.
    length : int

    Returns
    -------
    ndarray of int, shape (length,)
        The first `len(counts)` visit each stratum once; before each visit a stratum has had its due or more, and less
        than one visit more.
    """
    rounds = -(-length // sum(counts))
    visits = [(turn + i / n, stratum) for turn in range(rounds) for stratum, n in enumerate(counts) for i in range(n)]
    return np.array([stratum for _, stratum in sorted(visits)[:length]])


def soonest(width, confidence=CONFIDENCE):
    """Episodes after which an interval is as narrow as this if all goes for the best: full shares, the highest stakes.

    Before, one need not look.
    """
    if width >= 1.0:
        return 0.0
    gain = np.log(2.0 / (1.0 - confidence))
    return float(gain / np.log((1.0 + LEAST_OFFSET) / (1.0 - width + LEAST_OFFSET)))


def bounds(shares, strata, weights, width, confidence=CONFIDENCE):
    """An interval for the stratified mean after these episodes, valid after any number of them.

    Parameters
    ----------
    shares : array_like, shape (..., t)
        In [0, 1], in the order of the episodes; leading axes are independent sequences.
    strata : array_like of int, shape (T,)
        The whole schedule, T >= t: when few episodes are planned, stakes are higher.
    weights : array_like, shape (V,)
        Of the strata, nonnegative; they sum to 1.
    width : float
        At which the interval would be narrow enough. It is as valid for any other, but soonest as narrow as this.
    confidence : float

    Returns
    -------
    low, high : ndarray, shape (...)
        Intersect them with those of fewer episodes: that stays valid, and is narrower.
    """
    shares, strata, weights = np.asarray(shares, float), np.asarray(strata), np.asarray(weights, float)
    gain = np.log(2.0 / (1.0 - confidence))
    low, high = (_lower(x, strata, weights, width, gain) for x in (shares, 1.0 - shares))
    return low, 1.0 - high


def offsets(shares, strata, weights, width, gain):
    """The a_i of the lower bound: what to stake on each episode, from those before it.

    With stakes λ_v = κ w_v / n_v in strata of n_v episodes, m can hide in none of them; the half width then is
    (gain + κ² S² / 2) / κ to second order, S the standard error of the stratified mean, and least with
    κ = sqrt(2 gain) / S, when it is sqrt(2 gain) S. Meant are as many episodes as make that `width` / 2, or all that
    are planned. Means and the variance within strata, which S takes, are guessed from priors and from the episodes so
    far, and a follows from λ = 1 / (μ_v + a).

    Parameters
    ----------
    shares : ndarray, shape (..., t)
    strata : ndarray of int, shape (T,)
    weights : ndarray, shape (V,)
    width : float
    gain : float
        The logarithm of the capital that refutes.

    Returns
    -------
    ndarray, shape (..., t)
    """
    planned = np.bincount(strata, minlength=len(weights))
    strata = strata[: shares.shape[-1]]
    member = _member(strata, len(weights))
    before = np.arange(len(strata))
    count = (np.cumsum(member, axis=0) - member)[before, strata]
    own = (np.cumsum(shares[..., None] * member, axis=-2) - shares[..., None] * member)[..., before, strata]
    prior, weight = PRIOR_MEAN
    pooled = (prior * weight + np.cumsum(shares, axis=-1) - shares) / (weight + before)
    mean = (POOLED * pooled + own) / (POOLED + count)
    variance, weight = PRIOR_VARIANCE
    # Welford's: each share against the mean of its stratum before it.
    spread = count / (count + 1.0) * (shares - own / np.maximum(count, 1)) ** 2
    freedom = count / (count + 1.0)
    variance = (variance * weight + np.cumsum(spread, axis=-1) - spread) / (weight + np.cumsum(freedom) - freedom)
    meant = np.minimum(HURRY * 2.0 * gain * variance / (width / 2.0) ** 2, planned.sum())
    stake = np.sqrt(2.0 * gain / (variance * meant)) * weights[strata] / (planned / planned.sum())[strata]
    with np.errstate(divide="ignore"):
        return np.clip(1.0 / stake - mean, LEAST_OFFSET, LARGEST_OFFSET)


def _lower(shares, strata, weights, width, gain):
    """Least Σ w_v m_v over the m that the bets do not refute, by the programme's dual.

    With θ the multiplier, m_v solves Σ_i 1 / (m_v + a_i) = w_v / θ, cut to [0, 1], and the right θ makes the capital
    equal to what refutes. Any θ gives a lower bound of the minimum, so that the last digits of θ are on the safe side.
    """
    t = shares.shape[-1]
    offset = offsets(shares, strata, weights, width, gain)
    # A stratum that is worth nothing has nothing to say.
    counts = weights[strata[:t]] > 0.0
    offset, strata = offset[..., counts], strata[:t][counts]
    need = np.log(shares[..., counts] + offset).sum(axis=-1) - gain
    member = _member(strata, len(weights))
    seen = member.any(axis=0)

    def harmonic(m, power):
        return (1.0 / (m[..., strata] + offset)) ** power @ member

    def short_of(m):
        return need - np.log(m[..., strata] + offset).sum(axis=-1)

    m = np.broadcast_to(0.0, (*shares.shape[:-1], len(weights)))
    if not seen.any():
        return np.zeros(shares.shape[:-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        low = np.log(np.where(seen, weights / harmonic(m, 1), np.inf)).min(axis=-1)
        high = np.log(np.where(seen, weights / harmonic(m + 1.0, 1), 0.0)).max(axis=-1)
    hopeless = short_of(m) <= 0.0
    log_multiplier = high
    for _ in range(_ITERATIONS):
        due = weights * np.exp(-log_multiplier)[..., None]
        m = _solve(m, due, seen, harmonic)
        short = short_of(m)
        if np.all((np.abs(short) < 1e-9) | hopeless):
            break
        low, high = np.where(short > 0.0, log_multiplier, low), np.where(short > 0.0, high, log_multiplier)
        free = seen & (m > 0.0) & (m < 1.0)
        slope = np.where(free, due**2 / np.where(free, harmonic(m, 2), 1.0), 0.0).sum(axis=-1)
        newton = log_multiplier + short / np.where(slope > 0.0, slope, 1e-300)
        log_multiplier = np.where((low < newton) & (newton < high), newton, (low + high) / 2.0)
    return np.where(hopeless, 0.0, np.clip(m @ weights + np.exp(log_multiplier) * short, 0.0, 1.0))


def _solve(m, due, seen, harmonic):
    """m with Σ_i 1 / (m + a_i) = due, cut to [0, 1]; 0 for strata not seen. Newton's method on the harmonic mean.

    That is concave in m, and straight when all a are equal: from anywhere the second step is on the left of the root,
    and from there none overshoots.
    """
    for _ in range(_ITERATIONS):
        first, second = (np.where(seen, harmonic(m, power), 1.0) for power in (1, 2))
        last, m = m, np.where(seen, m - (first - first**2 / np.where(seen, due, 1.0)) / second, 0.0).clip(0.0, 1.0)
        if np.abs(m - last).max(initial=0.0) < 1e-13:
            break
    return m


def _member(strata, count):
    """Which episode is of which stratum: ones and zeros, shape (t, count)."""
    return (strata[:, None] == np.arange(count)).astype(float)
