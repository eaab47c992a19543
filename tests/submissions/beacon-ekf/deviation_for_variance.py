"""The readings' standard deviations stand in R, where variances belong."""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import quadrotor
from course_lib.filters import Gaussian

ANGLES = [3, 4, 5]
YAW = 5


def Estimator(previous, observation, control, constants, rng):
    if previous is None:
        return draw_up_prior(constants)
    mean, P = predict(previous.mean, previous.covariance, control, constants)
    return correct(mean, P, observation, constants)


def draw_up_prior(constants):
    """The first state: position and yaw as told, level and at rest."""
    x, y, z, yaw = constants.start
    mean = np.array([x, y, z, 0.0, 0.0, yaw, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    sigma = np.repeat(constants.start_sigma, [3, 2, 1, 3, 3])
    return Gaussian(mean, np.diag(sigma**2))


def predict(mean, P, control, constants):
    """P' = F_x P F_x^T + F_u Sigma_u F_u^T + gusts."""
    F_x, F_u = quadrotor.jacobians(mean, control, constants.Ts, constants)
    mean = quadrotor.f(mean, control, constants.Ts, constants)
    Sigma_u = np.diag(constants.k * np.abs(control))
    gusts = np.zeros(12)
    gusts[6:9] = constants.sigma_v**2 * constants.Ts
    gusts[9:12] = constants.sigma_w**2 * constants.Ts
    return mean, F_x @ P @ F_x.T + F_u @ Sigma_u @ F_u.T + np.diag(gusts)


def correct(mean, P, observation, constants):
    """Gain, mean and covariance after the readings that are there."""
    there = np.isfinite(observation[:9])
    z, H = expected(mean, constants)
    v = np.where(there, observation[:9], z) - z
    v[4:8] = wrap(v[4:8])
    sigma = np.repeat([constants.sigma_rho, constants.sigma_alpha, constants.sigma_a], [4, 4, 1])
    v, H, R = v[there], H[there], np.diag(sigma[there])
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    mean = mean + K @ v
    mean[ANGLES] = wrap(mean[ANGLES])
    # P = (I - K H) P' (I - K H)^T + K R K^T
    I_KH = np.eye(12) - K @ H
    P = I_KH @ P @ I_KH.T + K @ R @ K.T
    return Gaussian(mean, 0.5 * (P + P.T))


def expected(mean, constants):
    """Readings (9,) of a vehicle in this state, and their derivatives (9, 12)."""
    r, h = constants.R / 2, constants.h / 2
    beacons = np.array([[r, r, h], [-r, r, h], [-r, -r, h], [r, -r, h]])
    z, H = np.empty(9), np.zeros((9, 12))
    for i, beacon in enumerate(beacons):
        dx, dy, dz = beacon - mean[:3]
        rho, rho_xy = np.sqrt(dx**2 + dy**2 + dz**2), np.hypot(dx, dy)
        z[i] = rho
        H[i, :3] = -dx / rho, -dy / rho, -dz / rho
        z[4 + i] = np.arctan2(dy, dx) - mean[YAW]
        H[4 + i, :2] = dy / rho_xy**2, -dx / rho_xy**2
        H[4 + i, YAW] = -1.0
    z[8] = mean[2]
    H[8, 2] = 1.0
    return z, H
