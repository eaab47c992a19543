"""What the parent makes of a posterior that came out of a sandbox: checked, normalised, or refused in one line."""

import numpy as np

from course_lib.filters import Gaussian, Particles, equally_weighted


class PosteriorError(ValueError):
    """The posterior has not the form or the values it must have; the message says what arrived, for the student."""


def check(posterior, dimension, most):
    """A posterior that may be scored.

    Parameters
    ----------
    posterior : Particles, Gaussian, ndarray or list of these
        Float64 arrays of any shape and any values.
    dimension : int
        Columns of a state, for each target.
    most : int
        Particles a target may have.

    Returns
    -------
    Particles, Gaussian or list of these
        Finite; log-weights normalised here; a bare array has become equally weighted particles.

    Raises
    ------
    PosteriorError
    """
    if not isinstance(posterior, list):
        return _check_target(posterior, dimension, most)
    if not posterior:
        raise PosteriorError("expected a posterior for each target, got an empty list")
    checked = []
    for number, target in enumerate(posterior):
        try:
            checked.append(_check_target(target, dimension, most))
        except PosteriorError as error:
            raise PosteriorError(f"target {number}: {error}") from None
    return checked


def _check_target(target, dimension, most):
    if isinstance(target, Gaussian):
        return _check_gaussian(target, dimension)
    weighted = isinstance(target, Particles)
    states = target.states if weighted else target
    shape = states.shape
    if states.ndim != 2 or shape[1] != dimension:
        hint = ": transpose them" if states.ndim == 2 and shape[0] == dimension else ""
        raise PosteriorError(f"expected particles of shape (N, {dimension}), got {shape}{hint}")
    if not 1 <= len(states) <= most:
        raise PosteriorError(f"expected between 1 and {most} particles, got {len(states)}")
    _check_finite(states, "the particles")
    if not weighted:
        return equally_weighted(states)
    log_weights = target.log_weights
    if log_weights.shape != (len(states),):
        raise PosteriorError(f"expected log-weights of shape ({len(states)},), got {log_weights.shape}")
    largest = log_weights.max()  # NaN if any is NaN
    if np.isnan(largest):
        raise PosteriorError(f"{np.isnan(log_weights).sum()} of {len(states)} log-weights are NaN")
    if largest == np.inf:
        raise PosteriorError("a log-weight is +inf: log-weights are the logarithms of weights")
    if largest == -np.inf:
        raise PosteriorError("all log-weights are -inf: no particle has any weight")
    # From the largest, so that no offset is so great that the logarithm of the sum is lost in it.
    with np.errstate(over="ignore"):
        shifted = log_weights - largest
    return Particles(states, shifted - np.log(np.exp(shifted).sum()))


def _check_gaussian(gaussian, dimension):
    mean, covariance = gaussian
    if mean.shape != (dimension,):
        raise PosteriorError(f"expected a Gaussian's mean of shape ({dimension},), got {mean.shape}")
    if covariance.shape != (dimension, dimension):
        raise PosteriorError(f"expected a covariance of shape ({dimension}, {dimension}), got {covariance.shape}")
    _check_finite(mean, "the mean")
    _check_finite(covariance, "the covariance")
    scale = np.abs(covariance).max() or 1.0
    # Scaled to at most one, no entry can overflow.
    scaled = covariance / scale
    if np.abs(scaled - scaled.T).max() > 1e-6:
        raise PosteriorError("the covariance is not symmetric")
    smallest = np.linalg.eigvalsh(scaled)[0]
    if smallest < -1e-6:
        raise PosteriorError(f"the covariance has a negative eigenvalue, {float(scale) * float(smallest):.3g}")
    return gaussian


def _check_finite(array, what):
    finite = np.isfinite(array)
    if not finite.all():
        where = np.argwhere(~finite)
        first = "row {}, column {}".format(*where[0]) if array.ndim == 2 else f"entry {where[0][0]}"
        raise PosteriorError(f"{what} hold {len(where)} NaN or infinite numbers, the first in {first}")
