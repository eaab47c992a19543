"""The quadrotor's equations once more, with rotation matrices and cross products, for real or complex numbers."""

import numpy as np


def rotation(roll, pitch, yaw):
    """Body to world: R_z(yaw) R_y(pitch) R_x(roll)."""
    (c, s), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def derivative(state, u, constants):
    """dX/dt by Newton and Euler."""
    roll, pitch, _ = state[3:6]
    velocity, rates = state[6:9], state[9:12]
    force = rotation(*state[3:6]) @ np.array([0, 0, u.sum()]) - constants.drag * velocity
    acceleration = force / constants.mass - np.array([0, 0, constants.g])
    # Each rotor pushes along the body's z axis where it is, and turns the body against its own sense.
    places = constants.arm * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    torque = sum(np.cross(place, np.array([0, 0, 1]) * thrust) for place, thrust in zip(places, u, strict=True))
    torque = torque + np.array([0, 0, constants.torque_ratio * (u[0] - u[1] + u[2] - u[3])])
    inertia = np.array(constants.inertia)
    # ω = E (φ̇, ϑ̇, θ̇): each Euler rate turns about its own axis
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    E = np.array([[1, 0, -sp], [0, cr, sr * cp], [0, -sr, cr * cp]])
    return np.concatenate(
        [velocity, np.linalg.solve(E, rates), acceleration, (torque - np.cross(rates, inertia * rates)) / inertia]
    )


def f(state, u, dt, constants, longest=0.05):
    """Runge and Kutta's method."""
    count = max(int(np.ceil(dt / longest - 1e-9)), 1)
    h = dt / count
    for _ in range(count):
        k1 = derivative(state, u, constants)
        k2 = derivative(state + h / 2 * k1, u, constants)
        k3 = derivative(state + h / 2 * k2, u, constants)
        k4 = derivative(state + h * k3, u, constants)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


def complex_step(function, point):
    """Jacobian (m, n) of an analytic function of n numbers, to rounding."""
    columns = []
    for axis in range(len(point)):
        moved = np.array(point, dtype=complex)
        moved[axis] += 1e-30j
        columns.append(np.imag(function(moved)) / 1e-30)
    return np.array(columns).T


def observe(state, constants):
    """ρ, α and a of one state, bearings not wrapped."""
    offset = constants.beacons - state[:3]
    ranges = np.sqrt((offset**2).sum(axis=1))
    # atan2 has no complex version: turned back by its real value, the rest is a small arctan, which has one.
    x, y = offset[:, 0], offset[:, 1]
    real = np.arctan2(np.real(y), np.real(x))
    turned = (y * np.cos(real) - x * np.sin(real)) / (x * np.cos(real) + y * np.sin(real))
    return np.concatenate([ranges, real + np.arctan(turned) - state[5], state[2:3]])
