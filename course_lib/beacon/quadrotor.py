"""The quadrotor: f(X, U, Δt), its Jacobians, and a simple controller that flies it to a point.

Rotor 1 is ahead, 2 left, 3 behind, 4 right, `arm` from the centre; 1 and 3 turn against 2 and 4. Thrusts act along the
body's z axis; drag is linear. Compiled kernels take the constants as an array (`parameters`).
"""

import numpy as np
from numba import njit

#: A step of the integrator is no longer than this, in seconds.
LONGEST = 0.05
#: Gains of the controller: of position (1/s²), velocity (1/s), attitude (1/s) and rates (1/s).
GAINS = (1.5, 2.0, 6.0, 15.0)
#: The controller asks for no more than this acceleration to each side (m/s²) and tilt (rad).
STRONGEST, STEEPEST = 3.0, 0.4


def parameters(constants):
    """What the kernels need of `Constants`, shape (9,): mass, arm, torque ratio, inertia, drag, g, u_max."""
    c = constants
    return np.array([c.mass, c.arm, c.torque_ratio, *c.inertia, c.drag, c.g, c.u_max])


def hover(constants):
    """Thrusts that hold a level vehicle at rest, in N, shape (4,)."""
    return np.full(4, constants.mass * constants.g / 4)


def f(states, thrusts, dt, constants):
    """The dynamic model: states after a time of constant thrusts.

    Parameters
    ----------
    states : ndarray, shape (N, 12) or (12,)
        Columns as in `beacon.constants`.
    thrusts : ndarray, shape (4,), (N, 4)
        One for all, or one for each; in N.
    dt : float
        In seconds; steps of the classical Runge-Kutta method of at most `LONGEST`.
    constants : Constants

    Returns
    -------
    ndarray, shape of `states`
        Angles are not wrapped: f is smooth.
    """
    result = np.array(np.atleast_2d(states), dtype=float, order="C")
    inputs = np.empty((len(result), 4))
    inputs[:] = thrusts
    advance(result, inputs, dt, parameters(constants))
    return result.reshape(np.shape(states))


def jacobians(state, thrusts, dt, constants):
    """Derivatives of `f`: of the discrete map itself, so exact.

    Parameters
    ----------
    state : ndarray, shape (12,)
    thrusts : ndarray, shape (4,)
    dt : float
    constants : Constants

    Returns
    -------
    F_x : ndarray, shape (12, 12)
        ∂f/∂X.
    F_u : ndarray, shape (12, 4)
        ∂f/∂U.
    """
    _, F_x, F_u = linearised(
        np.array(state, dtype=float), np.array(thrusts, dtype=float), float(dt), parameters(constants)
    )
    return F_x, F_u


def fly_to(state, target, constants):
    """Thrusts of a cascade of proportional controllers: position, velocity, attitude, rates.

    Parameters
    ----------
    state : ndarray, shape (12,)
    target : array_like, shape (4,)
        x, y, z in metres and yaw in radians.
    constants : Constants

    Returns
    -------
    ndarray, shape (4,)
        In N, between 0 and `u_max`.
    """
    return controlled(
        np.ascontiguousarray(state, dtype=float), np.ascontiguousarray(target, dtype=float), parameters(constants)
    )


@njit("void(float64[::1], float64[::1], float64[::1], float64[::1])", cache=True)
def derivative(state, u, parameters, rate):
    """Write dX/dt, shape (12,), into `rate`."""
    mass, arm, ratio, j_x, j_y, j_z, drag, g, _ = parameters
    s_roll, c_roll = np.sin(state[3]), np.cos(state[3])
    s_pitch, c_pitch = np.sin(state[4]), np.cos(state[4])
    s_yaw, c_yaw = np.sin(state[5]), np.cos(state[5])
    p, q, r = state[9], state[10], state[11]
    # ṗ = v
    rate[0], rate[1], rate[2] = state[6], state[7], state[8]
    # φ̇ = p + tan ϑ (q sin φ + r cos φ);  ϑ̇ = q cos φ - r sin φ;  θ̇ = (q sin φ + r cos φ) / cos ϑ
    turn = (q * s_roll + r * c_roll) / c_pitch
    rate[3] = p + s_pitch * turn
    rate[4] = q * c_roll - r * s_roll
    rate[5] = turn
    # v̇ = (Σu / m) R e_z - g e_z - (d / m) v
    lift = (u[0] + u[1] + u[2] + u[3]) / mass
    rate[6] = lift * (c_yaw * s_pitch * c_roll + s_yaw * s_roll) - drag / mass * state[6]
    rate[7] = lift * (s_yaw * s_pitch * c_roll - c_yaw * s_roll) - drag / mass * state[7]
    rate[8] = lift * c_pitch * c_roll - g - drag / mass * state[8]
    # J ω̇ = τ - ω × J ω
    rate[9] = (arm * (u[1] - u[3]) + (j_y - j_z) * q * r) / j_x
    rate[10] = (arm * (u[2] - u[0]) + (j_z - j_x) * r * p) / j_y
    rate[11] = (ratio * (u[0] - u[1] + u[2] - u[3]) + (j_x - j_y) * p * q) / j_z


