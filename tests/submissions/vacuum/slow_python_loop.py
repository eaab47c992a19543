"""Correct, but one particle at a time: 500 of them in Python loops."""

import math

import numpy as np

N = 500
K = 0.1


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return np.array([draw_prior(constants, rng) for _ in range(N)])
    states = []
    for particle in previous:
        robots = []
        for robot in (0, 1):
            x, y, heading = particle[3 * robot : 3 * robot + 3]
            robots.extend(drive(x, y, heading, control[robot], constants, rng))
        states.append(robots)
    if not np.isfinite(observation).any():
        return np.array(states)
    weights = [likelihood(particle, observation, constants) for particle in states]
    if sum(weights) == 0.0:
        return np.array([draw_anywhere(constants, rng) for _ in range(N)])
    return roughen(resample(states, weights, rng), constants, rng)


def draw_prior(constants, rng):
    """Each robot in one of its two corners, heading into the room."""
    first_heading = [math.pi / 2, -math.pi, -math.pi / 2, 0.0]
    particle = []
    for robot in (0, 1):
        corner = 2 * robot + rng.integers(2)
        x, y = constants.sensors[corner]
        particle.extend([x, y, first_heading[corner] + rng.uniform(0.0, math.pi / 2)])
    return particle


def draw_anywhere(constants, rng):
    """A robot's place in the room is anyone's guess when no particle explains the readings."""
    particle = []
    for _ in (0, 1):
        x, y = rng.uniform(0.0, constants.room)
        particle.extend([x, y, rng.uniform(-math.pi, math.pi)])
    return particle


def drive(x, y, heading, speed, constants, rng):
    """Move one robot for one sampling time, from bounce to bounce."""
    room_x, room_y = constants.room
    left = speed * constants.Ts * (1.0 + constants.v_s_bar * (rng.random() - rng.random()))
    dx, dy = math.cos(heading), math.sin(heading)
    while True:
        to_x = (room_x - x if dx > 0.0 else x) / max(abs(dx), 1e-12)
        to_y = (room_y - y if dy > 0.0 else y) / max(abs(dy), 1e-12)
        step = min(left, to_x, to_y)
        x = min(max(x + step * dx, 0.0), room_x)
        y = min(max(y + step * dy, 0.0), room_y)
        if step == left:
            return x, y, math.atan2(dy, dx)
        left -= step
        # F(v) = (v^3 + v_bar^3) / (2 v_bar^3), solved for v
        v = constants.v_bar * np.cbrt(2.0 * rng.random() - 1.0)
        along, into = (dy, dx) if to_x <= to_y else (dx, dy)
        angle = math.atan2(abs(into), abs(along)) * (1.0 + v)
        along = math.copysign(1.0, along) * math.cos(angle)
        into = -math.copysign(1.0, into) * math.sin(angle)
        dx, dy = (into, along) if to_x <= to_y else (along, into)


def likelihood(particle, observation, constants):
    """p(z | particle), the product over the sensors that reported."""
    result = 1.0
    for i in range(4):
        if math.isinf(observation[i]):
            continue
        x, y = constants.sensors[i]
        to_a = math.hypot(particle[0] - x, particle[1] - y)
        to_b = math.hypot(particle[3] - x, particle[4] - y)
        right, wrong = (to_a, to_b) if i < 2 else (to_b, to_a)
        f_right = triangle(observation[i] - right, constants.w_bar)
        f_wrong = triangle(observation[i] - wrong, constants.w_bar)
        result *= (1.0 - constants.s_bar) * f_right + constants.s_bar * f_wrong
    return result


def triangle(w, w_bar):
    """Density of the sensor noise."""
    return max(1.0 - abs(w) / w_bar, 0.0) / w_bar


def resample(states, weights, rng):
    """Systematic resampling, one pass through the weights."""
    spacing = sum(weights) / N
    pointer = rng.random() * spacing
    survivors, i, cumulative = [], 0, weights[0]
    for _ in range(N):
        while cumulative < pointer and i < N - 1:
            i += 1
            cumulative += weights[i]
        survivors.append(states[i])
        pointer += spacing
    return np.array(survivors)


def roughen(states, constants, rng):
    """Jitter of standard deviation K E_i N^(-1/6), so that copies become different particles."""
    deviation = K * np.ptp(states, axis=0) * N ** (-1 / 6)
    room_x, room_y = constants.room
    for particle in states:
        particle += deviation * rng.standard_normal(6)
        for column in (0, 3):
            particle[column] = min(max(particle[column], 0.0), room_x)
            particle[column + 1] = min(max(particle[column + 1], 0.0), room_y)
            particle[column + 2] = math.remainder(particle[column + 2], 2 * math.pi)
    return states
