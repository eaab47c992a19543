"""The worked examination's filter: positions computed from readings, their errors by yaw left out of H."""

import numpy as np
from scipy.linalg import block_diag

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
    """Innovations of positions: one from each beacon whose range and bearing are there, and the altitude."""
    residuals, rows, noise = [], [], []
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    a = observation[8]
    for i in range(4):
        rho, alpha = observation[i], observation[4 + i]
        if not (np.isfinite(rho) and np.isfinite(alpha)):
            continue
        rho_xy = np.sqrt(max(rho**2 - (constants.h / 2 - a) ** 2, 1e-4))
        towards = np.array([np.cos(mean[YAW] + alpha), np.sin(mean[YAW] + alpha)])
        # x_i = R/2 - rho_xy cos(theta + alpha), and by the signs of its corner
        position = signs[i] * constants.R / 2 - rho_xy * towards
        G = np.column_stack([-rho / rho_xy * towards, rho_xy * np.array([towards[1], -towards[0]])])
        residuals += list(position - mean[:2])
        rows += [0, 1]
        noise.append(G @ np.diag([constants.sigma_rho**2, constants.sigma_alpha**2]) @ G.T)
    residuals.append(a - mean[2])
    rows.append(2)
    noise.append(np.array([[constants.sigma_a**2]]))
    v, H, R = np.array(residuals), np.eye(12)[rows], block_diag(*noise)
    # G R G^T + H P H^T
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    mean = mean + K @ v
    mean[ANGLES] = wrap(mean[ANGLES])
    I_KH = np.eye(12) - K @ H
    P = I_KH @ P @ I_KH.T + K @ R @ K.T
    return Gaussian(mean, 0.5 * (P + P.T))
