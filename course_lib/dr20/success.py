"""When a run counts as localized: judged from one pose estimate for each step, and the truth.

An estimate is near when it is within 0.3 m and 15° of the truth. It has converged when it is near and stays so for a
second: a mean that crosses the truth on its way does not count.
"""

from typing import NamedTuple

import numpy as np

from course_lib.angles import wrap
from course_lib.dr20.constants import HEADING

#: Near is within these, in metres and radians,
NEAR_POSITION = 0.3
NEAR_HEADING = np.radians(15.0)
#: and convergence is near for as long as this, in seconds.
HOLD = 1.0
#: A success is near for this share of the time after convergence.
KEPT = 0.9
#: A robot that is displaced by more than this in one step, in metres, has not driven there.
JUMP = 1.0


class Judgement(NamedTuple):
    """What became of one run.

    Attributes
    ----------
    position : ndarray, shape (T + 1,)
        Error of each estimate in metres.
    heading : ndarray, shape (T + 1,)
        Error in radians, between 0 and π.
    near : ndarray of bool, shape (T + 1,)
    converged : float
        Time in seconds from which on the estimate is near for a second; `inf` when it never is.
    kept : float
        Share of the time from then on in which it is near; 0 without convergence.
    success : bool
        Converged, near for 90 % of the time afterwards, and near at the end.
    """

    position: np.ndarray
    heading: np.ndarray
    near: np.ndarray
    converged: float
    kept: float
    success: bool


class Recoveries(NamedTuple):
    """What became of the kidnappings of one run, K of them.

    Attributes
    ----------
    at : ndarray, shape (K,)
        Time in seconds at which the robot was carried away.
    recovered : ndarray, shape (K,)
        Seconds from then until the estimate is near, for a second and before the next kidnapping; `inf` when it is not.
    watched : ndarray, shape (K,)
        Seconds until the next kidnapping or the end of the run: a recovery can be seen only if it takes a second less.
    """

    at: np.ndarray
    recovered: np.ndarray
    watched: np.ndarray


def errors(estimates, truth):
    """Errors of poses.

    Parameters
    ----------
    estimates, truth : array_like, shape (..., 3)
        x, y (m), θ (rad).

    Returns
    -------
    position : ndarray, shape (...)
        Metres.
    heading : ndarray, shape (...)
        Radians, between 0 and π.
    """
    difference = np.asarray(estimates, dtype=float) - truth
    return np.hypot(difference[..., 0], difference[..., 1]), np.abs(wrap(difference[..., HEADING]))


def near(position, heading):
    """Which errors, in metres and radians, are those of a robot that knows where it is; NaN is not."""
    return (position <= NEAR_POSITION) & (heading <= NEAR_HEADING)


def judge(estimates, truth, Ts):
    """Judge a run in which nobody carried the robot away.

    Parameters
    ----------
    estimates : array_like, shape (T + 1, 3)
        At times 0, Ts, ..., T Ts.
    truth : ndarray, shape (T + 1, 3)
    Ts : float
        Seconds.

    Returns
    -------
    Judgement
    """
    position, heading = _checked(estimates, truth)
    is_near = near(position, heading)
    first = _converged(is_near, Ts)
    if first is None:
        return Judgement(position, heading, is_near, np.inf, 0.0, False)
    kept = float(is_near[first:].mean())
    return Judgement(position, heading, is_near, first * Ts, kept, bool(kept >= KEPT and is_near[-1]))


def recoveries(estimates, truth, Ts):
    """Judge each kidnapping of a run.

    Parameters
    ----------
    estimates, truth, Ts
        As in `judge`.

    Returns
    -------
    Recoveries
    """
    is_near = near(*_checked(estimates, truth))
    first = kidnapped(truth)
    last = np.append(first, len(truth))[1:]
    found = [_converged(is_near[a:b], Ts) for a, b in zip(first, last, strict=True)]
    # It was carried away at the time of the pose before the first at the new place.
    recovered = np.array([np.inf if k is None else (k + 1) * Ts for k in found])
    return Recoveries((first - 1) * Ts, recovered, (last - first) * Ts)


def kidnapped(truth):
    """The kidnappings in a run, found where the truth jumps.

    Parameters
    ----------
    truth : ndarray, shape (T + 1, 3)

    Returns
    -------
    ndarray of int, shape (K,)
        Rows of the first pose at each new place.
    """
    displaced = np.diff(np.asarray(truth)[:, :2], axis=0)
    return np.flatnonzero(np.hypot(displaced[:, 0], displaced[:, 1]) > JUMP) + 1


def _converged(is_near, Ts):
    """The first row that is near with all those of the second after it; None when there is none."""
    window = round(HOLD / Ts) + 1
    if len(is_near) < window:
        return None
    holds = np.lib.stride_tricks.sliding_window_view(is_near, window).all(axis=1)
    return int(np.argmax(holds)) if holds.any() else None


def _checked(estimates, truth):
    if np.shape(estimates) != np.shape(truth) or np.ndim(truth) != 2 or np.shape(truth)[1] != 3:
        raise ValueError(f"need a pose (T + 1, 3) for each true one, got {np.shape(estimates)} and {np.shape(truth)}")
    return errors(estimates, truth)
