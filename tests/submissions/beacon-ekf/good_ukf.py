"""An unscented filter: sigma points through f and through the sensors, no Jacobian, angles averaged as offsets."""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon.quadrotor import f
from course_lib.filters import Gaussian

N = 12
ALPHA, BETA, KAPPA = 0.5, 2.0, 0.0
LAMBDA = ALPHA**2 * (N + KAPPA) - N
W_MEAN = np.full(2 * N + 1, 0.5 / (N + LAMBDA))
W_MEAN[0] = LAMBDA / (N + LAMBDA)
W_COVARIANCE = W_MEAN.copy()
W_COVARIANCE[0] += 1 - ALPHA**2 + BETA


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        mean = np.zeros(N)
        mean[[0, 1, 2, 5]] = constants.start
        return Gaussian(mean, np.diag(np.repeat(np.square(constants.start_sigma), [3, 2, 1, 3, 3])))
    mean, P = forecast(*previous, control, constants)
    rows = np.isfinite(observation[:9])
    return correct(mean, P, observation[:9], rows, constants)


def sigma_points(mean, P):
    root = np.linalg.cholesky((N + LAMBDA) * P)
    return mean + np.concatenate([np.zeros((1, N)), root.T, -root.T])


def forecast(mean, P, control, constants):
    c = constants
    # The noise of the rotors enters like a state: as sigma points of its own it would not differ, f being affine in u.
    points = f(sigma_points(mean, P), control, c.Ts, c)
    mean = W_MEAN @ points
    spread = points - mean
    step = 1e-4
    to_u = (f(np.tile(mean, (4, 1)), control + step * np.eye(4), c.Ts, c) - f(mean, control, c.Ts, c)).T / step
    Q = to_u * (c.k * np.abs(control)) @ to_u.T
    Q += c.Ts * np.diag(np.repeat([0, c.sigma_v, c.sigma_w], [6, 3, 3]) ** 2)
    return mean, spread.T * W_COVARIANCE @ spread + Q


def correct(mean, P, z, rows, constants):
    points = sigma_points(mean, P)
    predicted = sensors(points, constants)
    # Relative to the first point's, bearings are small and can be averaged.
    offsets = predicted - predicted[0]
    offsets[:, 4:8] = wrap(offsets[:, 4:8])
    mean_offset = W_MEAN @ offsets
    spread = (offsets - mean_offset)[:, rows]
    innovation = np.where(rows, z, 0.0) - predicted[0] - mean_offset
    innovation[4:8] = wrap(innovation[4:8])
    c = constants
    R = np.diag(np.repeat([c.sigma_rho, c.sigma_alpha, c.sigma_a], [4, 4, 1])[rows] ** 2)
    S = spread.T * W_COVARIANCE @ spread + R
    gain = (points - mean).T * W_COVARIANCE @ spread @ np.linalg.inv(S)
    mean = mean + gain @ innovation[rows]
    mean[3:6] = wrap(mean[3:6])
    P = P - gain @ S @ gain.T
    return Gaussian(mean, (P + P.T) / 2)


def sensors(points, constants):
    r = constants.R / 2
    corners = np.array([[r, r], [-r, r], [-r, -r], [r, -r]])
    dx, dy = (corners[:, axis] - points[:, axis, None] for axis in (0, 1))
    dz = constants.h / 2 - points[:, 2, None]
    return np.hstack([np.sqrt(dx**2 + dy**2 + dz**2), np.arctan2(dy, dx) - points[:, 5, None], points[:, 2, None]])
