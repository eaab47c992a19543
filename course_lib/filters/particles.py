"""The two posteriors a filter may return, and what one asks of them."""

from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logsumexp

from course_lib.angles import circular_mean, wrap


class Particles(NamedTuple):
    """A weighted sample of a posterior.

    Attributes
    ----------
    states : ndarray, shape (N, d)
        One particle a row; the world names columns and units.
    log_weights : ndarray, shape (N,)
        Natural logarithms of the weights, normalised: their exponentials sum to one.
    """

    states: np.ndarray
    log_weights: np.ndarray

    @property
    def weights(self):
        """Normalised weights, shape (N,)."""
        return np.exp(self.log_weights)


class Gaussian(NamedTuple):
    """A normal posterior.

    Attributes
    ----------
    mean : ndarray, shape (d,)
    covariance : ndarray, shape (d, d)
    """

    mean: np.ndarray
    covariance: np.ndarray


class Step(NamedTuple):
    """What an `Estimator` returns, or a `Planner`, when it wants more back on its next call than the posterior.

    Attributes
    ----------
    posterior : Particles, ndarray, Gaussian or list of these
        A planner's action is in its place.
    memory : object
        Anything; the next call finds it in `previous.memory`.
    """

    posterior: Any
    memory: Any


def equally_weighted(states):
    """Particles of equal weight.

    Parameters
    ----------
    states : array_like, shape (N, d)

    Returns
    -------
    Particles
    """
    states = np.asarray(states, dtype=float)
    return Particles(states, np.full(len(states), -np.log(len(states))))


def normalise(log_weights):
    """Log-weights that sum to one, and the logarithm of what they summed to.

    Parameters
    ----------
    log_weights : array_like, shape (N,)
        Unnormalised; `-inf` is a weight of zero.

    Returns
    -------
    log_weights : ndarray, shape (N,)
        Normalised.
    log_sum : float
        `-inf` when every weight is zero; the log-weights are then NaN.
    """
    log_weights = np.asarray(log_weights, dtype=float)
    log_sum = _log_sum_exp(log_weights)
    with np.errstate(invalid="ignore"):
        return log_weights - log_sum, log_sum


def effective_sample_size(particles):
    """1 / Σ w², between 1 and N.

    References
    ----------
    A. Kong, J. S. Liu, W. H. Wong, *Sequential imputations and Bayesian missing data problems*, JASA 89, 1994.
    """
    return float(1.0 / np.square(particles.weights).sum())


def mean(particles, angles=()):
    """Weighted mean; on the circle in the columns named in `angles`.

    Parameters
    ----------
    particles : Particles
    angles : sequence of int
        Columns that hold angles in radians.

    Returns
    -------
    ndarray, shape (d,)
    """
    weights = particles.weights
    result = weights @ particles.states
    columns = list(angles)
    result[columns] = circular_mean(particles.states[:, columns], weights)
    return result


def covariance(particles, angles=()):
    """Weighted covariance Σ w (x - x̄)(x - x̄)ᵀ, angle differences wrapped.

    Parameters
    ----------
    particles : Particles
    angles : sequence of int
        Columns that hold angles in radians.

    Returns
    -------
    ndarray, shape (d, d)
    """
    deviations = _deviations(particles, mean(particles, angles), angles)
    return (particles.weights[:, None] * deviations).T @ deviations


def mode(particles, angles=()):
    """The particle at which a kernel estimate of the density is highest.

    Unlike the particle of highest weight it is defined after resampling too, when all weights are equal, and unlike
    the mean it lies where the particles are. Costs O(N²), three times that for each angle.

    Parameters
    ----------
    particles : Particles
    angles : sequence of int
        Columns that hold angles in radians.

    Returns
    -------
    ndarray, shape (d,)

    Raises
    ------
    numpy.linalg.LinAlgError
        The particles lie in a subspace, so that they have no density.
    """
    return particles.states[np.argmax(_log_density(particles, angles))].copy()


def entropy(posterior, angles=()):
    """Differential entropy in nats.

    Parameters
    ----------
    posterior : Particles or Gaussian
    angles : sequence of int
        Columns that hold angles in radians (particles only).

    Returns
    -------
    float
        Exact for a Gaussian. For particles -Σ wᵢ log p̂(xᵢ), with p̂ a Gaussian kernel estimate (Scott's
        bandwidth), which smooths and so errs upwards. Costs O(N²), three times that for each angle.

    Raises
    ------
    numpy.linalg.LinAlgError
        The particles lie in a subspace: their entropy is -∞.

    References
    ----------
    H. Joe, *Estimation of entropy and other functionals of a multivariate density*, Ann. Inst. Stat. Math. 41, 1989.
    """
    if isinstance(posterior, Gaussian):
        sign, log_determinant = np.linalg.slogdet(2 * np.pi * np.e * posterior.covariance)
        return 0.5 * float(log_determinant) if sign > 0 else -np.inf
    return -float(posterior.weights @ _log_density(posterior, angles))


def _log_sum_exp(values):
    # scipy's takes 20 times as long for a thousand values: it is made for arrays of any kind.
    top = values.max()
    if not np.isfinite(top):
        return float(top)
    shares = values - top
    return float(top + np.log(np.exp(shares, out=shares).sum()))


def _deviations(particles, centre, angles):
    deviations = particles.states - centre
    columns = list(angles)
    deviations[:, columns] = wrap(deviations[:, columns])
    return deviations


def _log_density(particles, angles):
    # Only here: of all that this package needs, it takes longest to import.
    from scipy.stats import gaussian_kde

    deviations = _deviations(particles, mean(particles, angles), angles)
    density = gaussian_kde(deviations.T, weights=particles.weights)
    # A kernel reaches across the seam: on the circle p̂(θ) is the sum of p̂(θ + 2πk), of which k = -1, 0, 1 matter.
    columns = list(angles)
    turns = np.array(list(product((-1, 0, 1), repeat=len(columns))))
    shifts = np.zeros((len(turns), deviations.shape[1]))
    shifts[:, columns] = 2 * np.pi * turns
    return logsumexp([density.logpdf((deviations + shift).T) for shift in shifts], axis=0)
