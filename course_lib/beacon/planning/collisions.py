"""Does an edge collide? The source's check, and one that misses nothing.

An edge is X(t) = f(X_n, U, t), 0 ≤ t ≤ Δt, with constant inputs. Both checks are here twice: for any path, a function
of time, and as compiled kernels for the quadrotor.
"""

import numpy as np
from numba import njit

from course_lib.beacon.planning.obstacles import distance
from course_lib.beacon.quadrotor import advance

#: An edge that comes that close to touching counts as touching, in metres.
TOLERANCE = 0.005
#: A march of more steps than this has lost its way: it counts as a collision.
MOST = 10_000


def march_by_chord(path, duration, distance, d_min):
    """The source's check (question 4): it takes the chord's length for the path's, and the speed for constant.

    Parameters
    ----------
    path : callable
        Position (m) at a time (s).
    duration : float
        Δt, in seconds.
    distance : callable
        Distance (m) from a position to the closest obstacle.
    d_min : float
        In metres; above 0, or the march may never end.

    Returns
    -------
    collides : bool
    checks : int
        How often `distance` was asked.
    """
    start = path(0.0)
    chord = float(np.linalg.norm(path(duration) - start))
    place, total, checks = start, 0.0, 0
    # while d_sum < d_{n→i}: d_sum += d, Δt* = d_sum / d_{n→i} Δt, X* = f(X_n, U, Δt*)
    while total < chord:
        d = distance(place)
        checks += 1
        if d < d_min:
            return True, checks
        total += d
        # Beyond the end, the source computes an X* that nothing looks at.
        if total < chord:
            place = path(total / chord * duration)
    return False, checks


def march_by_speed(path, duration, distance, radius, speed, acceleration=0.0):
    """Conservative advancement: no step is longer than what the vehicle needs, at its fastest, to reach an obstacle.

    In a time t the vehicle gets no farther than s(t) = v t + a t² / 2. While s(t) is at most d less the vehicle's
    radius, it touches nothing.

    Parameters
    ----------
    path, duration, distance
        As in `march_by_chord`.
    radius : float
        Of the vehicle, in metres.
    speed : float
        Bound v on the speed at the start (m/s), or all the way if the next is 0.
    acceleration : float
        Bound a on how fast the speed grows (m/s²).

    Returns
    -------
    collides : bool
        True for every path that touches, and for those that come closer than `TOLERANCE` to it.
    checks : int
    """
    t, checks = 0.0, 0
    while t < duration:
        gap = distance(path(t)) - radius
        checks += 1
        if not gap > TOLERANCE or checks > MOST:
            return True, checks
        now = speed + acceleration * t
        t += 2.0 * gap / (now + np.sqrt(now * now + 2.0 * acceleration * gap))
    return False, checks


@njit("float64(float64[::1])", cache=True)
def speed_of(state):
    """|v| of a state (12,)."""
    return np.sqrt(state[6] ** 2 + state[7] ** 2 + state[8] ** 2)


@njit("float64(float64[::1], float64[::1])", cache=True)
def growth_of_speed(thrusts, parameters):
    """Bound on d|v| / dt: thrust and weight at most add up, and drag brakes."""
    return (thrusts[0] + thrusts[1] + thrusts[2] + thrusts[3]) / parameters[0] + parameters[7]


@njit(
    "Tuple((boolean, int64, float64))(float64[::1], float64[::1], float64, float64, float64, float64[:, ::1], float64,"
    " float64, float64[::1])",
    cache=True,
)
def edge_by_speed(state, thrusts, duration, radius, tolerance, boxes, R, h, parameters):
    """`march_by_speed` for the quadrotor.

    Parameters
    ----------
    state : ndarray, shape (12,)
    thrusts : ndarray, shape (4,)
    duration, radius, tolerance : float
    boxes : ndarray, shape (M, 6)
    R, h : float
    parameters : ndarray
        Of `quadrotor.parameters`.

    Returns
    -------
    collides : bool
    checks : int
    time : float
        Of the collision, in seconds; `duration` without one.
    """
    start, growth = speed_of(state), growth_of_speed(thrusts, parameters)
    place, inputs = np.empty((1, 12)), np.empty((1, 4))
    inputs[0] = thrusts
    t, checks = 0.0, 0
    while t < duration:
        place[0] = state
        advance(place, inputs, t, parameters)
        gap = distance(place[0, 0], place[0, 1], place[0, 2], boxes, R, h) - radius
        checks += 1
        if not gap > tolerance or checks > MOST:
            return True, checks, t
        now = start + growth * t
        t += 2.0 * gap / (now + np.sqrt(now * now + 2.0 * growth * gap))
    return False, checks, duration


@njit(
    "Tuple((boolean, int64))(float64[::1], float64[::1], float64, float64, float64[:, ::1], float64, float64,"
    " float64[::1])",
    cache=True,
)
def edge_by_chord(state, thrusts, duration, d_min, boxes, R, h, parameters):
    """`march_by_chord` for the quadrotor."""
    place, inputs = np.empty((1, 12)), np.empty((1, 4))
    inputs[0] = thrusts
    place[0] = state
    advance(place, inputs, duration, parameters)
    chord = np.sqrt((place[0, 0] - state[0]) ** 2 + (place[0, 1] - state[1]) ** 2 + (place[0, 2] - state[2]) ** 2)
    place[0] = state
    total, checks = 0.0, 0
    while total < chord:
        d = distance(place[0, 0], place[0, 1], place[0, 2], boxes, R, h)
        checks += 1
        if not d >= d_min or checks > MOST:
            return True, checks
        total += d
        if total < chord:
            place[0] = state
            advance(place, inputs, total / chord * duration, parameters)
    return False, checks
