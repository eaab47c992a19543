"""What is known of the recorded robots: what truth says of one, for use on another of its make, and what files say.

Errors of a camera are not independent: a wrong focal length or a barcode seen at an angle errs the same way in every
picture of a view, and wheels slip the same way all through a turn. A filter multiplies likelihoods as if they were, and
believes too much. So each standard deviation here is that of independent errors whose sum over a window varies as
much as that of the true ones.
"""

import numpy as np
from scipy.optimize import least_squares

from course_lib.angles import wrap
from course_lib.beacon.planar.robot import Constants

#: How long errors are taken to hang together (s): longer than a landmark stays in view.
WINDOW = 10.0
#: Delays that are tried (s).
DELAYS = np.arange(0.0, 0.51, 0.05)
#: A sighting farther off than this many (robust) standard deviations is an outlier.
OUTLIER = 5.0

#: What the labyrinth's files say of it: standard deviations of a range (m) and of a wheel's velocity (m/s), time
#: between readings (s) and distance of the wheels (m).
LABYRINTH_RANGE, LABYRINTH_WHEEL, LABYRINTH_PERIOD, LABYRINTH_TRACK = 0.1, 0.01, 0.128, 0.157


def labyrinth(recording, **others):
    """What the filters are told of the labyrinth's robot: the noise that its files state, nothing fitted to truth.

    Parameters
    ----------
    recording : GroundRecording
        As from `read_uwb`.
    **others
        Of `Constants`, in place of these. The bias of the ranges is estimated with the pose, by default.

    Returns
    -------
    Constants
    """
    told = {
        "sigma_v": LABYRINTH_WHEEL / np.sqrt(2.0) * np.sqrt(LABYRINTH_PERIOD),
        "sigma_omega": LABYRINTH_WHEEL * np.sqrt(2.0) / LABYRINTH_TRACK * np.sqrt(LABYRINTH_PERIOD),
        "sigma_rho": LABYRINTH_RANGE,
        "range_span": float(np.hypot(*np.ptp(recording.landmarks, axis=0))),
        "bias_sigma": 0.3,
        "bias_walk": 0.01,
        "N": 5000,
    }
    return Constants(recording.landmarks, **(told | others))


def calibrate(recording, depth=True, window=WINDOW):
    """Fit odometry and camera to the truth of a recording.

    Parameters
    ----------
    recording : GroundRecording
        With true headings, and bearings.
    depth : bool
        Whether the ranges are depths along the camera's axis, as MRCLAM's are.
    window : float
        How long errors hang together (s).

    Returns
    -------
    Constants
    """
    return Constants(recording.landmarks, **_motion(recording, window), **_camera(recording, depth, window))


def sighting_residuals(recording, depth=True):
    """How far sightings are from what a perfect sensor would have read.

    Parameters
    ----------
    recording : GroundRecording
    depth : bool

    Returns
    -------
    times : ndarray, shape (M,)
        Of those made while truth was recorded.
    expected, residual : ndarray, shape (M, 2)
        Ranges (m) or depths, and bearings (rad); what was read minus these.
    """
    poses = recording.truth_at(recording.sighting_times)
    dx, dy = (recording.landmarks[recording.sighted] - poses[:, :2]).T
    bearings = wrap(np.arctan2(dy, dx) - poses[:, 2])
    ranges = np.hypot(dx, dy) * (np.cos(bearings) if depth else 1.0)
    known = np.isfinite(ranges)
    residual = np.column_stack([recording.ranges - ranges, wrap(recording.bearings - bearings)])
    return recording.sighting_times[known], np.column_stack([ranges, bearings])[known], residual[known]


def _motion(recording, window):
    heading = np.unwrap(recording.truth[:, 2])
    begin = max(recording.odometry_times[0] + DELAYS[-1], recording.truth_times[0])
    end = min(recording.odometry_times[-1], recording.truth_times[-1])
    times = np.arange(begin, end, 1.0)
    x, y, theta = (np.interp(times, recording.truth_times, each) for each in (*recording.truth[:, :2].T, heading))
    turned = np.diff(theta)
    middle = theta[:-1] + 0.5 * turned
    advanced = np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle)
    fits = []
    for delay in DELAYS:
        told_v, told_omega = (np.diff(recording.integrated(column, times, delay)) for column in (0, 1))
        v_scale = advanced @ told_v / (told_v @ told_v)
        omega_scale, omega_offset = np.polyfit(told_omega, turned, 1)
        errors = advanced - v_scale * told_v, turned - omega_scale * told_omega - omega_offset
        fits.append((np.var(errors[1]), delay, v_scale, omega_scale, omega_offset, errors))
    _, delay, v_scale, omega_scale, omega_offset, errors = min(fits, key=lambda fit: fit[0])
    # Per second of time, as the errors are.
    sigma_v, sigma_omega = (_as_if_independent(times[:-1], error, window) for error in errors)
    return {
        "delay": float(delay),
        "v_scale": v_scale,
        "omega_scale": omega_scale,
        "omega_offset": omega_offset,
        "sigma_v": sigma_v,
        "sigma_omega": sigma_omega,
    }


def _camera(recording, depth, window):
    times, expected, residual = sighting_residuals(recording, depth)
    # Few outliers, but far ones: a loss that grows linearly keeps them from bending the line.
    scale, offset = least_squares(
        lambda line: residual[:, 0] + (1.0 - line[0]) * expected[:, 0] - line[1],
        [1.0, 0.0],
        loss="soft_l1",
        f_scale=0.05,
    ).x
    bearing_offset = np.median(residual[:, 1])
    errors = np.column_stack(
        [residual[:, 0] + (1.0 - scale) * expected[:, 0] - offset, residual[:, 1] - bearing_offset]
    )
    # 1.4826 MAD is the standard deviation of a normal distribution.
    inlying = (np.abs(errors) < OUTLIER * 1.4826 * np.median(np.abs(errors), axis=0)).all(axis=1)
    sigma_rho, sigma_alpha = (_as_if_independent(times[inlying], error, window) for error in errors[inlying].T)
    return {
        "depth": depth,
        "range_scale": scale,
        "range_offset": offset,
        "bearing_offset": bearing_offset,
        "sigma_rho": sigma_rho,
        "sigma_alpha": sigma_alpha,
        "outliers": max(1.0 - inlying.mean(), 1e-3),
    }


def _as_if_independent(times, errors, window):
    """Root of Σ (sum of a window)² / Σ (number in it): of independent errors, their standard deviation."""
    _, index = np.unique(times // window, return_inverse=True)
    sums, numbers = np.bincount(index, errors), np.bincount(index)
    return float(np.sqrt(sums @ sums / numbers.sum()))
