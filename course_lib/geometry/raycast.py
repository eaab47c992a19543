"""How far it is along a ray to the nearest wall: exactly, for many rays and some dozens of walls.

A ray o + t u meets the wall from a to b at t = (p × q) / (u × q - u × p), where p = a - o and q = b - o, if u × p and
u × q have opposite signs. These signs alone decide about ends, and two walls that share one compute its sign from the
same numbers: no ray slips between them. p × q is the same for all rays of an origin, so what is left of a ray and a
wall is two products, their signs, and the larger of two 1 / t. Of a wall seen end-on, where t is one rounding error by
another, or 0 / 0, the ray meets the point interpolated between the ends.
"""

import math

import numba
import numpy as np
from numba import njit

#: An origin this near to a wall, in metres, is on it.
ON_WALL = 1e-12

#: A wall whose p × q is at most this part of p² + q² is seen end-on.
_END_ON = 1e-6

#: A component of a direction that is smaller is none: cos(π/2) is 6e-17, and the ray along a wall would miss it.
_ROUNDING = 1e-15

#: Poses that a thread takes at a time.
_BLOCK = 512


def cast(origins, angles, walls, limit=np.inf):
    """Ranges along rays of any directions.

    Parameters
    ----------
    origins : ndarray, shape (N, 2)
        Where the rays start, in metres.
    angles : ndarray, shape (N, B)
        World-frame directions of each origin's rays, in radians, counter-clockwise from x.
    walls : ndarray, shape (S, 4)
        Closed segments x0, y0, x1, y1, in metres. Walls of no length are points.
    limit : float
        The largest range, in metres.

    Returns
    -------
    ndarray, shape (N, B)
        Metres to the nearest wall; inf where there is none within `limit`, 0 from an origin on a wall. A ray along a
        wall meets its nearest point.

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite, or `limit` is not a number >= 0.
    """
    origins, angles, walls = (
        finite_rows(origins, 2, "origins"),
        finite_rows(angles, None, "angles"),
        finite_rows(walls, 4, "walls"),
    )
    if len(angles) != len(origins):
        raise ValueError(f"angles: {len(angles)} rows, origins: {len(origins)}; each origin needs a row of angles")
    ranges = np.empty(angles.shape)
    cast_into(origins, angles, walls, _limit(limit), ranges)
    return ranges


def cast_fan(poses, bearings, walls, limit=np.inf, parallel=False):
    """Ranges along the same bearings from many poses.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
        x, y and heading: metres and radians.
    bearings : ndarray, shape (B,)
        Directions of the rays from the heading, in radians, counter-clockwise.
    walls, limit
        As of `cast`.
    parallel : bool
        Whether to use all threads that numba has.

    Returns
    -------
    ndarray, shape (N, B)
        As of `cast`.

    Raises
    ------
    ValueError
        As of `cast`.
    """
    poses, bearings, walls = (
        finite_rows(poses, 3, "poses"),
        finite_rows(np.asarray(bearings)[None], None, "bearings")[0],
        finite_rows(walls, 4, "walls"),
    )
    ranges = np.empty((len(poses), len(bearings)))
    kernel = _fan_parallel if parallel else fan_into
    kernel(poses, bearings, walls, _limit(limit), ranges)
    return ranges


