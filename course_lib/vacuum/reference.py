"""The reference `Estimator` of the vacuum robots: a bootstrap filter on pairs of robots, in compiled kernels.

Three things set it apart from the textbook's filter. The cloud is larger than the posterior it returns: it stays in
the estimator's memory, and what is returned is thinned from it. A robot's heading is also kept as a direction
(cos θ, sin θ), so that only a bounce costs trigonometry. And roughening keeps to what is possible: since its last
bounce a robot has driven straight, and its heading is what is in doubt, so copies of a particle are turned about the
point of that bounce instead of being shaken in all six coordinates. A few are turned far: when the readings leave only
a handful of survivors, the truth lies somewhere between them.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from course_lib.filters import Particles, Step, systematic
from course_lib.vacuum import models
from course_lib.vacuum.models import bounce, to_wall

#: Particles in the cloud, each a pair of robots.
COUNT = 25_000
#: Particles in the posterior that is returned.
RETURNED = 5_000
#: Resample when the effective sample size falls below this share of the cloud.
THRESHOLD = 0.5
#: Half of the copies are turned by less than this many times the spacing of headings in the cloud.
TURN = 0.2

# Rows of what is kept of one robot: position, heading, its direction, and metres driven since the last bounce.
X, Y, HEADING, COS, SIN, DRIVEN = range(6)

_FLOAT = types.float64
_COLUMN = types.float64[::1]
_ROWS = types.float64[:, ::1]
_INDICES = types.int64[::1]


class Cloud(NamedTuple):
    """What the estimator remembers.

    Attributes
    ----------
    robots : ndarray, shape (2, 6, N)
        For A and B the rows x, y (m), θ (rad), cos θ, sin θ, and the distance driven since the last bounce (m).
    weights : ndarray, shape (N,)
        Normalised.
    """

    robots: np.ndarray
    weights: np.ndarray


def Estimator(previous, observation, control, constants, rng):
    """One update of the particle filter.

    Parameters
    ----------
    previous : Step or None
        What the last call returned; None at time 0.
    observation : array_like, shape (4,), or None
        Readings in metres, `inf` where a sensor is silent.
    control : array_like, shape (2,), or None
        Speeds u_A, u_B over the last interval in m/s.
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    Step
        The posterior, `RETURNED` particles of equal weight with columns x_A, y_A, θ_A, x_B, y_B, θ_B, and the `Cloud`
        it was thinned from.
    """
    cloud = _prior(constants, rng) if previous is None else previous.memory
    if previous is not None:
        cloud = _resampled(cloud, constants, rng)
        for robot in (0, 1):
            distance = np.full(COUNT, control[robot] * constants.Ts)
            if constants.v_s_bar:
                distance *= 1.0 + models.triangular_noise(rng.random(COUNT), constants.v_s_bar)
            advance(cloud.robots[robot], distance, *constants.room, constants.v_bar, rng)
        cloud = Cloud(cloud.robots, _weighed(cloud, observation, constants))
    return Step(_thinned(cloud, rng), cloud)


def _prior(constants, rng):
    """The cloud at time 0."""
    states = models.prior(COUNT, constants, rng)
    x, y, heading = states.T.reshape(2, 3, COUNT).swapaxes(0, 1)
    robots = np.stack([x, y, heading, np.cos(heading), np.sin(heading), np.zeros_like(x)], axis=1)
    return Cloud(robots, np.full(COUNT, 1.0 / COUNT))


def _resampled(cloud, constants, rng):
    """A copy of the cloud; resampled, and roughened, when few particles hold most of the weight."""
    robots, weights = cloud
    # ESS = 1 / Σ w²
    if 1.0 / np.square(weights).sum() >= THRESHOLD * COUNT:
        return Cloud(robots.copy(), weights)
    parents = systematic(weights, rng)
    # Each heading spans a quarter of the circle at first, the pair of them a square: N points in it lie this far apart.
    spacing = np.pi / 2 / np.sqrt(COUNT)
    children = np.empty_like(robots)
    for robot in (0, 1):
        np.take(robots[robot], parents, axis=1, out=children[robot], mode="clip")
        turn_copies(children[robot], parents, TURN * spacing, *constants.room, rng)
    return Cloud(children, np.full(COUNT, 1.0 / COUNT))


def _weighed(cloud, observation, constants):
    """The weights after the sensors' readings."""
    weights = cloud.weights.copy()
    for i in np.flatnonzero(np.isfinite(observation)):
        tuned_to, other = cloud.robots if i < 2 else cloud.robots[::-1]
        weigh(weights, tuned_to, other, observation[i], *constants.sensors[i], constants.w_bar, constants.s_bar)
    total = weights.sum()
    # Readings that no particle can have caused are dropped: every bounce widens the cloud, until it meets them again.
    return weights / total if total > 0.0 else cloud.weights


def _thinned(cloud, rng):
    """`RETURNED` particles of equal weight that stand for the cloud."""
    drawn = systematic(cloud.weights, rng, RETURNED)
    states = np.empty((RETURNED, 6))
    for robot in (0, 1):
        for row in (X, Y, HEADING):
            states[:, 3 * robot + row] = cloud.robots[robot, row].take(drawn)
    return Particles(states, np.full(RETURNED, -np.log(RETURNED)))


