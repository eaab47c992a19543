"""Reflects without bounce noise: the angle after a bounce is the angle before it."""

import numpy as np

from course_lib.angles import wrap
from course_lib.filters import systematic

N = 2000
K = 0.05


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return draw_prior(constants, rng)
    states = previous.copy()
    for robot in (0, 1):
        drive(states, 3 * robot, control[robot], constants, rng)
    if not np.isfinite(observation).any():
        return states
    weights = likelihood(states, observation, constants)
    if weights.sum() == 0.0:
        return draw_anywhere(constants, rng)
    states = states[systematic(weights / weights.sum(), rng)]
    return roughen(states, constants, rng)


def draw_prior(constants, rng):
    """Each robot in one of its two corners, heading into the room."""
    first_heading = np.array([np.pi / 2, -np.pi, -np.pi / 2, 0.0])
    states = np.empty((N, 6))
    for robot in (0, 1):
        corner = 2 * robot + rng.integers(2, size=N)
        states[:, 3 * robot : 3 * robot + 2] = constants.sensors[corner]
        states[:, 3 * robot + 2] = first_heading[corner] + rng.uniform(0.0, np.pi / 2, N)
    return states


def draw_anywhere(constants, rng):
    """Particles all over the room: a fresh start when none of them explains the readings."""
    room_x, room_y = constants.room
    low = [0.0, 0.0, -np.pi]
    high = [room_x, room_y, np.pi]
    return rng.uniform(low + low, high + high, size=(N, 6))


def drive(states, column, speed, constants, rng):
    """Move one robot of every particle for one sampling time, from bounce to bounce."""
    room_x, room_y = constants.room
    x, y, heading = states[:, column : column + 3].T
    speed_noise = constants.v_s_bar * (rng.random(N) - rng.random(N))
    left = speed * constants.Ts * (1.0 + speed_noise)
    i = np.arange(N)
    dx, dy = np.cos(heading), np.sin(heading)
    while True:
        to_x = np.where(dx > 0.0, room_x - x[i], x[i]) / np.maximum(np.abs(dx), 1e-12)
        to_y = np.where(dy > 0.0, room_y - y[i], y[i]) / np.maximum(np.abs(dy), 1e-12)
        step = np.minimum(left, np.minimum(to_x, to_y))
        x[i] = np.clip(x[i] + step * dx, 0.0, room_x)
        y[i] = np.clip(y[i] + step * dy, 0.0, room_y)
        hits = step < left
        if not hits.any():
            return
        i, left = i[hits], (left - step)[hits]
        dx, dy = bounce(dx[hits], dy[hits], (to_x <= to_y)[hits])
        heading[i] = np.arctan2(dy, dx)


def bounce(dx, dy, at_x_wall):
    """Direction after a bounce, from that before and which pair of walls was hit."""
    return np.where(at_x_wall, -dx, dx), np.where(at_x_wall, dy, -dy)


def likelihood(states, observation, constants):
    """p(z | particle), the product over the sensors that reported."""
    result = np.ones(N)
    for i in np.flatnonzero(np.isfinite(observation)):
        x, y = constants.sensors[i]
        to_a = np.hypot(states[:, 0] - x, states[:, 1] - y)
        to_b = np.hypot(states[:, 3] - x, states[:, 4] - y)
        right, wrong = (to_a, to_b) if i < 2 else (to_b, to_a)
        # f(z) = (1 - s_bar) f_w(z - d_right) + s_bar f_w(z - d_wrong)
        f_right = triangle(observation[i] - right, constants.w_bar)
        f_wrong = triangle(observation[i] - wrong, constants.w_bar)
        result *= (1.0 - constants.s_bar) * f_right + constants.s_bar * f_wrong
    return result


def triangle(w, w_bar):
    """Density of the sensor noise."""
    return np.maximum(1.0 - np.abs(w) / w_bar, 0.0) / w_bar


def roughen(states, constants, rng):
    """Jitter of standard deviation K E_i N^(-1/6), so that copies become different particles."""
    deviation = K * np.ptp(states, axis=0) * N ** (-1 / 6)
    states = states + deviation * rng.standard_normal((N, 6))
    room_x, room_y = constants.room
    states[:, [0, 3]] = np.clip(states[:, [0, 3]], 0.0, room_x)
    states[:, [1, 4]] = np.clip(states[:, [1, 4]], 0.0, room_y)
    states[:, [2, 5]] = wrap(states[:, [2, 5]])
    return states
