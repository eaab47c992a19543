"""Maps made of polygons: their walls, what is inside, how far the nearest wall is, and how far a disc can go.

A map is a number of rings, each a sequence of vertices (x, y) in metres whose last joins the first. A point is inside
when a ray from it crosses the walls an odd number of times: the outline is a ring, an obstacle a ring inside it, a hole
in an obstacle a ring inside that one. Rings may touch; they must not cross.
"""

import numpy as np
from numba import njit, types

_FLOAT = types.float64
_POINTS = types.float64[:, ::1]
_WALLS = types.float64[:, ::1]


def walls(rings):
    """The walls of a map.

    Parameters
    ----------
    rings : sequence of array_like, each of shape (V, 2)
        Vertices in metres, V ≥ 3.

    Returns
    -------
    ndarray, shape (S, 4)
        Rows x₀, y₀, x₁, y₁: from each vertex to the next, ring by ring.

    Raises
    ------
    ValueError
        A ring has fewer than three vertices, or one that is not a pair of finite numbers.
    """
    parts = [np.empty((0, 4))]
    for number, ring in enumerate(rings):
        vertices = np.asarray(ring, dtype=float)
        if vertices.ndim != 2 or vertices.shape[1:] != (2,) or len(vertices) < 3 or not np.isfinite(vertices).all():
            raise ValueError(f"ring {number} needs at least three vertices (x, y) of finite numbers, got {ring!r}")
        parts.append(np.hstack([vertices, np.roll(vertices, -1, axis=0)]))
    return np.ascontiguousarray(np.vstack(parts))


@njit(types.boolean(_FLOAT, _FLOAT, _WALLS), cache=True, inline="always")
def _encloses(x, y, walls):
    odd = False
    for j in range(len(walls)):
        ax, ay, bx, by = walls[j, 0], walls[j, 1], walls[j, 2], walls[j, 3]
        # Half-open in y: a vertex at the point's own height belongs to one of its two walls.
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            odd = not odd
    return odd


@njit(_FLOAT(_FLOAT, _FLOAT, _WALLS, types.int64), cache=True, inline="always")
def _square_distance(x, y, walls, j):
    ax, ay = walls[j, 0], walls[j, 1]
    ex, ey = walls[j, 2] - ax, walls[j, 3] - ay
    wx, wy = x - ax, y - ay
    square = ex * ex + ey * ey
    share = min(max((wx * ex + wy * ey) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return (wx - share * ex) ** 2 + (wy - share * ey) ** 2


@njit(types.boolean[::1](_POINTS, _WALLS), cache=True)
def inside(points, walls):
    """Which points are inside, by the even-odd rule.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Metres.
    walls : ndarray, shape (S, 4)
        As from `walls`.

    Returns
    -------
    ndarray of bool, shape (N,)
        A point on a wall may count as either.
    """
    result = np.empty(len(points), dtype=np.bool_)
    for i in range(len(points)):
        result[i] = _encloses(points[i, 0], points[i, 1], walls)
    return result


@njit(types.float64[::1](_POINTS, _WALLS), cache=True)
def clearance(points, walls):
    """Distance from each point to the nearest wall.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Metres.
    walls : ndarray, shape (S, 4)
        As from `walls`.

    Returns
    -------
    ndarray, shape (N,)
        Metres; `inf` when there is no wall.
    """
    result = np.empty(len(points))
    for i in range(len(points)):
        least = np.inf
        for j in range(len(walls)):
            least = min(least, _square_distance(points[i, 0], points[i, 1], walls, j))
        result[i] = np.sqrt(least)
    return result


@njit(types.boolean[::1](_POINTS, _WALLS, _FLOAT), cache=True)
def fits(points, walls, radius):
    """Where a disc can be: inside, and its radius away from every wall.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Centres, in metres.
    walls : ndarray, shape (S, 4)
        As from `walls`.
    radius : float
        Metres.

    Returns
    -------
    ndarray of bool, shape (N,)
        A disc that touches a wall fits, whatever rounding made of it, up to 1e-9 m.
    """
    result = np.empty(len(points), dtype=np.bool_)
    square = max(radius - 1e-9, 0.0) ** 2
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        clear = True
        for j in range(len(walls)):
            if _square_distance(x, y, walls, j) < square:
                clear = False
                break
        result[i] = clear and _encloses(x, y, walls)
    return result


@njit(_FLOAT(_FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _WALLS, _FLOAT), cache=True)
def reach(x, y, dx, dy, distance, walls, radius):
    """How far a disc can go in a straight line before it touches a wall.

    Parameters
    ----------
    x, y : float
        Its centre, in metres.
    dx, dy : float
        Its direction, a unit vector.
    distance : float
        As far as it wants to go, in metres; not negative.
    walls : ndarray, shape (S, 4)
        As from `walls`.
    radius : float
        Metres; 0 for a point.

    Returns
    -------
    float
        Between 0 and `distance`. A wall it touches already stops it only when it goes towards it: it may slide along,
        and leave.
    """
    margin = distance + radius
    for j in range(len(walls)):
        ax, ay, bx, by = walls[j, 0], walls[j, 1], walls[j, 2], walls[j, 3]
        if x < min(ax, bx) - margin or x > max(ax, bx) + margin or y < min(ay, by) - margin or y > max(ay, by) + margin:
            continue
        length = np.hypot(bx - ax, by - ay)
        wx, wy = x - ax, y - ay
        if length > 0.0:
            ex, ey = (bx - ax) / length, (by - ay) / length
            # Along the wall and away from it, the disc's centre and its velocity
            s, h = wx * ex + wy * ey, wy * ex - wx * ey
            ds, dh = dx * ex + dy * ey, dy * ex - dx * ey
            if h < 0.0:
                h, dh = -h, -dh
            if dh < 0.0:
                # h + t dh = r; at once where the disc is on the wall already
                t = max((h - radius) / -dh, 0.0)
                if t < distance and 0.0 <= s + t * ds <= length:
                    distance = t
        for _ in range(2):
            # |w + t d|² = r², the ends of the wall
            b, c = wx * dx + wy * dy, wx * wx + wy * wy - radius * radius
            if b < 0.0 and b * b >= c:
                distance = min(distance, max(-b - np.sqrt(b * b - c), 0.0))
            wx, wy = x - bx, y - by
    return distance