@njit("void(float64[:, ::1], float64[:, ::1], float64, float64[::1])", cache=True)
def advance(states, thrusts, dt, parameters):
    """`f`, in place: states (N, 12), thrusts (N, 4)."""
    count = max(int(np.ceil(dt / LONGEST - 1e-9)), 1)
    step = dt / count
    slopes, middle = np.empty((4, 12)), np.empty(12)
    for i in range(len(states)):
        state = states[i]
        for _ in range(count):
            derivative(state, thrusts[i], parameters, slopes[0])
            for stage in range(1, 4):
                part = step if stage == 3 else 0.5 * step
                for c in range(12):
                    middle[c] = state[c] + part * slopes[stage - 1, c]
                derivative(middle, thrusts[i], parameters, slopes[stage])
            for c in range(12):
                slope = slopes[0, c] + 2.0 * slopes[1, c] + 2.0 * slopes[2, c] + slopes[3, c]
                state[c] += step / 6.0 * slope


@njit("void(float64[::1], float64[::1], float64[::1], float64[:, ::1], float64[:, ::1])", cache=True)
def slopes_of_derivative(state, u, parameters, by_state, by_input):
    """Write ∂(dX/dt)/∂X (12, 12) and ∂(dX/dt)/∂U (12, 4)."""
    mass, arm, ratio, j_x, j_y, j_z, drag, _, _ = parameters
    s_roll, c_roll = np.sin(state[3]), np.cos(state[3])
    s_pitch, c_pitch = np.sin(state[4]), np.cos(state[4])
    s_yaw, c_yaw = np.sin(state[5]), np.cos(state[5])
    p, q, r = state[9], state[10], state[11]
    lift = (u[0] + u[1] + u[2] + u[3]) / mass
    by_state[:] = 0.0
    by_input[:] = 0.0
    for axis in range(3):
        by_state[axis, 6 + axis] = 1.0
        by_state[6 + axis, 6 + axis] = -drag / mass
    # q sin φ + r cos φ, and its derivative by φ
    sweep, swept = q * s_roll + r * c_roll, q * c_roll - r * s_roll
    by_state[3, 3] = s_pitch / c_pitch * swept
    by_state[3, 4] = sweep / c_pitch**2
    by_state[3, 9], by_state[3, 10], by_state[3, 11] = 1.0, s_pitch / c_pitch * s_roll, s_pitch / c_pitch * c_roll
    by_state[4, 3] = -sweep
    by_state[4, 10], by_state[4, 11] = c_roll, -s_roll
    by_state[5, 3] = swept / c_pitch
    by_state[5, 4] = sweep * s_pitch / c_pitch**2
    by_state[5, 10], by_state[5, 11] = s_roll / c_pitch, c_roll / c_pitch
    # R e_z, by φ, ϑ and θ
    by_state[6, 3] = lift * (-c_yaw * s_pitch * s_roll + s_yaw * c_roll)
    by_state[6, 4] = lift * c_yaw * c_pitch * c_roll
    by_state[6, 5] = lift * (-s_yaw * s_pitch * c_roll + c_yaw * s_roll)
    by_state[7, 3] = lift * (-s_yaw * s_pitch * s_roll - c_yaw * c_roll)
    by_state[7, 4] = lift * s_yaw * c_pitch * c_roll
    by_state[7, 5] = lift * (c_yaw * s_pitch * c_roll + s_yaw * s_roll)
    by_state[8, 3] = -lift * c_pitch * s_roll
    by_state[8, 4] = -lift * s_pitch * c_roll
    by_state[9, 10], by_state[9, 11] = (j_y - j_z) / j_x * r, (j_y - j_z) / j_x * q
    by_state[10, 9], by_state[10, 11] = (j_z - j_x) / j_y * r, (j_z - j_x) / j_y * p
    by_state[11, 9], by_state[11, 10] = (j_x - j_y) / j_z * q, (j_x - j_y) / j_z * p
    by_input[6] = (c_yaw * s_pitch * c_roll + s_yaw * s_roll) / mass
    by_input[7] = (s_yaw * s_pitch * c_roll - c_yaw * s_roll) / mass
    by_input[8] = c_pitch * c_roll / mass
    by_input[9, 1], by_input[9, 3] = arm / j_x, -arm / j_x
    by_input[10, 2], by_input[10, 0] = arm / j_y, -arm / j_y
    for rotor in range(4):
        by_input[11, rotor] = ratio / j_z * (1.0 if rotor % 2 == 0 else -1.0)


