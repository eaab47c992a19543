"""The regularised particle filter: resampling draws from a smooth density, so that copies part.

Where the noise of a step cannot part copies (it enters two integrations away from what is measured), the bootstrap
filter's cloud becomes one particle. A kernel with the cloud's own covariance parts them along the correlations that the
filter has learnt, and shrinking towards the mean gives back the variance that it adds:

    x = m + √(1 - h²) (xⁱ - m) + h L ε,   L Lᵀ = P,   ε ~ N(0, I)

has mean m and covariance P whatever h is, and becomes a draw from the Gaussian as h goes to 1. `update` does the same
within a step whose readings leave too few particles: it takes the likelihood in parts.

References
----------
J. Liu, M. West, *Combined parameter and state estimation in simulation-based filtering*, in Sequential Monte Carlo
Methods in Practice, Springer 2001, sec. 10.3.
C. Musso, N. Oudjane, F. Le Gland, *Improving regularised particle filters*, ibid., ch. 12: bandwidth, progressive
correction.
"""

import numpy as np
from numba import njit

from course_lib.filters import bootstrap
from course_lib.filters.particles import effective_sample_size, equally_weighted, normalise
from course_lib.filters.resampling import systematic

#: The likelihood is taken in no more parts than this: the last is what is left, however few particles it leaves.
MOST_PARTS = 30


def bandwidth(n, d):
    """The h that is best for n particles of a Gaussian in d dimensions: (4 / (n (d + 2)))^(1 / (d + 4))."""
    return (4.0 / (n * (d + 2.0))) ** (1.0 / (d + 4.0))


def resample(particles, rng, scheme=systematic, threshold=0.5, angles=(), scale=1.0):
    """`filters.resample`, and a kernel on what it copies.

    Parameters
    ----------
    particles : Particles
    rng : numpy.random.Generator
    scheme : callable
        As in `filters.resample`.
    threshold : float
        As in `filters.resample`.
    angles : sequence of int
        Columns that hold angles in radians: their mean is taken on the circle, deviations and results are wrapped.
    scale : float
        h is this many times what `bandwidth` says, and at most 1.

    Returns
    -------
    Particles
        Equally weighted, of the same mean and covariance but for sampling; or the particles as they are.
    """
    n, d = particles.states.shape
    if effective_sample_size(particles) >= threshold * n * (1.0 - 1e-9):
        return particles
    states, weights, mask = np.ascontiguousarray(particles.states, dtype=float), particles.weights, _mask(d, angles)
    centre, covariance = moments(states, weights, mask)
    h = min(scale * bandwidth(n, d), 1.0)
    root, parents = h * square_root(covariance), scheme(weights, rng)
    noise = rng.standard_normal((n, d))
    return equally_weighted(spread(states, parents, centre, root, noise, np.sqrt(1.0 - h**2), mask))


def update(particles, log_likelihood, rng, share=0.2, angles=(), scale=1.0):
    """Measurement update in parts: p(z | x) = Π p(z | x)^φ, and a `resample` between one part and the next.

    Each part is as large as leaves `share` · N effective particles. Most readings need one part; precise ones, or the
    first, which meet a cloud much wider than they are, more.

    Parameters
    ----------
    particles : Particles
    log_likelihood : callable
        `log_likelihood(states (N, d)) -> (N,)`.
    rng : numpy.random.Generator
    share : float
        Between 0 (all at once, which is `filters.update`) and 1.
    angles, scale
        As in `resample`.

    Returns
    -------
    particles : Particles
    log_evidence : float
        log p(zₖ | z₁, ..., zₖ₋₁), as the parts estimate it.

    Raises
    ------
    ZeroLikelihoodError, ValueError
        As in `filters.update`.
    """
    left, log_evidence = 1.0, 0.0
    for number in range(1, MOST_PARTS + 1):
        full = log_likelihood(particles.states)
        part = left if number == MOST_PARTS else _largest_part(particles.log_weights, full, left, share)
        particles, factor = bootstrap.update(particles, part * full)
        log_evidence += factor
        left -= part
        if left <= 0.0:
            break
        particles = resample(particles, rng, threshold=1.0, angles=angles, scale=scale)
    return particles, log_evidence


