"""The kernels of the DR20's models, written with arrays."""

import numpy as np
from scipy.special import erfc

from course_lib.angles import wrap


def beam_log_likelihood_numpy(readings, expected, constants):
    """`models.beam_log_likelihood`."""
    c, z, d = constants, np.asarray(readings), np.asarray(expected)
    p_hit = 1.0 - c.p_short - c.p_miss - c.p_random
    finite = np.where(np.isfinite(z), z, 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        truncated = -np.expm1(-c.rate_short * d)
        log_hit = np.log(p_hit / (c.sigma * np.sqrt(2.0 * np.pi))) - 0.5 * ((finite - d) / c.sigma) ** 2
        short = c.p_short * c.rate_short * np.exp(-c.rate_short * finite) / truncated
        short = np.where((finite >= 0.0) & (finite <= d), short, 0.0)
        other = short + np.where((finite >= 0.0) & (finite <= c.r_max), c.p_random / c.r_max, 0.0)
        log_read = np.logaddexp(log_hit, np.log(other))
        beyond = np.exp(-c.rate_short * c.r_max) - np.exp(-c.rate_short * d)
        missed = p_hit * 0.5 * erfc((c.r_max - d) / (c.sigma * np.sqrt(2.0)))
        missed = c.p_miss + missed + np.where(d > c.r_max, c.p_short * beyond / truncated, 0.0)
        return np.where(np.isfinite(z), log_read, np.log(missed)).sum(axis=1)


def drive_numpy(states, speeds, yaw_rates, Ts, walls, radius):
    """`models.drive`, but returns the states."""
    turned = yaw_rates * Ts
    chord = speeds * Ts * np.sinc(0.5 * turned / np.pi)
    direction = states[:, 2] + 0.5 * turned
    unit = np.sign(chord)[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    went = reach_numpy(states[:, :2], unit, np.abs(chord), walls, radius)
    return np.column_stack([states[:, :2] + went[:, None] * unit, wrap(states[:, 2] + turned)])


def reach_numpy(points, units, distances, walls, radius):
    """`geometry.polygons.reach` of many discs."""
    a, b = walls[None, :, :2], walls[None, :, 2:]
    length = np.linalg.norm(b - a, axis=2)
    along = (b - a) / length[..., None]
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    p, u = points[:, None], units[:, None]
    h = ((p - a) * across).sum(axis=2)
    dh = np.where(h < 0.0, -1.0, 1.0) * (u * across).sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.maximum((np.abs(h) - radius) / -dh, 0.0)
        s = ((p + t[..., None] * u - a) * along).sum(axis=2)
        candidates = [np.where((dh < 0.0) & (s >= 0.0) & (s <= length), t, np.inf)]
        for end in (a, b):
            dot, square = ((p - end) * u).sum(axis=2), ((p - end) ** 2).sum(axis=2) - radius**2
            t = np.maximum(-dot - np.sqrt(dot**2 - square), 0.0)
            candidates.append(np.where((dot < 0.0) & (dot**2 >= square), t, np.inf))
    return np.minimum(distances, np.min(candidates, axis=(0, 2)))
