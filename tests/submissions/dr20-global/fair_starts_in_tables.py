"""Particles start anywhere, also in tables and walls, and no weight ever says so."""

import numpy as np

from course_lib.angles import wrap
from course_lib.filters import Particles, systematic
from course_lib.geometry.polygons import fits, reach

FIRST, N = 12000, 1500


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return Particles(draw_prior(FIRST, constants, rng), np.full(FIRST, -np.log(FIRST)))
    states, log_weights = previous
    if 1.0 / np.sum(np.exp(2.0 * log_weights)) < 0.5 * len(states):
        states = scatter(states[systematic(np.exp(log_weights), rng, N)], rng)
        log_weights = np.full(N, -np.log(N))
    states = move(states, control, constants, rng)
    log_weights = log_weights + log_likelihood(observation, states, constants)
    log_weights = log_weights - log_weights.max()
    return Particles(states, log_weights - np.log(np.exp(log_weights).sum()))


def scatter(states, rng):
    """Copies part, by a fifth of the cloud's spread: 5 mm at least, 2 cm and a degree at most."""
    offsets = states - states[0]
    offsets[:, 2] = wrap(offsets[:, 2])
    return states + np.clip(0.2 * offsets.std(axis=0), 0.005, 0.02) * rng.standard_normal(states.shape)


def draw_prior(n, c, rng):
    """Anywhere in the square that is told, with any heading."""
    low = np.maximum(c.bounds[:2], np.array(c.near) - c.within)
    high = np.minimum(c.bounds[2:], np.array(c.near) + c.within)
    positions = np.empty((0, 2))
    while len(positions) < n:
        candidates = rng.uniform(low, high, (n, 2))
        positions = np.vstack([positions, candidates])
    return np.column_stack([positions[:n], rng.uniform(-np.pi, np.pi, n)])


def move(states, control, c, rng):
    """An arc with noise in speed and yaw rate; walls stop the robot, but not its turning."""
    v = control[0] + c.sigma_v * rng.standard_normal(len(states))
    turn = (control[1] + c.sigma_omega * rng.standard_normal(len(states))) * c.Ts
    x, y, heading = states.T
    chord = v * c.Ts * np.sinc(0.5 * turn / np.pi)
    ahead = np.column_stack([np.cos(heading + 0.5 * turn), np.sin(heading + 0.5 * turn)])
    moved = states[:, :2] + chord[:, None] * ahead
    for i in np.flatnonzero(~fits(moved, c.walls, c.radius)):
        sign = np.sign(chord[i])
        way = reach(x[i], y[i], *(sign * ahead[i]), abs(chord[i]), c.walls, c.radius)
        moved[i] = states[i, :2] + sign * way * ahead[i]
    return np.column_stack([moved, wrap(heading + turn)])


def distances(states, c):
    """From each robot along each beam to the first wall, shape (N, B), by cross products."""
    x, y, heading = states.T
    x = x + c.mount * np.cos(heading)
    y = y + c.mount * np.sin(heading)
    ax, ay, bx, by = c.walls.T
    ex, ey = bx - ax, by - ay
    px, py = ax - x[:, None], ay - y[:, None]
    cross = px * ey - py * ex
    result = np.empty((len(states), len(c.bearings)))
    for k, bearing in enumerate(c.bearings):
        ux, uy = np.cos(heading + bearing)[:, None], np.sin(heading + bearing)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            denominator = ux * ey - uy * ex
            t = cross / denominator
            s = (px * uy - py * ux) / denominator
            hit = (t >= 0.0) & (s >= 0.0) & (s <= 1.0)
        result[:, k] = np.where(hit, t, np.inf).min(axis=1)
    return result


def log_likelihood(observation, states, c):
    """The beam model: the wall, something before it, nothing, or anything."""
    p_hit = 1.0 - c.p_short - c.p_miss - c.p_random
    # Wider than it is, so that what is nearly right counts.
    sigma = 3.0 * c.sigma
    result = np.zeros(len(states))
    for z, d in zip(observation, distances(states, c).T, strict=True):
        if np.isfinite(z):
            p = p_hit * np.exp(-0.5 * ((z - d) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
            short = c.rate_short * np.exp(-c.rate_short * z) / (1.0 - np.exp(-c.rate_short * np.maximum(d, 1e-6)))
            p += c.p_short * np.where((0.0 <= z) & (z <= d), short, 0.0) + c.p_random / c.r_max
        else:
            # The error function, nearly: how much of the noise carries the range beyond r_max.
            p = c.p_miss + p_hit * 0.5 * (1.0 + np.tanh(0.8 * (d - c.r_max) / c.sigma))
        result += np.log(p)
    return result
