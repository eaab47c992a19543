"""Two independent ways to cast rays: NumPy broadcasting, and shapely."""

import numpy as np
import shapely

from course_lib.geometry.raycast import ON_WALL


def directions(angles):
    """Unit vectors, shape (..., 2), exact at multiples of 90°."""
    u = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.where(np.abs(u) < 1e-15, 0.0, u)


def cast(origins, angles, walls, limit=np.inf):
    """`raycast.cast`, with every pair's t interpolated between the ends of the wall."""
    u = directions(angles)[:, :, None, :]
    p = (walls[None, :, :2] - origins[:, None, :])[:, None]
    q = (walls[None, :, 2:] - origins[:, None, :])[:, None]
    side_p, side_q = _cross(u, p), _cross(u, q)
    along_p, along_q = (u * p).sum(axis=-1), (u * q).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = (side_q * along_p - side_p * along_q) / (side_q - side_p)
    t = np.where(side_p == side_q, np.minimum(along_p, along_q), t)
    between = np.minimum(side_p, side_q) * np.maximum(side_p, side_q) <= 0.0
    length = np.hypot(*(q - p).T).T
    on_wall = ((p * q).sum(axis=-1) <= 0.0) & (np.abs(_cross(p, q)) <= ON_WALL * length)
    on_wall |= np.minimum(np.hypot(*p.T).T, np.hypot(*q.T).T) <= ON_WALL
    t = np.where(on_wall, 0.0, np.where(between & (t >= 0.0), t, np.inf))
    t = t.min(axis=-1, initial=np.inf)
    return np.where(t <= limit, t, np.inf)


def cast_with_shapely(origins, angles, walls, reach=100.0):
    """`raycast.cast` up to `reach`, wall by wall."""
    ends = origins[:, None, :] + reach * directions(angles)
    rays = shapely.linestrings(np.stack([np.broadcast_to(origins[:, None, :], ends.shape), ends], axis=2))
    points = shapely.points(origins)
    nearest = np.full(angles.shape, np.inf)
    for x0, y0, x1, y1 in walls:
        wall = shapely.LineString([(x0, y0), (x1, y1)]) if (x0, y0) != (x1, y1) else shapely.Point(x0, y0)
        distances = shapely.distance(points[:, None], shapely.intersection(rays, wall))
        nearest = np.fmin(nearest, distances)
    return nearest


def naive(origins, angles, walls):
    """What one writes first: solve for t and s, keep 0 <= s <= 1. Rays slip between walls that share an end."""
    u = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, :, None, :]
    e = (walls[:, 2:] - walls[:, :2])[None, None]
    p = (walls[None, :, :2] - origins[:, None, :])[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        t, s = _cross(p, e) / _cross(u, e), _cross(p, u) / _cross(u, e)
    return np.where((t >= 0.0) & (s >= 0.0) & (s <= 1.0), t, np.inf).min(axis=-1, initial=np.inf)


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
