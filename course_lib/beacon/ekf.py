"""Extended Kalman filters of the quadrotor: (a) the source's, on positions inverted from readings; (b) on the readings.

    gaussian = models.prior(constants)
    for observation, control in zip(run.observations, run.controls):
        gaussian, log_evidence, nis, rows = raw_step(gaussian, observation, control, constants)

(a) is completed in the plain way where the source stops, and each of its shortcuts is a field of `Repairs`.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from course_lib.beacon import geometry, models, quadrotor
from course_lib.beacon.constants import ALTITUDE, ANGLES, BEARINGS, MEASURED, RANGES, YAW, X, Y, Z
from course_lib.filters import Gaussian, extended_kalman


class Outcome(NamedTuple):
    """What one step of a filter made of its readings.

    Attributes
    ----------
    posterior : Gaussian
        mean (12,), covariance (12, 12).
    log_evidence : float
        log p(readings | readings before), in the units of the readings: metres and radians for (a), too.
    nis : float
        vᵀ S⁻¹ v: χ² with `rows` degrees of freedom when the filter is consistent.
    rows : int
        Length of the innovation.
    """

    posterior: Gaussian
    log_evidence: float
    nis: float
    rows: int


@dataclass(frozen=True)
class Repairs:
    """What is mended in the source's filter; without arguments, nothing.

    Attributes
    ----------
    range_of_its_own : bool
        Beacon 2's position takes ρ_xy,2; as written, ρ_xy,1.
    yaw : bool
        H has the column of θ, by which every measured position turns; as written, θ is taken for known.
    altitude : bool
        G has the column of a, by which every ρ_xy is computed.
    correlations : bool
        The positions share the error of a (with `altitude`; without, there is nothing to share): as written, each has
        its own.
    predicted : bool
        The innovation's covariance takes P', as its mean takes X'; as written, P of the step before.
    gusts : bool
        The process noise has what the air adds; as written, Σ_u = diag(k |u|) alone.
    """

    range_of_its_own: bool = False
    yaw: bool = False
    altitude: bool = False
    correlations: bool = False
    predicted: bool = False
    gusts: bool = False


#: Nothing left to mend but what inversion itself costs: nonlinear in noisy readings.
ALL = Repairs(**{field.name: True for field in fields(Repairs)})


def predict(gaussian, control, constants, gusts=True):
    """Question 2 b: X' = f(X, U, Δt), P' = F_x P F_xᵀ + F_u Σ_u F_uᵀ, and the gusts.

    Parameters
    ----------
    gaussian : Gaussian
    control : ndarray, shape (4,)
        Commanded thrusts u in N.
    constants : Constants
    gusts : bool
        Whether the process noise has them.

    Returns
    -------
    Gaussian
    """
    mean, F_x, F_u = quadrotor.linearised(
        np.array(gaussian.mean, dtype=float),
        np.array(control, dtype=float),
        constants.Ts,
        quadrotor.parameters(constants),
    )
    if gusts:
        Q = models.process_covariance(F_u, control, constants)
    else:
        Q = (F_u * (constants.k * np.abs(control))) @ F_u.T
    return extended_kalman.predict(gaussian, mean, F_x, Q, ANGLES)


def raw_step(gaussian, observation, control, constants):
    """(b): the innovation is of ranges, wrapped bearings and altitude.

    Parameters
    ----------
    gaussian : Gaussian
        Posterior at time k - 1.
    observation : ndarray, shape (11,)
        `inf` where missing.
    control : ndarray, shape (4,)
    constants : Constants

    Returns
    -------
    Outcome
    """
    gaussian = predict(gaussian, control, constants)
    v, H, R = raw_innovation(gaussian, observation, constants)
    return _corrected(gaussian, v, H, R)


def raw_innovation(gaussian, observation, constants):
    """What `raw_step` makes of the readings that are there.

    Returns
    -------
    v : ndarray, shape (m,)
    H : ndarray, shape (m, 12)
    R : ndarray, shape (m, m)
    """
    there = np.isfinite(observation[:MEASURED])
    predicted = models.observe(gaussian.mean[None], constants)[0]
    v = models.innovation(observation, predicted)[there]
    H = models.observation_jacobian(gaussian.mean, constants)[there]
    return v, H, np.diag(constants.sigma_z[there] ** 2)


def source_step(gaussian, observation, control, constants, repairs=Repairs()):
    """(a): the innovation is of four positions, each from one beacon, and the altitude.

    A beacon counts when its range and bearing are there and its ρ_xy has an answer (as written: the filter would be NaN
    from then on).

    Parameters
    ----------
    gaussian, observation, control, constants
        As in `raw_step`.
    repairs : Repairs

    Returns
    -------
    Outcome
        Its log-evidence holds the factor ρᵢ of each beacon, |∂(x, y)/∂(ρ, α)| = ρ_xy · ρ / ρ_xy, so that it is the
        density of the readings and compares with (b)'s where every reading is there.
    """
    before = gaussian
    gaussian = predict(before, control, constants, repairs.gusts)
    v, H, R, log_slopes = source_innovation(gaussian, observation, constants, repairs)
    if not repairs.predicted:
        # Σ_v = G R Gᵀ + H P Hᵀ, and K = P' Hᵀ Σ_v⁻¹: what an update with P' makes of this R.
        R = R + H @ (before.covariance - gaussian.covariance) @ H.T
    outcome = _corrected(gaussian, v, H, R)
    return outcome._replace(log_evidence=outcome.log_evidence + log_slopes)


def source_innovation(gaussian, observation, constants, repairs=Repairs()):
    """Question 2 c: the pseudo-measurements' innovation and what its covariance is made of.

    Parameters
    ----------
    gaussian : Gaussian
        Prior at time k.
    observation, constants, repairs
        As in `source_step`.

    Returns
    -------
    v : ndarray, shape (m,)
        x₁ - x', y₁ - y', ..., a - z'; without the rows of beacons that do not count.
    H : ndarray, shape (m, 12)
    GRG : ndarray, shape (m, m)
        G R Gᵀ.
    log_slopes : float
        Σ log ρᵢ over the beacons that count.
    """
    ranges, bearings, a = observation[RANGES].copy(), observation[BEARINGS], observation[ALTITUDE]
    if not repairs.range_of_its_own:
        ranges[1] = ranges[0]
    yaw = gaussian.mean[YAW]
    positions = geometry.position(range(4), ranges, bearings, a, yaw, constants)
    slopes = geometry.position_jacobian(range(4), ranges, bearings, a, yaw, constants)
    v, H, G = np.full(9, np.inf), np.zeros((9, 12)), np.zeros((9, MEASURED))
    for i in range(4):
        rows = [2 * i, 2 * i + 1]
        v[rows] = positions[i, :2] - gaussian.mean[[X, Y]]
        H[rows, [X, Y]] = 1.0
        if repairs.yaw:
            # p_i(θ̂) - p̂ ≈ (p - p̂) + ∂p_i/∂θ (θ̂ - θ)
            H[rows, YAW] = -slopes[i, :2, 3]
        G[rows, i], G[rows, 4 + i] = slopes[i, :2, 0], slopes[i, :2, 1]
        if repairs.altitude:
            G[rows, ALTITUDE] = slopes[i, :2, 2]
    v[8], H[8, Z], G[8, ALTITUDE] = a - gaussian.mean[Z], 1.0, 1.0
    there = np.isfinite(v)
    v, H, G = v[there], H[there], G[there]
    GRG = (G * constants.sigma_z**2) @ G.T
    if not repairs.correlations:
        beacon = np.repeat(range(5), [2, 2, 2, 2, 1])[there]
        GRG[beacon[:, None] != beacon] = 0.0
    return v, H, GRG, float(np.log(ranges[there[:8:2]]).sum())


def _corrected(gaussian, v, H, R):
    nis = extended_kalman.nis(gaussian, v, H, R)
    posterior, log_evidence = extended_kalman.update(gaussian, v, H, R, ANGLES)
    return Outcome(posterior, log_evidence, nis, len(v))