@njit(
    "Tuple((float64[::1], float64[:, ::1], float64[:, ::1]))(float64[::1], float64[::1], float64, float64[::1])",
    cache=True,
)
def linearised(state, thrusts, dt, parameters):
    """f, ∂f/∂X and ∂f/∂U at once, for one state (12,) and its thrusts (4,)."""
    count = max(int(np.ceil(dt / LONGEST - 1e-9)), 1)
    step = dt / count
    state = state.copy()
    F_x, F_u = np.eye(12), np.zeros((12, 4))
    slope, by_state, by_input = np.empty(12), np.empty((12, 12)), np.empty((12, 4))
    for _ in range(count):
        # The chain rule through the four stages: dkᵢ = A(xᵢ) (dx + cᵢ Δt dkᵢ₋₁) + B(xᵢ) du
        last, last_x, last_u = np.zeros(12), np.zeros((12, 12)), np.zeros((12, 4))
        change, change_x, change_u = np.zeros(12), np.zeros((12, 12)), np.zeros((12, 4))
        for stage in range(4):
            part = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
            weight = step / 6.0 if stage in (0, 3) else step / 3.0
            point = state + part * last
            derivative(point, thrusts, parameters, slope)
            slopes_of_derivative(point, thrusts, parameters, by_state, by_input)
            last = slope.copy()
            last_x = by_state @ (F_x + part * last_x)
            last_u = by_state @ (F_u + part * last_u) + by_input
            change += weight * last
            change_x += weight * last_x
            change_u += weight * last_u
        state += change
        F_x = F_x + change_x
        F_u = F_u + change_u
    return state, F_x, F_u


@njit("float64[::1](float64[::1], float64[::1], float64[::1])", cache=True)
def controlled(state, target, parameters):
    """`fly_to` as a kernel."""
    mass, arm, ratio, j_x, j_y, j_z, _, g, u_max = parameters
    by_position, by_velocity, by_attitude, by_rate = GAINS
    wish = np.empty(3)
    for axis in range(3):
        wish[axis] = by_position * (target[axis] - state[axis]) - by_velocity * state[6 + axis]
        wish[axis] = min(max(wish[axis], -STRONGEST), STRONGEST)
    # Small tilts push ahead by g ϑ and to the left by -g φ.
    s_yaw, c_yaw = np.sin(state[5]), np.cos(state[5])
    roll = min(max((wish[0] * s_yaw - wish[1] * c_yaw) / g, -STEEPEST), STEEPEST)
    pitch = min(max((wish[0] * c_yaw + wish[1] * s_yaw) / g, -STEEPEST), STEEPEST)
    turn = (target[3] - state[5] + np.pi) % (2.0 * np.pi) - np.pi
    turn = min(max(turn, -STEEPEST), STEEPEST)
    lift = mass * (g + wish[2]) / max(np.cos(state[3]) * np.cos(state[4]), 0.5)
    torque_x = j_x * by_rate * (by_attitude * (roll - state[3]) - state[9])
    torque_y = j_y * by_rate * (by_attitude * (pitch - state[4]) - state[10])
    # Yaw has little authority: a quarter of the stiffness.
    torque_z = 0.25 * j_z * by_rate * (0.25 * by_attitude * turn - state[11])
    u = np.empty(4)
    u[0] = 0.25 * lift - 0.5 * torque_y / arm + 0.25 * torque_z / ratio
    u[1] = 0.25 * lift + 0.5 * torque_x / arm - 0.25 * torque_z / ratio
    u[2] = 0.25 * lift + 0.5 * torque_y / arm + 0.25 * torque_z / ratio
    u[3] = 0.25 * lift - 0.5 * torque_x / arm - 0.25 * torque_z / ratio
    for rotor in range(4):
        u[rotor] = min(max(u[rotor], 0.0), u_max)
    return u