@njit(types.void(_ROWS, _INDICES, _FLOAT, _FLOAT, _FLOAT, types.npy_rng), cache=True)
def turn_copies(robot, parents, scale, room_x, room_y, rng):
    """Turn all but the first child of each parent about the point of its last bounce; changes `robot` in place.

    Parameters
    ----------
    robot : ndarray, shape (6, N)
        One robot of a `Cloud`.
    parents : ndarray, shape (N,)
        Sorted, one for each column of `robot`.
    scale : float
        Turns are δ = arctan t, t = scale · u / (1 - |u|) with u uniform on (-1, 1), so that half of them are smaller
        than the scale and the density falls as 1 / t² beyond it. One that would end outside the room is not made.
    room_x, room_y : float
        Extent of the room in metres.
    rng : numpy.random.Generator
    """
    for i in range(1, parents.size):
        if parents[i] != parents[i - 1]:
            continue
        u = 2.0 * rng.random() - 1.0
        t = scale * u / (1.0 - abs(u))
        # (cos, sin)(θ + δ) = (cos θ - t sin θ, sin θ + t cos θ) / √(1 + t²)
        cos_turn = 1.0 / np.sqrt(1.0 + t * t)
        dx = (robot[COS, i] - t * robot[SIN, i]) * cos_turn
        dy = (robot[SIN, i] + t * robot[COS, i]) * cos_turn
        # p' = p_bounce + r (cos, sin)(θ + δ),  p_bounce = p - r (cos, sin) θ
        x = robot[X, i] + robot[DRIVEN, i] * (dx - robot[COS, i])
        y = robot[Y, i] + robot[DRIVEN, i] * (dy - robot[SIN, i])
        if 0.0 < x < room_x and 0.0 < y < room_y:
            robot[X, i], robot[Y, i] = x, y
            robot[COS, i], robot[SIN, i] = dx, dy
            heading = robot[HEADING, i] + np.arctan(t)
            robot[HEADING, i] = heading - 2.0 * np.pi * np.round(heading / (2.0 * np.pi))


@njit(types.void(_ROWS, _COLUMN, _FLOAT, _FLOAT, _FLOAT, types.npy_rng), cache=True)
def advance(robot, distance, room_x, room_y, v_bar, rng):
    """Drive robots their distance, bouncing off walls as often as it takes; changes `robot` in place.

    `models.drive` for directions that are known: draws the same bounces from the same random numbers.

    Parameters
    ----------
    robot : ndarray, shape (6, N)
        One robot of a `Cloud`.
    distance : ndarray, shape (N,)
        Metres to drive, not negative.
    room_x, room_y : float
        Extent of the room in metres.
    v_bar : float
        Half-width of the bounce noise.
    rng : numpy.random.Generator
    """
    states = robot.T
    bouncing = np.empty(distance.size, dtype=np.int64)
    left = np.empty(distance.size)
    count = 0
    for i in range(distance.size):
        # p[k] = p[k-1] + u T_s (cos θ, sin θ), as long as that is inside
        x = robot[X, i] + distance[i] * robot[COS, i]
        y = robot[Y, i] + distance[i] * robot[SIN, i]
        robot[DRIVEN, i] += distance[i]
        if 0.0 <= x <= room_x and 0.0 <= y <= room_y:
            robot[X, i], robot[Y, i] = x, y
        else:
            rest = to_wall(states, i, 0, robot[COS, i], robot[SIN, i], distance[i], room_x, room_y)
            if rest >= 0.0:
                bouncing[count], left[count] = i, rest
                count += 1
    while count:
        again = 0
        for j in range(count):
            i = bouncing[j]
            x, dx, dy = robot[X, i], robot[COS, i], robot[SIN, i]
            # v = v̄ (2p - 1)^{1/3}
            noise = v_bar * np.cbrt(2.0 * rng.random() - 1.0)
            if (x <= 0.0 and dx < 0.0) or (x >= room_x and dx > 0.0):
                dy, dx = bounce(dy, dx, noise)
            else:
                dx, dy = bounce(dx, dy, noise)
            robot[HEADING, i] = np.arctan2(dy, dx)
            robot[COS, i], robot[SIN, i], robot[DRIVEN, i] = dx, dy, left[j]
            rest = to_wall(states, i, 0, dx, dy, left[j], room_x, room_y)
            if rest >= 0.0:
                bouncing[again], left[again] = i, rest
                again += 1
        count = again


@njit(types.void(_COLUMN, _ROWS, _ROWS, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT), cache=True)
def weigh(weights, tuned_to, other, reading, sensor_x, sensor_y, w_bar, s_bar):
    """Multiply weights by the likelihood of one sensor's reading; changes `weights` in place.

    Parameters
    ----------
    weights : ndarray, shape (N,)
    tuned_to, other : ndarray, shape (6, N)
        The robot of a `Cloud` that the sensor is tuned to, and the wrong one.
    reading : float
        Metres, finite.
    sensor_x, sensor_y : float
        Where the sensor is, in metres.
    w_bar : float
        Half-width of the sensor noise.
    s_bar : float
        Probability that the sensor measures the wrong robot.
    """
    right_x, right_y, wrong_x, wrong_y = tuned_to[X], tuned_to[Y], other[X], other[Y]
    scale = 1.0 / w_bar
    right_share, wrong_share = (1.0 - s_bar) * scale, s_bar * scale
    for i in range(weights.size):
        right = np.sqrt((right_x[i] - sensor_x) ** 2 + (right_y[i] - sensor_y) ** 2)
        wrong = np.sqrt((wrong_x[i] - sensor_x) ** 2 + (wrong_y[i] - sensor_y) ** 2)
        # f(z | p) = (1 - s̄) f_w(z - d_right) + s̄ f_w(z - d_wrong),  f_w(w) = max(1 - |w| / w̄, 0) / w̄
        weights[i] *= right_share * max(1.0 - abs(reading - right) * scale, 0.0) + wrong_share * max(
            1.0 - abs(reading - wrong) * scale, 0.0
        )
