"""Extended Kalman filters with one fault each, to tell a student which one it is: their means are its fingerprint."""

import contextlib

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.constants import ANGLES, BEARINGS, MEASURED, RATES, VELOCITY, YAW
from course_lib.filters import Gaussian
from course_lib.recording import replay
from grader.assignments.beacon.expect import posterior


def kalman_filter(
    wrapped=True,
    yaw=True,
    level=False,
    deviation=False,
    gusts=1,
    rotors=1,
    steered=True,
    old="",
    zero=False,
    whole=False,
    moved=True,
    corrected=True,
    reduced=True,
):
    """An EKF made of the course's models, right or with one fault."""

    def estimator(previous, observation, control, constants, rng):
        if previous is None:
            return models.prior(constants)
        mean, before = previous
        control = control if steered else quadrotor.hover(constants)
        F_x, F_u = quadrotor.jacobians(mean, control, constants.Ts, constants)
        Q = np.zeros((12, 12))
        if rotors:
            Q += (F_u * (constants.k * np.abs(control)) ** rotors) @ F_u.T
        if gusts is not None:
            Q[VELOCITY, VELOCITY] += constants.sigma_v**2 * constants.Ts**gusts * np.eye(3)
            Q[RATES, RATES] += constants.sigma_w**2 * constants.Ts**gusts * np.eye(3)
        if moved:
            mean = quadrotor.f(mean, control, constants.Ts, constants)
        P = F_x @ before @ F_x.T + Q
        z = observation[:MEASURED]
        there = np.isfinite(z)
        if not corrected or (whole and not there.all()):
            return Gaussian(mean, P)
        predicted = models.observe(mean[None], constants)[0]
        H = models.observation_jacobian(mean, constants)
        if level:
            offset = (constants.beacons - mean[:3])[:, :2]
            predicted[:4] = np.linalg.norm(offset, axis=1)
            H[:4, :2], H[:4, 2] = -offset / predicted[:4, None], 0.0
        if wrapped is None:
            offset = constants.beacons - mean[:3]
            predicted[BEARINGS] = np.arctan2(offset[:, 1], offset[:, 0]) - mean[YAW]
        v = np.where(there, z, 0.0) - predicted
        if wrapped is True:
            v[BEARINGS] = wrap(v[BEARINGS])
        if not yaw:
            H[BEARINGS, YAW] = 0.0
        if zero:
            v, there = np.where(there, v, 0.0), np.ones(MEASURED, dtype=bool)
        v, H, sigma = v[there], H[there], constants.sigma_z[there]
        R = np.diag(sigma if deviation else sigma**2)
        if old == "prior":
            P = before
        S = H @ (before if old else P) @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        mean, A = mean + K @ v, np.eye(12) - K @ H
        mean[list(ANGLES)] = wrap(mean[list(ANGLES)])
        if reduced:
            P = A @ P @ A.T + K @ R @ K.T
        return Gaussian(mean, 0.5 * (P + P.T))

    return estimator


FAULTS = [
    (
        {"wrapped": False},
        "The bearings' innovations are not wrapped: see what happens when a beacon is straight behind.",
    ),
    (
        {"wrapped": None},
        "The bearings' innovations are not wrapped: see what happens when a beacon is straight behind.",
    ),
    ({"yaw": False}, "H has no θ column: yaw is never corrected, and bearings are believed as if it were known."),
    ({"level": True}, "The expected ranges are horizontal: they are measured through space."),
    ({"steered": False}, "The thrusts `control` are not used."),
    ({"deviation": True}, "R holds standard deviations: it takes the variances σ²."),
    ({"gusts": None}, "The gusts are missing in the covariance's prediction: the filter grows too sure."),
    ({"gusts": 0}, "σ_v and σ_w are per root of a second: a step's gusts have the variance σ² T_s."),
    ({"gusts": 2}, "A random walk's variance grows with T_s, not with its square: σ² T_s."),
    ({"rotors": 0}, "F_u Σ_u F_uᵀ is missing in the covariance's prediction."),
    ({"rotors": 2}, "k|u| is the variance of a thrust: it is squared here, as if a standard deviation."),
    (
        {"old": "innovation"},
        "The innovation's covariance takes P, of the last step: it must take P', the predicted one.",
    ),
    ({"old": "prior"}, "The update takes the covariance of the last step, P: it must take the predicted one, P'."),
    ({"zero": True}, "A missing reading is taken for one that agrees: leave out its rows of v, H and R."),
    ({"whole": True}, "A step with one reading missing loses all the others: leave out that reading's rows only."),
    ({"moved": False}, "The mean is not predicted: f moves it."),
    ({"corrected": False}, "No reading is used: the mean moves by f and is never corrected."),
    ({"reduced": False}, "The covariance is not reduced by the readings: take both results of `update`."),
]


def named_fault(function, run, constants):
    """Name of the fault with which a filter made of the models has the same means in a run; else nothing."""
    got = _means(function, run, constants)
    if not _agree(got, _means(kalman_filter(), run, constants)):
        for change, name in FAULTS:
            if _agree(got, _means(kalman_filter(**change), run, constants)):
                return name
    return ""


def _means(function, run, constants):
    """Means of a run, until one is none."""
    means = []
    with np.errstate(all="ignore"), contextlib.suppress(AssertionError, np.linalg.LinAlgError):
        for answer in replay(function, run, constants, np.random.default_rng(0)):
            means.append(posterior(answer, "Estimator")[0])
    return np.array(means).reshape(-1, 12)


def _agree(a, b):
    """Whether they are the same for as long as both last; the first is the prior."""
    both = min(len(a), len(b))
    apart = a[:both] - b[:both]
    apart[:, ANGLES] = wrap(apart[:, ANGLES])
    return both > 1 and bool((np.abs(apart) <= 1e-6 * (1 + np.abs(b[:both]))).all())
