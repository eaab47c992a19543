"""What the parent makes of an answer that came out of a sandbox: checked, normalised, or refused in one line."""

import numpy as np

from course_lib.filters import Gaussian, Particles, equally_weighted


class AnswerError(ValueError):
    """It has not the form or the values it must have; the message says what arrived, for the student."""


def check_posterior(posterior, dimension, most):
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
    AnswerError
    """
    if not isinstance(posterior, list):
        return _check_target(posterior, dimension, most)
    if not posterior:
        raise AnswerError("expected a posterior for each target, got an empty list")
    checked = []
    for number, target in enumerate(posterior):
        try:
            checked.append(_check_target(target, dimension, most))
        except AnswerError as error:
            raise AnswerError(f"target {number}: {error}") from None
    return checked


def check_action(action, dimension):
    """An action that a world may be given.

    Parameters
    ----------
    action : ndarray
        Float64, of any shape and any values.
    dimension : int

    Returns
    -------
    ndarray, shape (dimension,)
        Finite.

    Raises
    ------
    AnswerError
    """
    if action.shape != (dimension,):
        raise AnswerError(f"expected an action of shape ({dimension},), got {action.shape}")
    _check_finite(action, "the action", "holds")
    return action


def _check_target(target, dimension, most):
    if isinstance(target, Gaussian):
        return _check_gaussian(target, dimension)
    weighted = isinstance(target, Particles)
    states = target.states if weighted else target
    shape = states.shape
    if states.ndim != 2 or shape[1] != dimension:
        hint = ": transpose them" if states.ndim == 2 and shape[0] == dimension else ""
        raise AnswerError(f"expected particles of shape (N, {dimension}), got {shape}{hint}")
    if not 1 <= len(states) <= most:
        raise AnswerError(f"expected between 1 and {most} particles, got {len(states)}")
    _check_finite(states, "the particles")
    if not weighted:
        return equally_weighted(states)
    log_weights = target.log_weights
    if log_weights.shape != (len(states),):
        raise AnswerError(f"expected log-weights of shape ({len(states)},), got {log_weights.shape}")
    largest = log_weights.max()  # NaN if any is NaN
    if np.isnan(largest):
        raise AnswerError(f"{np.isnan(log_weights).sum()} of {len(states)} log-weights are NaN")
    if largest == np.inf:
        raise AnswerError("a log-weight is +inf: log-weights are the logarithms of weights")
    if largest == -np.inf:
        raise AnswerError("all log-weights are -inf: no particle has any weight")
    # From the largest, so that no offset is so great that the logarithm of the sum is lost in it.
    with np.errstate(over="ignore"):
        shifted = log_weights - largest
    return Particles(states, shifted - np.log(np.exp(shifted).sum()))


def _check_gaussian(gaussian, dimension):
    mean, covariance = gaussian
    if mean.shape != (dimension,):
        raise AnswerError(f"expected a Gaussian's mean of shape ({dimension},), got {mean.shape}")
    if covariance.shape != (dimension, dimension):
        raise AnswerError(f"expected a covariance of shape ({dimension}, {dimension}), got {covariance.shape}")
    _check_finite(mean, "the mean", "holds")
    _check_finite(covariance, "the covariance", "holds")
    scale = np.abs(covariance).max() or 1.0
    # Scaled to at most one, no entry can overflow.
    scaled = covariance / scale
    if np.abs(scaled - scaled.T).max() > 1e-6:
        raise AnswerError("the covariance is not symmetric")
    smallest = np.linalg.eigvalsh(scaled)[0]
    if smallest < -1e-6:
        raise AnswerError(f"the covariance has a negative eigenvalue, {float(scale) * float(smallest):.3g}")
    return gaussian


def _check_finite(array, what, verb="hold"):
    finite = np.isfinite(array)
    if not finite.all():
        where = np.argwhere(~finite)
        first = "row {}, column {}".format(*where[0]) if array.ndim == 2 else f"entry {where[0][0]}"
        raise AnswerError(f"{what} {verb} {len(where)} NaN or infinite numbers, the first in {first}")
