"""The bootstrap particle filter, one function per step.

A model is two functions: `transition(states, rng) -> states` draws from p(xₖ | xₖ₋₁), row by row, and a
log-likelihood log p(zₖ | xₖ) of each row. The filter knows nothing else of the world.

References
----------
N. J. Gordon, D. J. Salmond, A. F. M. Smith, *Novel approach to nonlinear/non-Gaussian Bayesian state estimation*,
IEE Proceedings F 140(2), 1993.
"""

import numpy as np

from course_lib.filters.particles import Particles, equally_weighted, normalise
from course_lib.filters.resampling import systematic


class ZeroLikelihoodError(ValueError):
    """No particle can explain the observation: every weight is zero."""


def predict(particles, transition, rng):
    """Prior update: draw each particle's successor.

    Parameters
    ----------
    particles : Particles
    transition : callable
        `transition(states (N, d), rng) -> states (N, d)`.
    rng : numpy.random.Generator

    Returns
    -------
    Particles
        New states, the same weights.
    """
    # x_k^n ~ p(x_k | x_{k-1}^n)
    return Particles(transition(particles.states, rng), particles.log_weights)


def update(particles, log_likelihood):
    """Measurement update: weigh each particle by the likelihood of the observation.

    Parameters
    ----------
    particles : Particles
    log_likelihood : ndarray, shape (N,)
        log p(zₖ | xₖⁿ); `-inf` where the particle cannot have caused the observation.

    Returns
    -------
    particles : Particles
        The same states, new weights.
    log_evidence : float
        log p(zₖ | z₁, ..., zₖ₋₁), as the particles estimate it. Its sum over k is the log-likelihood of the data.

    Raises
    ------
    ZeroLikelihoodError
        Every weight is zero. What to do then is the caller's choice (keep the prior, redraw it); none is right
        for all models.
    ValueError
        A log-likelihood is NaN or `inf`, or there is not one for each particle.
    """
    if np.shape(log_likelihood) != particles.log_weights.shape:
        raise ValueError(
            f"log-likelihoods must have shape {particles.log_weights.shape}, got {np.shape(log_likelihood)}"
        )
    # p(z_k | z_{1:k-1}) ≈ Σ_n w_{k-1}^n p(z_k | x_k^n);  w_k^n = w_{k-1}^n p(z_k | x_k^n) / p(z_k | z_{1:k-1})
    log_weights, log_evidence = normalise(particles.log_weights + log_likelihood)
    if not np.isfinite(log_evidence):
        if log_evidence == -np.inf:
            raise ZeroLikelihoodError(f"all {len(log_weights)} particles have zero likelihood")
        raise ValueError(f"log-likelihoods must be finite or -inf; the log-evidence became {log_evidence}")
    return Particles(particles.states, log_weights), log_evidence


def resample(particles, rng, scheme=systematic, threshold=0.5):
    """Replace weights by offspring when the effective sample size is below `threshold` · N.

    Read estimates off before resampling: it adds noise and no information.

    Parameters
    ----------
    particles : Particles
    rng : numpy.random.Generator
    scheme : callable
        One of `multinomial`, `stratified`, `systematic`, `residual`.
    threshold : float
        Between 0 (never) and 1 (whenever weights differ).

    Returns
    -------
    Particles
        Equally weighted offspring, or the particles as they are.
    """
    weights = particles.weights
    # ESS = 1 / Σ w²; that of equal weights is N but for rounding.
    if 1.0 >= threshold * len(weights) * (1.0 - 1e-9) * np.square(weights).sum():
        return particles
    return equally_weighted(particles.states.take(scheme(weights, rng), axis=0))


def bootstrap_step(particles, transition, log_likelihood, rng, scheme=systematic, threshold=0.5):
    """One step of the filter: resample when needed, predict, update.

    Parameters
    ----------
    particles : Particles
        Posterior at time k - 1.
    transition : callable
        `transition(states (N, d), rng) -> states (N, d)`.
    log_likelihood : callable
        `log_likelihood(states (N, d)) -> (N,)`, of the observation at time k.
    rng : numpy.random.Generator
    scheme, threshold
        As in `resample`.

    Returns
    -------
    particles : Particles
        Posterior at time k.
    log_evidence : float
        log p(zₖ | z₁, ..., zₖ₋₁).

    Raises
    ------
    ZeroLikelihoodError
        As in `update`.
    """
    particles = resample(particles, rng, scheme, threshold)
    particles = predict(particles, transition, rng)
    return update(particles, log_likelihood(particles.states))


def roughen(states, rng, scale, extent=None):
    """Add jitter, so that copies made by resampling become different particles.

    Parameters
    ----------
    states : ndarray, shape (N, d)
    rng : numpy.random.Generator
    scale : float
        Gordon's tuning constant K.
    extent : array_like, shape (d,), optional
        E, the interval each column spans; the spread of `states` when left out.

    Returns
    -------
    ndarray, shape (N, d)
        states + normal jitter of standard deviation K E N^(-1/d). Angles may leave [-π, π) and positions the
        room: the caller knows what to do about it.

    References
    ----------
    Gordon, Salmond and Smith 1993, section 4.1.
    """
    n, d = states.shape
    if extent is None:
        extent = np.ptp(states, axis=0)
    # σ_i = K E_i N^{-1/d}
    deviation = scale * np.asarray(extent) * n ** (-1.0 / d)
    return states + deviation * rng.standard_normal((n, d))
