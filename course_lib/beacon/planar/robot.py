"""Models of a robot on wheels that measures ranges, or ranges and bearings, to landmarks.

A state is x, y (m), heading θ (rad) and the bias of the ranges b (m), which is estimated with the pose where its prior
leaves room. Headings are not wrapped, their differences are: the heading of a robot that turns left forever counts its
turns. A control is forward velocity v (m/s), yaw rate ω (rad/s) and the time Δt (s) they act. An observation is the
range ρ (m) to each of L landmarks and then the bearing α (rad) to each, counter-clockwise from the heading; `inf` where
nothing was measured: a run as `course_lib.recording.GroundRecording.steps` makes it.

References
----------
S. Thrun, W. Burgard, D. Fox, *Probabilistic robotics*, MIT Press 2005, sections 5.3, 6.6 and 7.4.
"""

from dataclasses import dataclass

import numpy as np

from course_lib.angles import wrap
from course_lib.ranges import check_ranges

X, Y, HEADING, BIAS = range(4)
POSITION, POSE = slice(0, 2), slice(0, 3)
#: Columns of a state that are angles.
ANGLES = (HEADING,)
V, OMEGA, DT = range(3)


@dataclass(frozen=True, eq=False)
class Constants:
    """What the filters are told of a robot and its sensor.

    Attributes
    ----------
    landmarks : ndarray, shape (L, 2)
        Positions (m).
    v_scale, omega_scale : float
        True velocity and yaw rate per reading.
    omega_offset : float
        What is added to the yaw rate (rad/s).
    delay : float
        How long after a reading's time the robot follows it (s); used where a recording is cut into steps.
    sigma_v, sigma_omega : float
        Noise of velocity and yaw rate, white: the standard deviations of what they add in a second (m/√s, rad/√s).
    depth : bool
        The sensor is a camera that measures depth along its axis, which is the heading, and calls it range.
    range_scale, range_offset : float
        Range read = scale · range + offset (m) + bias.
    bearing_offset : float
        Added to every bearing (rad).
    sigma_rho, sigma_alpha : float
        Standard deviations of ranges (m) and bearings (rad).
    bias_sigma, bias_walk : float
        Of the bias of the ranges: standard deviation at the start (m) and of its random walk (m/√s).
    outliers : float
        Share of sightings that say nothing of the pose.
    range_span, bearing_span : float
        Over which those are uniform (m, rad).
    gate : float
        The Kalman filter takes a sighting for an outlier when its innovation is larger than this quantile.
    N : int
        Number of particles.
    """

    landmarks: np.ndarray
    v_scale: float = 1.0
    omega_scale: float = 1.0
    omega_offset: float = 0.0
    delay: float = 0.0
    sigma_v: float = 0.02
    sigma_omega: float = 0.05
    depth: bool = False
    range_scale: float = 1.0
    range_offset: float = 0.0
    bearing_offset: float = 0.0
    sigma_rho: float = 0.15
    sigma_alpha: float = float(np.radians(2.0))
    bias_sigma: float = 0.0
    bias_walk: float = 0.0
    outliers: float = 0.03
    range_span: float = 10.0
    bearing_span: float = float(np.radians(60.0))
    gate: float = 0.999
    N: int = 1000

    def __post_init__(self):
        if np.ndim(self.landmarks) != 2 or np.shape(self.landmarks)[1] != 2:
            raise ValueError(f"landmarks must have shape (L, 2), got {np.shape(self.landmarks)}")
        positive, any_size = (1e-9, 1e9), (-1e9, 1e9)
        check_ranges(
            self,
            **dict.fromkeys(("v_scale", "omega_scale", "range_scale", "range_span", "bearing_span"), positive),
            **dict.fromkeys(("sigma_rho", "sigma_alpha"), positive),
            **dict.fromkeys(("sigma_v", "sigma_omega", "bias_sigma", "bias_walk", "delay"), (0.0, 1e9)),
            **dict.fromkeys(("omega_offset", "range_offset", "bearing_offset"), any_size),
            outliers=(1e-12, 1.0 - 1e-12),
            gate=(1e-12, 1.0 - 1e-12),
            N=(1, 1e9),
        )


def move(states, control, constants, noise_v=0.0, noise_omega=0.0):
    """Where the robot gets to: along a circular arc, exactly.

    Parameters
    ----------
    states : ndarray, shape (N, 4)
    control : array_like, shape (3,)
        v, ω, Δt.
    constants : Constants
    noise_v, noise_omega : float or ndarray, shape (N,)
        Added to velocity (m/s) and yaw rate (rad/s).

    Returns
    -------
    ndarray, shape (N, 4)
    """
    v, omega, dt = control
    v = constants.v_scale * v + noise_v
    half_turn = 0.5 * dt * (constants.omega_scale * omega + constants.omega_offset + noise_omega)
    # A chord of length v Δt sin(η)/η in the direction θ + η, with η = ω Δt / 2.
    chord = v * dt * np.sinc(half_turn / np.pi)
    direction = states[:, HEADING] + half_turn
    moved = states.copy()
    moved[:, X] += chord * np.cos(direction)
    moved[:, Y] += chord * np.sin(direction)
    moved[:, HEADING] = direction + half_turn
    return moved


