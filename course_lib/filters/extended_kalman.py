"""The extended Kalman filter on Gaussians, one function per step; the arithmetic is filterpy's.

    gaussian = extended_kalman.predict(gaussian, f(mean, u), F, Q, angles)
    gaussian, log_evidence = extended_kalman.update(gaussian, innovation, H, R, angles)

The caller evaluates the models at `gaussian.mean`. `residual` makes the innovation: differences of angles are wrapped
there and, of `gaussian.mean`, in the columns that `angles` names. A missing reading is a row less of innovation, H and
R. `nis` says how surprising an innovation is, before the update: for gates and for consistency.

Not among the names of `course_lib.filters`, because filterpy takes more than a second to import.

References
----------
Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, Wiley 2001,
sec. 5.2 to 5.4 and 10.3.
"""

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.linalg import cho_factor, cho_solve

from course_lib.angles import wrap
from course_lib.filters.particles import Gaussian


def predict(gaussian, mean, F, Q, angles=()):
    """Prior update.

    Parameters
    ----------
    gaussian : Gaussian
        Posterior at time k - 1: mean (d,), covariance (d, d).
    mean : ndarray, shape (d,)
        f(x̂ₖ₋₁, uₖ): where the motion model takes the old mean.
    F : ndarray, shape (d, d)
        ∂f/∂x at the old mean.
    Q : ndarray, shape (d, d)
        Covariance of the noise that the step adds.
    angles : sequence of int
        Columns of the state that hold angles in radians: wrapped to [-π, π).

    Returns
    -------
    Gaussian
        Covariance F P Fᵀ + Q, symmetric.
    """
    kf = _filter(gaussian, 1)
    kf.F, kf.Q = F, Q
    kf.predict()
    return _gaussian(mean, kf.P, angles)


def update(gaussian, innovation, H, R, angles=()):
    """Measurement update.

    Parameters
    ----------
    gaussian : Gaussian
        Prior at time k: mean (d,), covariance (d, d).
    innovation : ndarray, shape (m,)
        z - h(x̂), as `residual` makes it; without rows for missing readings. With no row at all nothing changes.
    H : ndarray, shape (m, d)
        ∂h/∂x at the prior's mean.
    R : ndarray, shape (m, m)
        Covariance of the readings' noise.
    angles : sequence of int
        Columns of the state that hold angles in radians: wrapped to [-π, π).

    Returns
    -------
    gaussian : Gaussian
        Posterior. Joseph's form (I - K H) P (I - K H)ᵀ + K R Kᵀ, made symmetric to the last bit.
    log_evidence : float
        log N(v; 0, H P Hᵀ + R), which is log p(zₖ | z₁, ..., zₖ₋₁) to first order.

    Raises
    ------
    ValueError
        The innovation is not finite, or not of one row with H and R.
    """
    innovation = _checked(innovation, H, R)
    if not len(innovation):
        return gaussian, 0.0
    kf = _filter(gaussian, len(innovation))
    kf.update(innovation, lambda state: H, lambda state: 0.0, R)
    # filterpy's own log_likelihood goes through scipy.stats, which takes longer than the update.
    return _gaussian(kf.x, kf.P, angles), _log_normal(innovation, kf.S)


def nis(gaussian, innovation, H, R):
    """Normalised innovation squared vᵀ S⁻¹ v, S = H P Hᵀ + R: of a consistent filter it is χ² distributed, m degrees.

    Parameters as in `update`; a float, 0 when there is no row.
    """
    innovation = _checked(innovation, H, R)
    if not len(innovation):
        return 0.0
    return float(innovation @ np.linalg.solve(H @ gaussian.covariance @ H.T + R, innovation))


def residual(observed, predicted, angles=()):
    """Observed minus predicted readings, shape (m,); differences wrapped in the rows that `angles` names."""
    difference = np.subtract(observed, predicted, dtype=float)
    rows = list(angles)
    difference[rows] = wrap(difference[rows])
    return difference


def _filter(gaussian, rows):
    kf = ExtendedKalmanFilter(len(gaussian.mean), rows)
    kf.x, kf.P = gaussian
    return kf


def _gaussian(mean, covariance, angles):
    mean = np.array(mean, dtype=float)
    columns = list(angles)
    mean[columns] = wrap(mean[columns])
    # Joseph's form is symmetric in exact arithmetic only.
    return Gaussian(mean, 0.5 * (covariance + covariance.T))


def _checked(innovation, H, R):
    innovation = np.asarray(innovation, dtype=float)
    m = len(innovation)
    if innovation.ndim != 1 or len(H) != m or np.shape(R) != (m, m):
        raise ValueError(
            f"innovation {innovation.shape}, H {np.shape(H)} and R {np.shape(R)} must have the same rows: "
            "(m,), (m, d), (m, m)"
        )
    if not np.isfinite(innovation).all():
        raise ValueError(f"the innovation must be finite, got {innovation}: leave out the rows of missing readings")
    return innovation


def _log_normal(v, S):
    factor = cho_factor(S, lower=True)
    log_determinant = 2.0 * np.log(np.diag(factor[0])).sum()
    return float(-0.5 * (v @ cho_solve(factor, v) + log_determinant + len(v) * np.log(2.0 * np.pi)))
