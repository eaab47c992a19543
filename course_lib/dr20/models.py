"""Motion and measurement models of the DR20.

States are (N, 3) arrays with columns x, y, θ: metres and radians, in the map's frame, headings counter-clockwise from
the x-axis. Equation numbers are those of `solutions/02_dr20_localization.md`.
"""

import math

import numpy as np
from numba import njit, types

from course_lib.geometry.polygons import fits, reach
from course_lib.geometry.raycast import cast_fan

_FLOAT = types.float64
_COLUMN = types.float64[::1]
_ROWS = types.float64[:, ::1]

#: Draws for one free position, on average, after which a map is said to have none.
PATIENCE = 10_000


def prior(n, constants, rng):
    """Draw states at time 0: anywhere free within the square that `Constants` tells, with any heading.

    Parameters
    ----------
    n : int
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n, 3)

    Raises
    ------
    ValueError
        No free position was found.
    """
    near = np.asarray(constants.near)
    low = np.maximum(constants.bounds[:2], near - constants.within)
    high = np.minimum(constants.bounds[2:], near + constants.within)
    return _draw(n, low, high, constants, rng)


def anywhere(n, constants, rng):
    """Draw states anywhere free, with any heading: where a kidnapped robot may be. As `prior` otherwise."""
    return _draw(n, constants.bounds[:2], constants.bounds[2:], constants, rng)


def _draw(n, low, high, constants, rng):
    states = np.empty((n, 3))
    found = drawn = 0
    while found < n:
        if drawn > PATIENCE * n or not np.all(low <= high):
            raise ValueError(
                f"no free position found between ({low[0]:.3g}, {low[1]:.3g}) and ({high[0]:.3g}, {high[1]:.3g}) m "
                f"for a robot of radius {constants.radius:g} m: mend the map, or near and within"
            )
        # Most maps are more than half free: twice as many as are missing are mostly enough.
        candidates = rng.uniform(low, high, (2 * (n - found) + 8, 2))
        drawn += len(candidates)
        candidates = candidates[free(candidates, constants)][: n - found]
        states[found : found + len(candidates), :2] = candidates
        found += len(candidates)
    states[:, 2] = rng.uniform(-np.pi, np.pi, n)
    return states


def free(points, constants):
    """Where the robot can be: inside the room, outside every obstacle, no wall within its radius.

    Parameters
    ----------
    points : ndarray, shape (N, 2) or (N, 3)
        Positions in metres; further columns do not matter.
    constants : Constants

    Returns
    -------
    ndarray of bool, shape (N,)
    """
    return fits(np.ascontiguousarray(points[:, :2], dtype=float), constants.walls, constants.radius)


def transition(states, control, constants, rng):
    """Draw states one sampling time later.

    Parameters
    ----------
    states : ndarray, shape (N, 3)
    control : array_like, shape (2,)
        Commanded speed v in m/s and yaw rate ω in rad/s.
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (N, 3)
        Headings in [-π, π). A robot that meets a wall stops there; its heading goes on turning.
    """
    states = np.array(states, dtype=float, order="C")
    # v̂ = v + ε_v,  ω̂ = ω + ε_ω                                                                              (2)
    noise = rng.standard_normal((2, len(states)))
    noise[0] = control[0] + constants.sigma_v * noise[0]
    noise[1] = control[1] + constants.sigma_omega * noise[1]
    drive(states, noise[0], noise[1], constants.Ts, constants.walls, constants.radius)
    return states


@njit(_ROWS(_ROWS, _FLOAT, _ROWS), cache=True)
def _in_reach(states, margin, walls):
    """The walls that any of the robots may touch: those of a cloud in one spot are few."""
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for i in range(len(states)):
        low_x, high_x = min(low_x, states[i, 0]), max(high_x, states[i, 0])
        low_y, high_y = min(low_y, states[i, 1]), max(high_y, states[i, 1])
    kept, count = np.empty_like(walls), 0
    for j in range(len(walls)):
        if (
            max(walls[j, 0], walls[j, 2]) >= low_x - margin
            and min(walls[j, 0], walls[j, 2]) <= high_x + margin
            and max(walls[j, 1], walls[j, 3]) >= low_y - margin
            and min(walls[j, 1], walls[j, 3]) <= high_y + margin
        ):
            kept[count] = walls[j]
            count += 1
    return kept[:count]


@njit(types.void(_ROWS, _COLUMN, _COLUMN, _FLOAT, _ROWS, _FLOAT), cache=True)
def drive(states, speeds, yaw_rates, Ts, walls, radius):
    """Drive robots for one sampling time; changes `states` in place.

    Parameters
    ----------
    states : ndarray, shape (N, 3)
    speeds : ndarray, shape (N,)
        As executed, in m/s; negative is backwards.
    yaw_rates : ndarray, shape (N,)
        As executed, in rad/s.
    Ts : float
        Seconds.
    walls : ndarray, shape (S, 4)
    radius : float
        Of the robot, in metres.
    """
    near = _in_reach(states, np.abs(speeds).max() * Ts + radius if len(speeds) else 0.0, walls)
    for i in range(len(states)):
        half = 0.5 * yaw_rates[i] * Ts
        # An arc from θ to θ + ωT has the chord v T sin(ωT/2) / (ωT/2) along θ + ωT/2                             (1)
        chord = speeds[i] * Ts * (np.sin(half) / half if abs(half) > 1e-6 else 1.0)
        direction = states[i, 2] + half
        dx, dy = np.cos(direction), np.sin(direction)
        if chord < 0.0:
            chord, dx, dy = -chord, -dx, -dy
        chord = reach(states[i, 0], states[i, 1], dx, dy, chord, near, radius)
        states[i, 0] += chord * dx
        states[i, 1] += chord * dy
        heading = states[i, 2] + 2.0 * half
        states[i, 2] = heading - 2.0 * np.pi * np.floor((heading + np.pi) / (2.0 * np.pi))