def finite_rows(values, columns, name):
    """`values` as C-ordered float64 of so many columns (None: any), or a ValueError that calls it `name`."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or columns not in (None, array.shape[1]):
        raise ValueError(f"{name}: shape {array.shape} must be (any number, {columns or 'any number'})")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: row {np.flatnonzero(~np.isfinite(array).all(axis=1))[0]} is not finite")
    return array


def _limit(limit):
    if not limit >= 0.0:
        raise ValueError(f"limit: {limit} must be a range in metres, 0 or more")
    return float(limit)


@njit("float64(float64)", cache=True)
def _rounded(component):
    return 0.0 if abs(component) < _ROUNDING else component


@njit(
    "int64(float64, float64, float64[:, ::1], float64[:, ::1])",
    error_model="numpy",
    cache=True,
)
def _seen_from(x, y, corners, view):
    """Fill `view` with p, q (in the order in which p × q > 0) and 1 / (p × q) of each wall; count those seen end-on."""
    end_on = 0
    for i in range(view.shape[1]):
        px, py = corners[0, i] - x, corners[1, i] - y
        qx, qy = corners[2, i] - x, corners[3, i] - y
        cross = px * qy - py * qx
        turned = cross < 0.0
        view[0, i] = qx if turned else px
        view[1, i] = qy if turned else py
        view[2, i] = px if turned else qx
        view[3, i] = py if turned else qy
        cross = abs(cross)
        inverse = 1.0 / cross
        small = cross <= _END_ON * (px * px + py * py + qx * qx + qy * qy)
        view[4, i] = 0.0 if small else inverse
        end_on += 1 if small else 0
    return end_on


@njit("float64(float64, float64, float64[:, ::1])", cache=True)
def _nearness(ux, uy, view):
    """1 / t of the nearest wall that is not seen end-on; 0 where there is none."""
    # The bits of floats >= 0 sort as the floats do. Without fast-math, LLVM vectorises the largest of integers only.
    nearest = np.int64(0)
    for i in range(view.shape[1]):
        p = ux * view[1, i] - uy * view[0, i]
        q = ux * view[3, i] - uy * view[2, i]
        nearness = (q - p) * view[4, i]
        bits = np.float64(nearness if (p <= 0.0) & (q >= 0.0) else 0.0).view(np.int64)
        nearest = bits if bits > nearest else nearest
    return np.int64(nearest).view(np.float64)


@njit("boolean(float64[:, ::1], int64[::1])", cache=True)
def _on_wall(view, end_on):
    """Whether the origin is on one of the walls that it sees end-on, whose indices are given."""
    for i in end_on:
        px, py, qx, qy = view[0, i], view[1, i], view[2, i], view[3, i]
        if px * qx + py * qy <= 0.0 and abs(px * qy - py * qx) <= ON_WALL * math.hypot(qx - px, qy - py):
            return True
        if min(math.hypot(px, py), math.hypot(qx, qy)) <= ON_WALL:
            return True
    return False


@njit("float64(float64, float64, float64[:, ::1], int64[::1])", cache=True)
def _end_on_range(ux, uy, view, end_on):
    """Metres to the nearest of the walls seen end-on, by interpolation between the two ends."""
    nearest = math.inf
    for i in end_on:
        p = ux * view[1, i] - uy * view[0, i]
        q = ux * view[3, i] - uy * view[2, i]
        if min(p, q) <= 0.0 <= max(p, q):
            along_p = ux * view[0, i] + uy * view[1, i]
            along_q = ux * view[2, i] + uy * view[3, i]
            t = (q * along_p - p * along_q) / (q - p) if p != q else min(along_p, along_q)
            if t >= 0.0:
                nearest = min(nearest, t)
    return nearest


@njit(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64, float64[:, ::1])", error_model="numpy", cache=True
)
def cast_into(origins, angles, walls, limit, ranges):
    """`cast` for other kernels: fills `ranges`, shape (N, B), and checks nothing."""
    corners, view = np.ascontiguousarray(walls.T), np.empty((5, len(walls)))
    end_on = np.empty(len(walls), dtype=np.int64)
    for n in range(len(origins)):
        count = _seen_from(origins[n, 0], origins[n, 1], corners, view)
        if count > 0:
            end_on[:count] = np.flatnonzero(view[4] == 0.0)
            if _on_wall(view, end_on[:count]):
                ranges[n] = 0.0
                continue
        for k in range(angles.shape[1]):
            ux, uy = _rounded(math.cos(angles[n, k])), _rounded(math.sin(angles[n, k]))
            t = 1.0 / _nearness(ux, uy, view)
            if count > 0:
                t = min(t, _end_on_range(ux, uy, view, end_on[:count]))
            ranges[n, k] = t if t <= limit else math.inf


@njit("void(float64[:, ::1], float64[::1], float64[:, ::1], float64, float64[:, ::1])", error_model="numpy", cache=True)
def fan_into(poses, bearings, walls, limit, ranges):
    """`cast_fan` for other kernels: fills `ranges`, shape (N, B), and checks nothing."""
    corners, view = np.ascontiguousarray(walls.T), np.empty((5, len(walls)))
    end_on = np.empty(len(walls), dtype=np.int64)
    cosines, sines = np.cos(bearings), np.sin(bearings)
    for n in range(len(poses)):
        count = _seen_from(poses[n, 0], poses[n, 1], corners, view)
        if count > 0:
            end_on[:count] = np.flatnonzero(view[4] == 0.0)
            if _on_wall(view, end_on[:count]):
                ranges[n] = 0.0
                continue
        c, s = math.cos(poses[n, 2]), math.sin(poses[n, 2])
        for k in range(len(bearings)):
            ux, uy = _rounded(c * cosines[k] - s * sines[k]), _rounded(s * cosines[k] + c * sines[k])
            t = 1.0 / _nearness(ux, uy, view)
            if count > 0:
                t = min(t, _end_on_range(ux, uy, view, end_on[:count]))
            ranges[n, k] = t if t <= limit else math.inf


@njit(parallel=True, cache=True)
def _fan_parallel(poses, bearings, walls, limit, ranges):
    for block in numba.prange((len(poses) + _BLOCK - 1) // _BLOCK):
        rows = slice(block * _BLOCK, min(len(poses), (block + 1) * _BLOCK))
        fan_into(poses[rows], bearings, walls, limit, ranges[rows])