def motion_jacobians(state, control, constants):
    """Derivatives of `move`.

    Parameters
    ----------
    state : ndarray, shape (4,)
    control : array_like, shape (3,)
    constants : Constants

    Returns
    -------
    F_x : ndarray, shape (4, 4)
        With respect to the state.
    F_u : ndarray, shape (4, 2)
        With respect to the noise of v and ω.
    """
    v, omega, dt = control
    v = constants.v_scale * v
    eta = 0.5 * dt * (constants.omega_scale * omega + constants.omega_offset)
    sinc = np.sinc(eta / np.pi)
    # d/dη sin(η)/η; the quotient loses its digits near 0, where the series has them.
    slope = -eta / 3.0 + eta**3 / 30.0 if abs(eta) < 1e-2 else (np.cos(eta) - sinc) / eta
    ahead = np.array([np.cos(state[HEADING] + eta), np.sin(state[HEADING] + eta)])
    left = np.array([-ahead[1], ahead[0]])
    F_x = np.eye(4)
    F_x[POSITION, HEADING] = v * dt * sinc * left
    F_u = np.zeros((4, 2))
    F_u[POSITION, 0] = dt * sinc * ahead
    F_u[POSITION, 1] = 0.5 * v * dt**2 * (slope * ahead + sinc * left)
    F_u[HEADING, 1] = dt
    return F_x, F_u


def transition(states, control, constants, rng):
    """Draw the next state of each particle.

    Parameters
    ----------
    states : ndarray, shape (N, 4)
    control : array_like, shape (3,)
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (N, 4)
    """
    dt = control[DT]
    noise = rng.standard_normal((3, len(states)))
    # The mean of white noise over Δt has the variance σ²/Δt, its integral σ² Δt.
    noise_v, noise_omega = noise[0] * constants.sigma_v / np.sqrt(dt), noise[1] * constants.sigma_omega / np.sqrt(dt)
    moved = move(states, control, constants, noise_v, noise_omega)
    moved[:, BIAS] += noise[2] * constants.bias_walk * np.sqrt(dt)
    return moved


def observe(states, rows, constants):
    """What the sensor would read without noise; bearings are not wrapped: their differences are.

    Parameters
    ----------
    states : ndarray, shape (N, 4)
    rows : ndarray of int, shape (S,)
        Which landmarks.
    constants : Constants

    Returns
    -------
    ranges, bearings : ndarray, shape (N, S)
    """
    dx = constants.landmarks[rows, 0] - states[:, X, None]
    dy = constants.landmarks[rows, 1] - states[:, Y, None]
    # ρ = √(Δx² + Δy²), or the depth ρ cos α; α = atan2(Δy, Δx) - θ
    bearings = np.arctan2(dy, dx) - states[:, HEADING, None]
    ranges = np.hypot(dx, dy) * (np.cos(bearings) if constants.depth else 1.0)
    ranges = constants.range_scale * ranges + constants.range_offset + states[:, BIAS, None]
    return ranges, bearings + constants.bearing_offset


def observation_jacobian(state, row, constants):
    """Derivative of `observe` for one landmark.

    Parameters
    ----------
    state : ndarray, shape (4,)
    row : int
        Which landmark.
    constants : Constants

    Returns
    -------
    ndarray, shape (2, 4)
        Of the range; of the bearing.
    """
    dx, dy = constants.landmarks[row] - state[POSITION]
    square = dx * dx + dy * dy
    H = np.zeros((2, 4))
    if constants.depth:
        cos, sin = np.cos(state[HEADING]), np.sin(state[HEADING])
        H[0, POSE] = -cos, -sin, dy * cos - dx * sin
    else:
        H[0, POSITION] = -dx / np.sqrt(square), -dy / np.sqrt(square)
    H[0] *= constants.range_scale
    H[0, BIAS] = 1.0
    H[1, POSE] = dy / square, -dx / square, -1.0
    return H


def angular(measured, predicted):
    """Innovation of bearings: the difference, wrapped to [-π, π)."""
    return wrap(measured - predicted)


def log_likelihood(observation, states, constants, difference=angular):
    """Log-likelihood of an observation; a sighting is normal about the truth or, now and then, uniform.

    Parameters
    ----------
    observation : ndarray, shape (2 L,)
    states : ndarray, shape (N, 4)
    constants : Constants
    difference : callable
        Of measured and predicted bearings. `numpy.subtract` shows what forgetting to wrap costs.

    Returns
    -------
    ndarray, shape (N,)
    """
    rows, measured_ranges, measured_bearings = sightings(observation)
    ranges, bearings = observe(states, rows, constants)
    # log N(ρ; h_ρ(x), σ_ρ²) + log N(α; h_α(x), σ_α²) against log 1/(span_ρ span_α)
    normal = _log_normal((measured_ranges - ranges) / constants.sigma_rho, constants.sigma_rho)
    uniform = np.full(len(rows), -np.log(constants.range_span))
    has_bearing = np.isfinite(measured_bearings)
    if has_bearing.any():
        innovation = difference(measured_bearings[has_bearing], bearings[:, has_bearing])
        normal[:, has_bearing] += _log_normal(innovation / constants.sigma_alpha, constants.sigma_alpha)
        uniform[has_bearing] -= np.log(constants.bearing_span)
    inlier, outlier = np.log1p(-constants.outliers) + normal, np.log(constants.outliers) + uniform
    return np.logaddexp(inlier, outlier).sum(axis=1)


def sightings(observation):
    """Rows of the landmarks that were seen, and the ranges and bearings to them, each of shape (S,)."""
    ranges, bearings = np.split(observation, 2)
    rows = np.flatnonzero(np.isfinite(ranges))
    return rows, ranges[rows], bearings[rows]


def _log_normal(standardised, sigma):
    return -0.5 * standardised**2 - np.log(sigma * np.sqrt(2.0 * np.pi))
