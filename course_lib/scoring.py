"""How good a posterior is, given the truth: the exercise's own errors and scores that cannot be gamed."""

import numpy as np
from numba import njit

from course_lib.angles import wrap
from course_lib.filters.particles import equally_weighted
from course_lib.filters.resampling import systematic

# A variance below this share of a component's own is rounding.
_CERTAIN = 1e-12


def best_share_error(distances, weights, share=0.5):
    """Mean distance of the particles nearest to the truth.

    Parameters
    ----------
    distances : ndarray, shape (N,)
        Distance of each particle to the truth.
    weights : ndarray, shape (N,)
        Normalised.
    share : float
        How much of the weight counts, in (0, 1]: particles are taken from the nearest on until their weights sum to
        this, the last one with as much of its weight as it takes.

    Returns
    -------
    float
        With equal weights, an even N and a share of one half: the mean of the N/2 smallest distances, as in the
        exercise.
    """
    order = np.argsort(distances)
    cumulative = np.minimum(np.cumsum(weights[order]), share)
    kept = np.diff(cumulative, prepend=0.0)
    return float(distances[order] @ kept / cumulative[-1])


def energy_score(points, weights, truths, scale=np.inf):
    """Energy score of a weighted sample, averaged over draws of the truth. Lower is better.

    Strictly proper: no forecast has a lower expected score than the distribution the truth was drawn from. It stays so
    when distances count as d' = s (1 - e^(-d/s)): as they are where they are small, but s at most. Then one who has
    lost the target is wrong by s, wherever he looks for it.

    Parameters
    ----------
    points : ndarray, shape (N, d)
    weights : ndarray, shape (N,)
        Normalised.
    truths : ndarray, shape (M, d)
        One true state, or many drawn from the same distribution.
    scale : float
        s, in the units of `points`.

    Returns
    -------
    float
        E‖X - y‖ - ½ E‖X - X'‖, in the units of `points`. Costs O(N² + N M).

    References
    ----------
    T. Gneiting, A. E. Raftery, *Strictly proper scoring rules, prediction, and estimation*, JASA 102, 2007, eq. (22);
    sec. 5.1 for a finite s, as e^(-d/s) is a positive definite kernel.
    """
    points, weights, truths = _contiguous(points, weights, truths)
    to_truth, to_others = _mean_distances(points, weights, truths, float(scale))
    return float(to_truth.mean() - 0.5 * weights @ to_others)


def region_rank(points, weights, truth):
    """Share of a weighted sample that lies more centrally than the truth does.

    A point's depth is its mean distance to the sample, so that the region of the most central 90 % follows the sample's
    shape, whatever it is; a particle's is measured with the truth in its place. When the truth is drawn from the
    posterior, the rank is uniform on [0, 1]: it is at most 0.9 in nine steps of ten. More often means an overcautious
    filter, less often an overconfident one.

    Parameters
    ----------
    points : ndarray, shape (N, d)
    weights : ndarray, shape (N,)
        Normalised.
    truth : ndarray, shape (d,)

    Returns
    -------
    float
        Between 0 (at the centre) and 1 (farther out than every point).
    """
    return energy_score_and_rank(points, weights, truth)[1]


def energy_score_and_rank(points, weights, truth):
    """`energy_score` and `region_rank` of a single truth: most of the work of either is the same.

    Parameters
    ----------
    points : ndarray, shape (N, d)
    weights : ndarray, shape (N,)
        Normalised.
    truth : ndarray, shape (d,)

    Returns
    -------
    score, rank : float
    """
    points, weights, truths = _contiguous(points, weights, np.atleast_2d(truth))
    to_truth, to_others = _mean_distances(points, weights, truths, np.inf)
    score = float(to_truth[0] - 0.5 * weights @ to_others)
    # Σ_j w_j |x_i - x_j| has nothing to say for j = i: there the truth stands in, which makes it one point among N + 1.
    depth = to_others + weights * np.linalg.norm(points - truths, axis=1)
    if len(points) == 1:
        # Two points are equally central. But a filter that is sure of one is right there and nowhere else.
        return score, float(to_truth[0] > 0.0)
    return score, float(weights @ (depth < to_truth[0]))


