"""Filters that adapt: random particles when the readings stop fitting, and as many particles as the cloud needs.

**Augmented.** When all particles are wrong, no resampling makes one that is right. The mean likelihood of the cloud
tells: a fast running average of it falls below a slow one, and the share 1 - w_fast / w_slow of the particles is drawn
anew from anywhere.

    running = adaptive.averages(running, log_mean_likelihood, alpha_slow=0.01, alpha_fast=0.3)
    particles = adaptive.inject(particles, running.share, draw, rng)

**KLD-sampling.** A cloud over the whole map needs many particles, a cloud in one spot few: draw until a bound on the
Kullback-Leibler distance between the cloud's histogram and the posterior's is met.

References
----------
S. Thrun, W. Burgard, D. Fox, *Probabilistic Robotics*, MIT Press 2005, tables 8.3 and 8.4.
D. Fox, *Adapting the sample size in particle filters through KLD-sampling*, Int. J. Robotics Research 22(12), 2003.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types
from scipy.special import ndtri

from course_lib.filters import bins
from course_lib.filters.bins import empty_table, number, place
from course_lib.filters.particles import Particles, equally_weighted


class Averages(NamedTuple):
    """Two running averages of the mean likelihood, as logarithms: they are densities, and underflow.

    Attributes
    ----------
    log_slow, log_fast : float
        log w_slow and log w_fast; `-inf` while no particle has ever had a likelihood.
    """

    log_slow: float
    log_fast: float

    @property
    def share(self):
        """How much of the cloud to replace: max(0, 1 - w_fast / w_slow)."""
        if self.log_fast >= self.log_slow:
            return 0.0
        return float(-np.expm1(self.log_fast - self.log_slow))


def averages(previous, log_mean_likelihood, alpha_slow, alpha_fast):
    """Update both averages: w ← w + α (w_avg - w).

    Parameters
    ----------
    previous : Averages or None
        None at the first reading, whose likelihood both averages then start from. Started from zero, the slow one would
        stay below the fast one for some 1 / α_slow steps, and a kidnapping in that time be missed.
    log_mean_likelihood : float
        log w_avg, the log-evidence that `filters.update` returns. It must be of the same kind in every step: the
        likelihood of m ranges is a density per metre to the m-th, so that one that skips missing readings falls or
        rises by orders of magnitude with their number. Give each beam a density (as the beam model does for `inf`), or
        divide the logarithm by m.
    alpha_slow, alpha_fast : float
        Decay rates per step, 0 ≤ α_slow < α_fast ≤ 1, and α_slow much the smaller: what it remembers, 1 / α_slow steps,
        is to be longer than it takes to notice a kidnapping and to recover from it.

    Returns
    -------
    Averages
        Keep it as it is after an injection. nav2_amcl sets both averages to zero then, and starts them at the next
        reading: the filter has forgotten what a good likelihood is, and injects nothing while it is still lost.

    Raises
    ------
    ValueError
        The rates are out of order, or the likelihood is NaN or infinite.
    """
    if not 0.0 <= alpha_slow < alpha_fast <= 1.0:
        raise ValueError(f"need 0 <= alpha_slow < alpha_fast <= 1, got {alpha_slow:g} and {alpha_fast:g}")
    value = float(log_mean_likelihood)
    if not value < np.inf:
        raise ValueError(f"the log of the mean likelihood must be finite or -inf, got {value}")
    if previous is None:
        return Averages(value, value)
    return Averages(_blend(previous.log_slow, value, alpha_slow), _blend(previous.log_fast, value, alpha_fast))


def _blend(log_old, log_new, alpha):
    # log((1 - α) w + α w_avg)
    with np.errstate(divide="ignore"):
        return float(np.logaddexp(np.log1p(-alpha) + log_old, np.log(alpha) + log_new))


def inject(particles, share, draw, rng):
    """Replace each particle, with a probability, by one from anywhere.

    Parameters
    ----------
    particles : Particles
        Best after resampling: a replaced particle leaves its weight to its successor, so that random ones have `share`
        of the weight on average, but of a cloud with few heavy particles all or nothing.
    share : float
        In [0, 1]. Their number is binomial: below 1 / N there is still one now and then, which rounding would forget.
    draw : callable
        `draw(n, rng) -> states (n, d)`, from wherever the robot may be.
    rng : numpy.random.Generator

    Returns
    -------
    Particles
    """
    if share <= 0.0:
        return particles
    replaced = rng.random(len(particles.states)) < share
    count = int(np.count_nonzero(replaced))
    if not count:
        return particles
    states = particles.states.copy()
    states[replaced] = draw(count, rng)
    return Particles(states, particles.log_weights)


def kld_bound(k, epsilon, delta):
    """Draws from a distribution over k bins whose histogram is, with probability 1 - δ, within ε of it (in nats).

    Parameters
    ----------
    k : array_like of int
        Occupied bins.
    epsilon : float
        Largest Kullback-Leibler distance, positive.
    delta : float
        Probability that it is larger, in (0, 1).

    Returns
    -------
    ndarray or float
        χ²_{k-1, 1-δ} / 2ε by Wilson and Hilferty's approximation; 0 for k ≤ 1, where there is nothing to learn.

    References
    ----------
    Fox 2003, eq. (7).
    """
    _check(epsilon, delta)
    freedom = np.maximum(np.asarray(k, dtype=float) - 1.0, 0.0)
    # n = (k-1) / 2ε · (1 - 2 / 9(k-1) + √(2 / 9(k-1)) z_{1-δ})³
    part = 2.0 / (9.0 * np.maximum(freedom, 1.0))
    return np.maximum(freedom / (2.0 * epsilon) * (1.0 - part + np.sqrt(part) * ndtri(1.0 - delta)) ** 3, 0.0)[()]


def kld_resample(particles, rng, widths, epsilon=0.05, delta=0.01, least=100, most=10_000, angles=()):
    """Resample, as many as the bins need that the drawn particles occupy.

    Parameters
    ----------
    particles : Particles
    rng : numpy.random.Generator
    widths : array_like, shape (d,)
        Widths of a bin, positive. Smaller ones make larger clouds.
    epsilon, delta : float
        As in `kld_bound`.
    least, most : int
        Bounds on the number of draws, 1 ≤ least ≤ most.
    angles : sequence of int
        Columns that hold angles in radians: their bins go around the circle.

    Returns
    -------
    Particles
        Independent draws, equally weighted: the first n that are `least` or more, and enough for the bins occupied by
        these n. Fox draws, moves and then bins each particle; binned before they move they are a little fewer.

    Raises
    ------
    ValueError
        An argument is out of range, the weights have no positive sum, or the cloud is too wide for the widths.
    """
    _check(epsilon, delta)
    if not 1 <= least <= most:
        raise ValueError(f"need 1 <= least <= most, got {least} and {most}")
    states, widths, angular = bins.columns(particles.states, widths, angles)
    cumulative = np.cumsum(particles.weights)
    if not 0.0 < cumulative[-1] < np.inf:
        raise ValueError("weights must be finite and non-negative, and one of them positive")
    drawn = draw_until_bound(states, cumulative, widths, angular, epsilon, ndtri(1.0 - delta), least, most, rng)
    return equally_weighted(states[drawn])


@njit(
    types.int64[::1](
        types.float64[:, ::1],
        types.float64[::1],
        types.float64[::1],
        types.boolean[::1],
        types.float64,
        types.float64,
        types.int64,
        types.int64,
        types.npy_rng,
    ),
    cache=True,
)
def draw_until_bound(states, cumulative, widths, angular, epsilon, z, least, most, rng):
    """Draw parents until there are enough for the bins they occupy.

    Parameters
    ----------
    states : ndarray, shape (N, d)
    cumulative : ndarray, shape (N,)
        Partial sums of the weights; the last need not be 1.
    widths, angular
        As in `bins.number`.
    epsilon, z : float
        ε, and the normal quantile z_{1-δ}.
    least, most : int
    rng : numpy.random.Generator
        One `random()` for each draw.

    Returns
    -------
    ndarray of int64, shape (n,)
        Indices in the order drawn, which is not sorted: any part of them is a sample.
    """
    n = len(states)
    keys, _ = number(states, widths, angular)
    occupied, seen = empty_table(min(n, most)), np.zeros(n, dtype=np.bool_)
    parents = np.empty(most, dtype=np.int64)
    count, k, needed = 0, 0, np.float64(least)
    while count < most and count < needed:
        # Rounding may end the sum below or above one: the draw is scaled to where it ends.
        i = np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right")
        # A product may be rounded up to the last sum; the first that reaches it is the last of positive weight.
        if i == n:
            i = np.searchsorted(cumulative, cumulative[-1], side="left")
        parents[count] = i
        count += 1
        if not seen[i]:
            seen[i] = True
            at = place(occupied, keys[i])
            if occupied[at] != keys[i]:
                occupied[at] = keys[i]
                k += 1
                if k > 1:
                    part = 2.0 / (9.0 * (k - 1.0))
                    needed = max(needed, (k - 1.0) / (2.0 * epsilon) * (1.0 - part + np.sqrt(part) * z) ** 3)
    return parents[:count].copy()


def _check(epsilon, delta):
    if not (epsilon > 0.0 and 0.0 < delta < 1.0):
        raise ValueError(f"need epsilon > 0 and 0 < delta < 1, got {epsilon:g} and {delta:g}")
