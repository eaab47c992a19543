"""Motion and measurement models of the quadrotor, vectorised over particles.

Observations are rows ρ₁...ρ₄, α₁...α₄, a, r, β (`beacon.constants`); only the first nine say something about the state,
and what is missing is `inf`.
"""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import quadrotor
from course_lib.beacon.constants import ANGLES, BEARINGS, MEASURED, RATES, VELOCITY, YAW, X, Y, Z
from course_lib.filters import Gaussian


def prior(constants):
    """The distribution of the first state.

    Returns
    -------
    Gaussian
        mean (12,), covariance (12, 12), diagonal.
    """
    x, y, z, yaw = constants.start
    mean = np.array([x, y, z, 0.0, 0.0, yaw, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    deviations = np.repeat(constants.start_sigma, [3, 2, 1, 3, 3])
    return Gaussian(mean, np.diag(deviations**2))


def sample_prior(n, constants, rng):
    """Draw n first states, shape (n, 12)."""
    mean, covariance = prior(constants)
    states = mean + np.sqrt(np.diag(covariance)) * rng.standard_normal((n, 12))
    states[:, ANGLES] = wrap(states[:, ANGLES])
    return states


def transition(states, control, constants, rng, gain=1.0):
    """Draw each state's successor.

    Parameters
    ----------
    states : ndarray, shape (N, 12)
    control : ndarray, shape (4,)
        Commanded thrusts u over one sampling time, in N.
    constants : Constants
    rng : numpy.random.Generator
    gain : float
        Scales the variance of the rotors' noise.

    Returns
    -------
    ndarray, shape (N, 12)
        f(X, u + n, T_s) + gusts; n has the variances k |u|. Angles wrapped to [-π, π).
    """
    n = len(states)
    # Σ_u = diag(k |u_i|)
    thrusts = control + np.sqrt(gain * constants.k * np.abs(control)) * rng.standard_normal((n, 4))
    states = quadrotor.f(states, thrusts, constants.Ts, constants)
    gusts = np.sqrt(constants.Ts) * rng.standard_normal((n, 6))
    states[:, VELOCITY] += constants.sigma_v * gusts[:, :3]
    states[:, RATES] += constants.sigma_w * gusts[:, 3:]
    states[:, ANGLES] = wrap(states[:, ANGLES])
    return states


def process_covariance(F_u, control, constants):
    """Covariance of one step's noise, to first order: F_u Σ_u F_uᵀ and the gusts.

    Parameters
    ----------
    F_u : ndarray, shape (12, 4)
    control : ndarray, shape (4,)
    constants : Constants

    Returns
    -------
    ndarray, shape (12, 12)
        Of full rank in velocity and rates, whatever u is; the source's alone vanishes with u.
    """
    Q = (F_u * (constants.k * np.abs(control))) @ F_u.T
    Q[range(6, 9), range(6, 9)] += constants.sigma_v**2 * constants.Ts
    Q[range(9, 12), range(9, 12)] += constants.sigma_w**2 * constants.Ts
    return Q


def observe(states, constants):
    """What noiseless sensors would say.

    Parameters
    ----------
    states : ndarray, shape (N, 12)
    constants : Constants

    Returns
    -------
    ndarray, shape (N, 9)
        ρᵢ = ‖bᵢ - p‖ in metres, αᵢ = atan2(bᵢ - p) - θ in [-π, π), a = z.
    """
    offset = constants.beacons[None] - states[:, None, :3]
    z = np.empty((len(states), MEASURED))
    z[:, :4] = np.sqrt(np.einsum("nij,nij->ni", offset, offset))
    z[:, BEARINGS] = wrap(np.arctan2(offset[:, :, 1], offset[:, :, 0]) - states[:, YAW, None])
    z[:, 8] = states[:, Z]
    return z


def observation_jacobian(state, constants):
    """∂z/∂X at one state (12,), shape (9, 12)."""
    offset = constants.beacons - state[:3]
    H = np.zeros((MEASURED, 12))
    # ∂ρ/∂p = -(b - p)ᵀ / ρ
    H[:4, :3] = -offset / np.linalg.norm(offset, axis=1)[:, None]
    # ∂α/∂(x, y) = (b_y - y, -(b_x - x)) / ρ_xy²,  ∂α/∂θ = -1
    square = offset[:, 0] ** 2 + offset[:, 1] ** 2
    H[BEARINGS, X], H[BEARINGS, Y], H[BEARINGS, YAW] = offset[:, 1] / square, -offset[:, 0] / square, -1.0
    H[8, Z] = 1.0
    return H


def innovation(observation, predicted):
    """Observed minus predicted, bearings wrapped; NaN where a reading is missing.

    Parameters
    ----------
    observation : ndarray, shape (9,) or more
    predicted : ndarray, shape (N, 9) or (9,)

    Returns
    -------
    ndarray, shape of `predicted`
    """
    readings = np.asarray(observation)[:MEASURED]
    v = np.where(np.isfinite(readings), readings, np.nan) - predicted
    v[..., BEARINGS] = wrap(v[..., BEARINGS])
    return v


def log_likelihood(observation, states, constants):
    """Logarithm of the density of an observation given each state.

    Parameters
    ----------
    observation : ndarray, shape (11,)
    states : ndarray, shape (N, 12)
    constants : Constants

    Returns
    -------
    ndarray, shape (N,)
        Σ log N(vᵢ; 0, σᵢ²) over the readings that are there; 0 when there are none.
    """
    there = np.isfinite(observation[:MEASURED])
    sigma = constants.sigma_z[there]
    v = innovation(observation, observe(states, constants))[:, there] / sigma
    return -0.5 * np.einsum("ni,ni->n", v, v) - np.log(sigma).sum() - 0.5 * len(sigma) * np.log(2 * np.pi)