def square_root(covariance):
    """L with L Lᵀ = P, shape (d, d): of a singular P, too, as a cloud of fewer than d different particles has."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(deviations > 0.0, deviations, 1.0)
    # In units of the standard deviations, so that metres and radians round alike.
    variances, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * axes * np.sqrt(np.maximum(variances, 0.0))


@njit("Tuple((float64[::1], float64[:, ::1]))(float64[:, ::1], float64[::1], boolean[::1])", cache=True)
def moments(states, weights, angular):
    """`filters.mean` and `filters.covariance` at once.

    Parameters
    ----------
    states : ndarray, shape (N, d)
    weights : ndarray, shape (N,)
        Normalised.
    angular : ndarray of bool, shape (d,)
        Columns that hold angles in radians.

    Returns
    -------
    mean : ndarray, shape (d,)
    covariance : ndarray, shape (d, d)
    """
    n, d = states.shape
    centre, sines = np.zeros(d), np.zeros(d)
    for i in range(n):
        for c in range(d):
            if angular[c]:
                sines[c] += weights[i] * np.sin(states[i, c])
                centre[c] += weights[i] * np.cos(states[i, c])
            else:
                centre[c] += weights[i] * states[i, c]
    for c in range(d):
        if angular[c]:
            centre[c] = np.arctan2(sines[c], centre[c])
    covariance, deviations = np.zeros((d, d)), np.empty(d)
    for i in range(n):
        for c in range(d):
            deviations[c] = states[i, c] - centre[c]
            if angular[c]:
                deviations[c] -= 2.0 * np.pi * np.floor((deviations[c] + np.pi) / (2.0 * np.pi))
        for c in range(d):
            share = weights[i] * deviations[c]
            for e in range(c + 1):
                covariance[c, e] += share * deviations[e]
    for c in range(d):
        for e in range(c):
            covariance[e, c] = covariance[c, e]
    return centre, covariance


@njit(
    "float64[:, ::1]"
    "(float64[:, ::1], int64[::1], float64[::1], float64[:, ::1], float64[:, ::1], float64, boolean[::1])",
    cache=True,
)
def spread(states, parents, centre, root, noise, shrinkage, angular):
    """Children m + s (xⁱ - m) + L ε of the parents i.

    Parameters
    ----------
    states : ndarray, shape (N, d)
    parents : ndarray of int64, shape (M,)
    centre : ndarray, shape (d,)
        m.
    root : ndarray, shape (d, d)
        L.
    noise : ndarray, shape (M, d)
        ε.
    shrinkage : float
        s.
    angular : ndarray of bool, shape (d,)
        Columns that hold angles in radians: deviations and results are wrapped.

    Returns
    -------
    ndarray, shape (M, d)
    """
    m, d = noise.shape
    children = np.empty((m, d))
    for i in range(m):
        for c in range(d):
            deviation = states[parents[i], c] - centre[c]
            if angular[c]:
                deviation -= 2.0 * np.pi * np.floor((deviation + np.pi) / (2.0 * np.pi))
            child = centre[c] + shrinkage * deviation
            for e in range(d):
                child += root[c, e] * noise[i, e]
            if angular[c]:
                child -= 2.0 * np.pi * np.floor((child + np.pi) / (2.0 * np.pi))
            children[i, c] = child
    return children


def _mask(d, angles):
    mask = np.zeros(d, dtype=bool)
    mask[list(angles)] = True
    return mask


def _largest_part(log_weights, log_likelihood, left, share):
    """The largest φ up to `left` for which weights times likelihood^φ are effectively `share` · N particles."""

    def share_of(part):
        normalised = normalise(log_weights + part * log_likelihood)[0]
        return np.exp(-normalise(2.0 * normalised)[1]) / len(normalised)

    # `not <` and not `>=`: what is NaN is for `bootstrap.update` to refuse.
    if share <= 0.0 or not share_of(left) < share:
        return left
    low, high = 0.0, left
    # To 5 %, and at least a part in a million, so that there is progress.
    while high - low > 0.05 * high and high > 1e-6 * left:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if share_of(middle) >= share else (low, middle)
    return max(low, 1e-6 * left)
