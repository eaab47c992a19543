"""filterpy's ExtendedKalmanFilter with a residual that wraps bearings; predicted by hand, for f is no matrix."""

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from course_lib.angles import wrap
from course_lib.beacon.quadrotor import f, jacobians
from course_lib.filters import Gaussian, Step

ROWS = np.arange(9)


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        ekf = start(constants)
    else:
        ekf = previous.memory
        predict(ekf, control, constants)
        update(ekf, observation, constants)
    return Step(Gaussian(ekf.x.ravel(), ekf.P), ekf)


def start(constants):
    ekf = ExtendedKalmanFilter(dim_x=12, dim_z=9)
    ekf.x = np.zeros(12)
    ekf.x[[0, 1, 2, 5]] = constants.start
    ekf.P = np.diag(np.repeat(constants.start_sigma, [3, 2, 1, 3, 3]) ** 2)
    return ekf


def predict(ekf, control, constants):
    F, B = jacobians(ekf.x, control, constants.Ts, constants)
    Q = B @ np.diag(constants.k * np.abs(control)) @ B.T
    Q[6:9, 6:9] += np.eye(3) * constants.sigma_v**2 * constants.Ts
    Q[9:12, 9:12] += np.eye(3) * constants.sigma_w**2 * constants.Ts
    ekf.x = f(ekf.x, control, constants.Ts, constants)
    ekf.P = F @ ekf.P @ F.T + Q


def update(ekf, observation, constants):
    rows = ROWS[np.isfinite(observation[:9])]
    sigmas = np.array([constants.sigma_rho] * 4 + [constants.sigma_alpha] * 4 + [constants.sigma_a])

    def residual(z, predicted):
        difference = z - predicted
        bearings = (rows >= 4) & (rows < 8)
        difference[bearings] = wrap(difference[bearings])
        return difference

    ekf.update(
        observation[rows],
        HJacobian=lambda x: derivatives(x, constants)[rows],
        Hx=lambda x: readings(x, constants)[rows],
        R=np.diag(sigmas[rows] ** 2),
        residual=residual,
    )
    ekf.x[3:6] = wrap(ekf.x[3:6])
    ekf.P = (ekf.P + ekf.P.T) / 2


def to_beacons(x, constants):
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    corners = np.column_stack([signs * constants.R / 2, np.full(4, constants.h / 2)])
    return corners - x[:3]


def readings(x, constants):
    d = to_beacons(x, constants)
    return np.concatenate([np.linalg.norm(d, axis=1), np.arctan2(d[:, 1], d[:, 0]) - x[5], [x[2]]])


def derivatives(x, constants):
    d = to_beacons(x, constants)
    H = np.zeros((9, 12))
    H[:4, :3] = -d / np.linalg.norm(d, axis=1, keepdims=True)
    H[4:8, [0, 1]] = d[:, [1, 0]] * [1, -1] / (d[:, :2] ** 2).sum(axis=1, keepdims=True)
    H[4:8, 5] = -1
    H[8, 2] = 1
    return H