def distances(states, constants):
    """What the beams of each robot would read, were they perfect: the distance to the first wall.

    Parameters
    ----------
    states : ndarray, shape (N, 3)
    constants : Constants

    Returns
    -------
    ndarray, shape (N, B)
        Metres, however far; `inf` where there is no wall.
    """
    if constants.mount:
        states = np.array(states, dtype=float)
        states[:, 0] += constants.mount * np.cos(states[:, 2])
        states[:, 1] += constants.mount * np.sin(states[:, 2])
    return cast_fan(states, np.asarray(constants.bearings), constants.walls)


def log_likelihood(observation, states, constants):
    """Log-likelihood of one scan for each state: the beam model, beams independent.

    Parameters
    ----------
    observation : array_like, shape (B,)
        Metres, or `inf`.
    states : ndarray, shape (N, 3)
    constants : Constants

    Returns
    -------
    ndarray, shape (N,)
        log p(z | x): of densities per metre for readings, of probabilities for those that are `inf`.
    """
    return beam_log_likelihood(
        np.ascontiguousarray(observation, dtype=float),
        distances(states, constants),
        constants.sigma,
        constants.r_max,
        constants.p_short,
        constants.rate_short,
        constants.p_miss,
        constants.p_random,
    )


@njit(_COLUMN(_COLUMN, _ROWS, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT), cache=True)
def beam_log_likelihood(readings, expected, sigma, r_max, p_short, rate_short, p_miss, p_random):
    """The beam model for distances that are known.

    Parameters
    ----------
    readings : ndarray, shape (B,)
    expected : ndarray, shape (N, B)
        Distances to the first wall, in metres.
    sigma, r_max, p_short, rate_short, p_miss, p_random : float
        As in `Constants`.

    Returns
    -------
    ndarray, shape (N,)

    References
    ----------
    S. Thrun, W. Burgard, D. Fox, *Probabilistic Robotics*, MIT Press 2005, sec. 6.3.
    """
    p_hit = 1.0 - p_short - p_miss - p_random
    peak = p_hit / (sigma * np.sqrt(2.0 * np.pi))
    beyond = np.exp(-rate_short * r_max)
    # What does not depend on the particle: the reading uniform, and the reading short but for its normalisation.
    anywhere, before = np.zeros(len(readings)), np.zeros(len(readings))
    for b in range(len(readings)):
        if 0.0 <= readings[b] <= r_max:
            anywhere[b] = p_random / r_max
            before[b] = p_short * rate_short * np.exp(-rate_short * readings[b])
    result = np.empty(len(expected))
    for i in range(len(expected)):
        likelihood, log_scale, deviation = 1.0, 0.0, 0.0
        for b in range(len(readings)):
            z, d = readings[b], expected[i, b]
            if z < np.inf:
                # p(z | d) = p_hit N(z; d, σ²) + p_short λ e^{-λz} / (1 - e^{-λd}) [0 ≤ z ≤ d] + p_random / r_max  (5)
                deviation = (z - d) / sigma
                p = peak * np.exp(-0.5 * deviation * deviation) + anywhere[b]
                if before[b] > 0.0 and z <= d and d > 0.0:
                    p += before[b] / (1.0 - np.exp(-rate_short * d))
            else:
                # P(∞ | d) = p_miss + p_hit Φ((d - r_max) / σ) + p_short P(short and beyond r_max)                 (6)
                p = p_miss + p_hit * 0.5 * math.erfc((r_max - d) / (sigma * np.sqrt(2.0)))
                if p_short > 0.0 and d > r_max:
                    p += p_short * (beyond - np.exp(-rate_short * d)) / (1.0 - np.exp(-rate_short * d))
            # A product of many small densities would underflow; one logarithm for several of them is enough.
            if p < 1e-280 and z < np.inf:
                # Nor is a reading impossible that is 40 σ off: so far away, particles must still differ.
                log_scale += np.log(peak) - 0.5 * deviation * deviation
            elif p < 1e-100:
                log_scale += np.log(p)
            else:
                likelihood *= p
            if likelihood < 1e-200:
                log_scale += np.log(likelihood)
                likelihood = 1.0
        result[i] = log_scale + np.log(likelihood)
    return result


def read(distances, constants, rng):
    """Draw what the beams read at given distances.

    Parameters
    ----------
    distances : ndarray, shape (..., B)
        To the first wall, in metres.
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, of the same shape
        Metres; `inf` for what is missed or too far.
    """
    kind, position = rng.random((2, *distances.shape))
    # The inverse of (1 - e^{-λz}) / (1 - e^{-λd})
    short = -np.log1p(position * np.expm1(-constants.rate_short * distances)) / constants.rate_short
    readings = distances + constants.sigma * rng.standard_normal(distances.shape)
    edges = np.cumsum([constants.p_short, constants.p_miss, constants.p_random])
    readings = np.where(kind < edges[2], constants.r_max * position, readings)
    readings = np.where(kind < edges[1], np.inf, readings)
    readings = np.where(kind < edges[0], short, readings)
    return np.where(readings > constants.r_max, np.inf, readings)
