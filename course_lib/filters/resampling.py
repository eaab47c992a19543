"""Resampling: turn weights into offspring indices, without bias.

Each scheme takes normalised weights `w` (N,), a Generator and a number of offspring, and returns sorted indices
(size,), int64, such that index i is expected `size * w[i]` times. They differ in the variance of that number.

References
----------
R. Douc, O. Cappé, E. Moulines, *Comparison of resampling schemes for particle filtering*, ISPA 2005.
"""

import numpy as np
from numba import njit


@njit("int64[::1](float64[::1], float64[::1])", cache=True)
def inverse_cdf(weights, positions):
    """Index of the weight whose share of [0, 1] holds each position.

    Parameters
    ----------
    weights : ndarray, shape (N,)
        Non-negative, with a positive sum.
    positions : ndarray, shape (M,)
        Sorted, in [0, 1).

    Returns
    -------
    ndarray of int64, shape (M,)
        Sorted indices; an index of zero weight is never among them.
    """
    total = 0.0
    last = 0
    for i in range(weights.size):
        total += weights[i]
        if weights[i] > 0.0:
            last = i
    indices = np.empty(positions.size, dtype=np.int64)
    i = 0
    cumulative = weights[0]
    for m in range(positions.size):
        # The cumulative sum ends at `total`, not at one: scaling the position instead of the
        # weights makes the last one reachable whatever rounding did; `last` bounds it.
        target = positions[m] * total
        while cumulative <= target and i < last:
            i += 1
            cumulative += weights[i]
        indices[m] = i
    return indices


@njit("int64[::1](float64[::1], float64, int64)", cache=True)
def systematic_indices(weights, shift, size):
    """Systematic resampling: the index whose share of [0, 1] holds each (m + shift) / size, m = 0, ..., size - 1.

    As `inverse_cdf` of these positions, in a third of the time: no loop has a branch that depends on the weights, which
    the processor would mispredict half of the time.

    Parameters
    ----------
    weights : ndarray, shape (N,)
        Non-negative, with a positive sum.
    shift : float
        u in [0, 1).
    size : int
        M, the number of children.

    Returns
    -------
    ndarray of int64, shape (size,)
        Sorted indices; an index of zero weight is never among them.

    Raises
    ------
    ValueError
        A weight is negative or NaN, or their sum is zero or infinite.
    """
    total, valid = 0.0, True
    for i in range(weights.size):
        total += weights[i]
        valid &= weights[i] >= 0.0
    if not (valid and 0.0 < total < np.inf):
        raise ValueError("weights must be finite and non-negative, and one of them positive")
    indices = np.zeros(size, dtype=np.int64)
    before = 0.0
    for i in range(weights.size):
        # Child m sits at (m + u) / M: the first above C_{i-1} = Σ_{j<i} w_j is m = ⌈M C_{i-1} - u⌉
        position = size * (before / total) - shift
        first = int(position)
        first += first < position
        before += weights[i]
        if first < size and weights[i] > 0.0:
            indices[first] = i
    # A parent keeps its children up to where the next one's begin.
    for m in range(1, size):
        indices[m] = max(indices[m], indices[m - 1])
    return indices


def multinomial(weights, rng, size=None):
    """Independent draws: offspring are multinomial.

    Parameters
    ----------
    weights : array_like, shape (N,)
        Normalised weights.
    rng : numpy.random.Generator
    size : int, optional
        Number of offspring; N when left out.

    Returns
    -------
    ndarray of int64, shape (size,)
        Sorted indices.
    """
    weights, size = _arguments(weights, size)
    # Normalised partial sums of exponentials are the order statistics of uniforms: sorted without sorting.
    gaps = np.cumsum(rng.standard_exponential(size + 1))
    return inverse_cdf(weights, gaps[:-1] / gaps[-1])


def stratified(weights, rng, size=None):
    """One uniform draw in each of `size` equal strata. Parameters and return as in `multinomial`."""
    weights, size = _arguments(weights, size)
    return inverse_cdf(weights, (np.arange(size) + rng.random(size)) / size)


def systematic(weights, rng, size=None):
    """One uniform draw, repeated at equal spacing: i has ⌊size·w⌋ or ⌈size·w⌉ offspring.

    Parameters and return as in `multinomial`.
    """
    weights = _contiguous(weights)
    return systematic_indices(weights, rng.random(), weights.size if size is None else size)


def residual(weights, rng, size=None):
    """⌊size·w⌋ copies of each, the rest drawn from what is left over. Parameters and return as in `multinomial`."""
    weights, size = _arguments(weights, size)
    expected = size * weights / weights.sum()
    # A whole number that rounding left just below itself is still that number: N equal weights keep N copies.
    copies = np.floor(expected * (1.0 + 1e-12)).astype(np.int64)
    rest = size - int(copies.sum())
    if rest:
        drawn = multinomial(np.maximum(expected - copies, 0.0), rng, rest)
        copies += np.bincount(drawn, minlength=weights.size)
    return np.repeat(np.arange(weights.size), copies)


def _arguments(weights, size):
    weights = _contiguous(weights)
    if not (np.all(weights >= 0.0) and 0.0 < weights.sum() < np.inf):
        raise ValueError("weights must be finite and non-negative, and one of them positive")
    return weights, weights.size if size is None else size


def _contiguous(weights):
    weights = np.ascontiguousarray(weights, dtype=float)
    if weights.ndim != 1 or weights.size == 0:
        raise ValueError(f"weights must have shape (N,) with N > 0, got {weights.shape}")
    return weights