def kernel_score(points, weights, truth):
    """Kernel score of a weighted sample: from 0, all of it is at the truth, to 1, all of it is at one wrong place.

    Nowhere in particular is 1/2. Strictly proper, and flat about 0: what is wrong by a tenth of the kernel's width is
    nearly as good as right.

    Parameters
    ----------
    points : ndarray, shape (N, d)
        In units of the kernel's width: k(x, y) = exp(-‖x - y‖² / 2).
    weights : ndarray, shape (N,)
        Normalised.
    truth : ndarray, shape (d,)

    Returns
    -------
    float
        ½ E k(X, X') - E k(X, y) + ½. Costs O(N²).

    References
    ----------
    T. Gneiting, A. E. Raftery, *Strictly proper scoring rules, prediction, and estimation*, JASA 102, 2007, sec. 5.1.
    """
    points, weights = np.asarray(points, dtype=float), np.asarray(weights, dtype=float)
    offsets = points - truth
    squares = (offsets**2).sum(axis=1)
    # Far away what is left of the difference is rounding, of either sign.
    between = np.exp(np.minimum(offsets @ offsets.T - 0.5 * (squares[:, None] + squares), 0.0))
    return float(max(0.5 * weights @ between @ weights - weights @ np.exp(-0.5 * squares) + 0.5, 0.0))


def nees(gaussian, truths, angles=()):
    """Normalised estimation error squared of a Gaussian.

    When the truth is drawn from the Gaussian it is chi-square distributed with d degrees of freedom, so that its mean
    is d. A larger mean is an overconfident filter's, a smaller one an overcautious one's.

    Parameters
    ----------
    gaussian : Gaussian
        mean (d,), covariance (d, d); the covariance may be singular.
    truths : ndarray, shape (M, d)
        One true state, or many.
    angles : sequence of int
        Columns that hold angles, in radians: their errors are wrapped.

    Returns
    -------
    ndarray, shape (M,)
        eᵀ P⁻¹ e for each truth, e = truth - mean. Where the Gaussian is certain, a right component adds nothing and a
        wrong one makes it infinite.

    References
    ----------
    Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, Wiley 2001,
    sec. 5.4.
    """
    errors = truths - gaussian.mean
    columns = list(angles)
    errors[:, columns] = wrap(errors[:, columns])
    # In units of the standard deviations, so that metres and radians compare.
    deviations = np.sqrt(np.maximum(np.diag(gaussian.covariance), 0.0))
    deviations = np.where(deviations > 0.0, deviations, 1.0)
    variances, axes = np.linalg.eigh(gaussian.covariance / np.outer(deviations, deviations))
    squares = (errors / deviations @ axes) ** 2
    certain = variances <= len(variances) * _CERTAIN
    squares[:, certain] = np.where(squares[:, certain] > len(variances) * _CERTAIN, np.inf, 0.0)
    return (squares / np.where(certain, 1.0, variances)).sum(axis=1)


def thin(particles, size, rng):
    """At most `size` equally weighted particles that stand for all; those given when they are few and equal."""
    states, log_weights = particles
    if len(states) <= size and np.ptp(log_weights) == 0.0:
        return particles
    return equally_weighted(states[systematic(np.exp(log_weights), rng, min(size, len(states)))])


def _contiguous(*arrays):
    return (np.ascontiguousarray(array, dtype=float) for array in arrays)


@njit("float64(float64, float64)", cache=True, inline="always")
def _counted(distance, scale):
    return scale * -np.expm1(-distance / scale) if scale < np.inf else distance


@njit("Tuple((float64[::1], float64[::1]))(float64[:, ::1], float64[::1], float64[:, ::1], float64)", cache=True)
def _mean_distances(points, weights, truths, scale):
    """Weighted mean distance of the points to each truth (M,) and to each point (N,)."""
    n, d = points.shape
    to_truth = np.zeros(truths.shape[0])
    to_others = np.zeros(n)
    for i in range(n):
        for m in range(truths.shape[0]):
            square = 0.0
            for c in range(d):
                square += (points[i, c] - truths[m, c]) ** 2
            to_truth[m] += weights[i] * _counted(np.sqrt(square), scale)
        for j in range(i):
            square = 0.0
            for c in range(d):
                square += (points[i, c] - points[j, c]) ** 2
            distance = _counted(np.sqrt(square), scale)
            to_others[i] += weights[j] * distance
            to_others[j] += weights[i] * distance
    return to_truth, to_others
