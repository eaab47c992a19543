"""The listing of the report behind the exercise, loop by loop in plain Python: the baseline of speed.

It walks along the half-metre lines of its own map, and works on no other; `source` does the same to arrays, on any. Its
averages are arguments here, and its random numbers come from a Generator.

References
----------
X. Bu, J. Song, report on homework 3 of AI3603, Shanghai Jiao Tong University, 2021: sections II.B and IV.A.
"""

import math
from typing import NamedTuple

import numpy as np

#: Where a ray ends that meets nothing: the search returns this point.
NOWHERE = (100.0, 100.0)


class Lines(NamedTuple):
    """A map as the listing keeps it: for each half-metre line, the intervals of it that are walls.

    Attributes
    ----------
    x : dict of float to list of (float, float)
        Of the line at this x, intervals of y.
    y : dict of float to list of (float, float)
    size : (float, float)
        Of the room, whose corner is the origin.
    """

    x: dict
    y: dict
    size: tuple


def half_metre_lines(constants):
    """The `Lines` of a map.

    Parameters
    ----------
    constants : Constants

    Returns
    -------
    Lines

    Raises
    ------
    ValueError
        A wall is not on a half-metre line, or the room's corner is not the origin.
    """
    doubled = 2.0 * constants.walls
    straight = (doubled[:, 0] == doubled[:, 2]) | (doubled[:, 1] == doubled[:, 3])
    if np.any(doubled != np.round(doubled)) or not straight.all() or np.any(constants.bounds[:2] != 0.0):
        raise ValueError("the listing needs walls along half-metre lines and a room from (0, 0): use `estimator`")
    size = constants.bounds[2:]
    lines = [{0.5 * k: [] for k in range(int(2 * extent) + 1)} for extent in size]
    for x0, y0, x1, y1 in constants.walls.tolist():
        if x0 == x1:
            lines[0][x0].append((min(y0, y1), max(y0, y1)))
        else:
            lines[1][y0].append((min(x0, x1), max(x0, x1)))
    return Lines(*lines, tuple(size.tolist()))


def detect_obstacles(x, y, theta, lines):
    """Distances along the five beams, in metres.

    Parameters
    ----------
    x, y, theta : float
        Exact inside the room, within a table too. Up to half a metre outside it a ray that leads away from the room
        meets the wall behind it, because int() rounds towards zero.
    lines : Lines

    Returns
    -------
    ndarray, shape (5,)
    """
    return np.array([_closest_obstacle(x, y, _mod2pi(theta + i * math.pi / 4), lines) for i in range(-2, 3)])


def _closest_obstacle(x, y, theta, lines):
    x1, y1 = _closest_x_obstacle(x, y, theta, lines)
    distance1 = math.sqrt((x1 - x) ** 2 + (y1 - y) ** 2)
    x2, y2 = _closest_y_obstacle(x, y, theta, lines)
    distance2 = math.sqrt((x2 - x) ** 2 + (y2 - y) ** 2)
    return distance1 if distance1 < distance2 else distance2


def _closest_x_obstacle(x, y, theta, lines):
    k = math.tan(theta)
    right = math.cos(theta) > 0.0
    pos_x = int(x * 2 + 1) / 2.0 if right else int(x * 2) / 2.0
    while 0 <= pos_x <= lines.size[0]:
        pos_y = y + k * (pos_x - x)
        for low, high in lines.x[pos_x]:
            if low <= pos_y <= high:
                return pos_x, pos_y
        pos_x += 0.5 if right else -0.5
    return NOWHERE


def _closest_y_obstacle(x, y, theta, lines):
    # 1 / tan θ, which is finite for a ray along x
    k = math.tan(math.pi / 2 - theta)
    up = math.sin(theta) > 0.0
    pos_y = int(y * 2 + 1) / 2.0 if up else int(y * 2) / 2.0
    while 0 <= pos_y <= lines.size[1]:
        pos_x = x + k * (pos_y - y)
        for low, high in lines.y[pos_y]:
            if low <= pos_x <= high:
                return pos_x, pos_y
        pos_y += 0.5 if up else -0.5
    return NOWHERE


def _mod2pi(theta):
    return (theta + math.pi) % (2 * math.pi) - math.pi


def _motion_model(pose, u, Ts):
    heading = pose[2, 0]
    B = np.array([[Ts * math.cos(heading), 0.0], [Ts * math.sin(heading), 0.0], [0.0, Ts]])
    return pose + B @ u


def pf_localization(px, pw, w_slow, w_fast, data, u, lines, constants, rng):
    """The listing's update, one particle after the other.

    Parameters
    ----------
    px : ndarray, shape (3, N)
    pw : ndarray, shape (1, N)
        Weights, which only the sum inside the loop still sees.
    w_slow, w_fast : float
        Running averages of the weights; the listing starts them at zero.
    data : array_like, shape (5,)
        The scan in metres.
    u : array_like, shape (2,)
        Commanded v (m/s) and ω (rad/s).
    lines : Lines
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    x_est : ndarray, shape (3,)
        Weighted mean, the heading's too.
    px : ndarray, shape (3, N)
        Resampled.
    pw : ndarray, shape (1, N)
        The weights of the particles before they were resampled.
    w_slow, w_fast : float

    Raises
    ------
    ValueError
        A particle explains the scan to the last digit, so that its weight 1 / 0 is infinite: "probabilities contain
        NaN", as in the listing.
    """
    NP = px.shape[1]
    px, pw = px.copy(), pw.copy()
    data = np.minimum(data, constants.r_max)
    with np.errstate(divide="ignore", invalid="ignore"):
        for ip in range(NP):
            ud = np.reshape(u, (2, 1)) + rng.standard_normal((2, 1)) * [[constants.sigma_v], [constants.sigma_omega]]
            px[:, ip] = _motion_model(px[:, ip].reshape(3, 1), ud, constants.Ts).reshape(3)
            expected = np.minimum(detect_obstacles(px[0][ip], px[1][ip], px[2][ip], lines), constants.r_max)
            pw[0][ip] = 1 / np.linalg.norm(expected - data)
            # In the loop, as it stands: only the last one counts.
            w_avg = pw.sum() / NP
        pw = pw / pw.sum()
    w_slow += 0.7 * (w_avg - w_slow)
    w_fast += 0.3 * (w_avg - w_fast)
    x_est = px.dot(pw.T).reshape(3)

    pw_indices = rng.choice(np.arange(NP), NP, replace=True, p=pw[0])
    random_indices = rng.choice(np.arange(NP), max(0, int(NP * (1.0 - w_fast / w_slow))))
    proposal = np.array([[px[j][pw_indices[i]] + (rng.random() - 0.5) / 5 for i in range(NP)] for j in range(3)])
    for idx in random_indices:
        proposal[0][idx] = rng.uniform(0, lines.size[0])
        proposal[1][idx] = rng.uniform(0, lines.size[1])
        proposal[2][idx] = rng.uniform(0, math.pi)
    return x_est, proposal, pw, w_slow, w_fast
