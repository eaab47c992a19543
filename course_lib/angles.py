"""Angles: the one place where they are wrapped and averaged."""

import numpy as np


def wrap(angle):
    """Wrap angles to [-π, π).

    Parameters
    ----------
    angle : array_like
        Angles in radians, any shape, finite.

    Returns
    -------
    ndarray or float
        The same angles modulo 2π, of the same shape.
    """
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def circular_mean(angle, weights, axis=0):
    """Direction of the weighted mean of unit vectors.

    Parameters
    ----------
    angle : array_like, shape (N, ...)
        Angles in radians.
    weights : array_like, shape (N,)
        Non-negative weights; they need not be normalised.
    axis : int
        The axis of `angle` that the weights belong to.

    Returns
    -------
    ndarray or float
        Mean direction in [-π, π]. Where the unit vectors cancel (opposite headings in equal shares) the
        direction carries no information; it is then whatever rounding leaves.

    References
    ----------
    K. V. Mardia, P. E. Jupp, *Directional Statistics*, Wiley 2000, eq. (2.2.4).
    """
    angle = np.moveaxis(np.asarray(angle, dtype=float), axis, -1)
    return np.arctan2(np.sin(angle) @ weights, np.cos(angle) @ weights)
