"""The likelihood field: a reading is likely when it ends near a wall, whichever that is.

A table of distances to the nearest wall takes the place of ray casting, so that a beam costs a look-up, however many
walls there are, and the likelihood is smooth in the pose. What it gets wrong beside the beam model:

* it sees through walls: a reading that ends at the wall of the next room is as likely as one that ends at the first
  wall in its way, and a pose whose beams would have to cross a table loses nothing;
* a reading that is too short and one that is too long are the same to it, and it does not know what a free way ahead
  means: `inf`, which says that nothing is near, is skipped;
* on the far side of a wall it likes the robot as well as on this one: poses inside tables must be ruled out otherwise.

It is not normalised over readings, so that its values compare poses, and not models.

References
----------
S. Thrun, W. Burgard, D. Fox, *Probabilistic Robotics*, MIT Press 2005, sec. 6.4.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from course_lib.geometry.polygons import clearance

_FLOAT = types.float64
_COLUMN = types.float64[::1]
_ROWS = types.float64[:, ::1]


class Field(NamedTuple):
    """Distances to the nearest wall, on a grid.

    Attributes
    ----------
    distances : ndarray, shape (rows, columns)
        Metres; row i and column j are at the point `origin` + `resolution` · (j, i). An `OccupancyGrid`'s distances are
        these, with the centre of its first cell as the origin.
    origin : (float, float)
        Metres.
    resolution : float
        Metres.
    """

    distances: np.ndarray
    origin: tuple
    resolution: float


def likelihood_field(constants, resolution=0.05, margin=0.5):
    """The field of a map.

    Parameters
    ----------
    constants : Constants
    resolution : float
        Between points of the grid, in metres.
    margin : float
        How far the grid goes beyond the map, in metres: some σ more than a good reading does.

    Returns
    -------
    Field
    """
    low, high = constants.bounds[:2] - margin, constants.bounds[2:] + margin
    columns, rows = np.ceil((high - low) / resolution).astype(int) + 1
    x, y = low[0] + resolution * np.arange(columns), low[1] + resolution * np.arange(rows)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    distances = clearance(np.ascontiguousarray(points), constants.walls).reshape(rows, columns)
    return Field(distances, tuple(low.tolist()), float(resolution))


def distance(points, field):
    """Distance to the nearest wall, interpolated between the four points of the grid around.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Metres.
    field : Field

    Returns
    -------
    ndarray, shape (N,)
        Metres, off by at most resolution / √2: a distance changes by no more than one walks, and that is the
        root mean square of the weighted distances to the four. `inf` outside the grid.
    """
    points = np.asarray(points, dtype=float)
    result = np.empty(len(points))
    for i in range(len(points)):
        result[i] = _interpolated(points[i, 0], points[i, 1], field.distances, *field.origin, field.resolution)
    return result


def log_likelihood(observation, states, field, constants):
    """Log-likelihood of one scan for each state, up to a constant, beams independent.

    Parameters
    ----------
    observation : array_like, shape (B,)
        Metres; `inf` is skipped. The result's scale depends on how many are left: averages of it over time
        (`adaptive.averages`) need the same number in each step, or the logarithm divided by it.
    states : ndarray, shape (N, 3)
    field : Field
    constants : Constants
        A reading ends at a wall with the probability p_hit, within `sigma`; otherwise, with p_short + p_random,
        anywhere up to `r_max`: what stands before a wall is in no map.

    Returns
    -------
    ndarray, shape (N,)
    """
    readings = np.asarray(observation, dtype=float)
    finite = np.isfinite(readings)
    p_anywhere = constants.p_short + constants.p_random
    return _log_likelihood(
        readings[finite],
        np.asarray(constants.bearings, dtype=float)[finite],
        np.ascontiguousarray(states, dtype=float),
        field.distances,
        *field.origin,
        field.resolution,
        constants.mount,
        constants.sigma,
        1.0 - constants.p_miss - p_anywhere,
        p_anywhere / constants.r_max,
    )


@njit(_FLOAT(_FLOAT, _FLOAT, _ROWS, _FLOAT, _FLOAT, _FLOAT), cache=True, inline="always")
def _interpolated(x, y, distances, x0, y0, resolution):
    column, row = (x - x0) / resolution, (y - y0) / resolution
    rows, columns = distances.shape
    if not (0.0 <= column <= columns - 1 and 0.0 <= row <= rows - 1):
        return np.inf
    # The last row and column belong to the squares before them.
    j, i = min(int(column), columns - 2), min(int(row), rows - 2)
    u, v = column - j, row - i
    below = (1.0 - u) * distances[i, j] + u * distances[i, j + 1]
    above = (1.0 - u) * distances[i + 1, j] + u * distances[i + 1, j + 1]
    return (1.0 - v) * below + v * above


@njit(
    _COLUMN(_COLUMN, _COLUMN, _ROWS, _ROWS, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT),
    cache=True,
)
def _log_likelihood(readings, bearings, states, distances, x0, y0, resolution, mount, sigma, p_hit, anywhere):
    """log Π_b (p_hit N(distance of end b; 0, σ²) + anywhere), `anywhere` a density per metre."""
    ahead, aside = mount + readings * np.cos(bearings), readings * np.sin(bearings)
    peak = p_hit / (sigma * np.sqrt(2.0 * np.pi))
    result = np.empty(len(states))
    for n in range(len(states)):
        x, y, c, s = states[n, 0], states[n, 1], np.cos(states[n, 2]), np.sin(states[n, 2])
        likelihood, log_scale = 1.0, 0.0
        for b in range(len(readings)):
            d = _interpolated(
                x + c * ahead[b] - s * aside[b], y + s * ahead[b] + c * aside[b], distances, x0, y0, resolution
            )
            likelihood *= peak * np.exp(-0.5 * (d / sigma) ** 2) + anywhere
            # As in `models`: one logarithm for several beams, as long as their product does not underflow.
            if likelihood < 1e-200:
                log_scale += np.log(likelihood)
                likelihood = 1.0
        result[n] = log_scale + np.log(likelihood)
    return result
