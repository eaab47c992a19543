"""What the checks of the beacon notebook have in common: cases to try, matrices compared entry by entry, posteriors."""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon.constants import ANGLES, Constants
from course_lib.filters import Gaussian, Particles, Step
from course_lib.filters import particles as clouds
from grader.lessons import expect

#: A room in which no number is a default.
OTHER = Constants(
    R=7.0,
    h=3.0,
    Ts=0.1,
    mass=1.3,
    drag=0.2,
    sigma_rho=0.25,
    sigma_alpha=0.06,
    sigma_a=0.2,
    k=0.0003,
    sigma_v=0.3,
    sigma_w=0.06,
    start=(0.5, -0.4, 1.2, 3.0),
    start_sigma=(0.3, 0.05, 0.2, 0.2, 0.05),
)
#: What messages call the columns of a state and of the first nine of an observation.
STATE = ("x", "y", "z", "φ", "ϑ", "θ", "v_x", "v_y", "v_z", "p", "q", "r")
READINGS = ("ρ₁", "ρ₂", "ρ₃", "ρ₄", "α₁", "α₂", "α₃", "α₄", "a")


def states(n, constants, rng):
    """States all over the room, of every heading, shape (n, 12)."""
    result = rng.standard_normal((n, 12)) * np.repeat([0.0, 0.15, 1.0, 0.5], 3)
    result[:, :2] = 0.45 * constants.R * rng.uniform(-1, 1, (n, 2))
    result[:, 2] = constants.h * rng.uniform(0.1, 0.9, n)
    result[:, 5] = rng.uniform(-np.pi, np.pi, n)
    return result


def spread(rng, size=1.0):
    """A covariance of states in which every two columns are correlated, shape (12, 12)."""
    deviations = size * np.repeat([0.3, 0.05, 0.3, 0.2], 3)
    root = deviations[:, None] * (np.eye(12) + 0.25 * rng.standard_normal((12, 12)))
    return root @ root.T


def room(constants):
    """Words for a room."""
    return f"in a room of R = {constants.R:g} m, h = {constants.h:g} m"


def units(covariance):
    """Products of the standard deviations: what entries of a covariance are compared in."""
    deviations = np.sqrt(np.diag(covariance))
    return np.outer(deviations, deviations)


def same(got, expected, call, faults=(), scale=1.0, entry=str, tolerance=1e-9, angles=()):
    """Fail where two arrays differ, naming the fault if it is a known one.

    Parameters
    ----------
    got, expected : ndarray
        Of the same shape; NaN equals NaN.
    call : str
        The call, as the message names it.
    faults : iterable of (ndarray or callable, str)
        What a known fault gives instead (or a function of no arguments that returns it), and its name.
    scale : float or ndarray
        What differences are measured in.
    entry : callable
        `entry(index) -> str`, what the message calls an entry.
    tolerance : float
        In units of `scale`.
    angles : sequence of int
        Entries of the last axis that are compared modulo 2π.
    """
    apart = _apart(got, expected, scale, angles)
    if apart.max(initial=0.0) <= tolerance:
        return
    worst = np.unravel_index(np.argmax(apart), apart.shape)
    message = f"{call}\n{entry(worst)}: expected {expected[worst]:.6g}, got {got[worst]:.6g}"
    for wrong, name in faults:
        wrong = wrong() if callable(wrong) else wrong
        if _apart(got, wrong, scale, angles).max() <= tolerance:
            message = f"{name}\n{message}"
            break
    raise AssertionError(message)


def _apart(a, b, scale, angles):
    with np.errstate(invalid="ignore"):
        difference = a - b
        difference[..., list(angles)] = wrap(difference[..., list(angles)])
        apart = np.abs(difference) / scale
    same_values = (a == b) | (np.isnan(a) & np.isnan(b))
    return np.where(np.isnan(apart), np.where(same_values, 0.0, np.inf), apart)


def entry_of_state(index):
    """Name of an entry of a mean."""
    return f"mean, {STATE[index[-1]]}"


def entry_of_covariance(index):
    """Name of an entry of a covariance."""
    return f"covariance of {STATE[index[0]]} and {STATE[index[1]]}"


def mean_and_covariance(value, call):
    """The two arrays of a Gaussian, after making sure that it is one."""
    pair = isinstance(value, tuple | list) and len(value) == 2
    assert pair, f"{call}: expected mean, covariance, got {_called(value)}"
    mean = expect.array(value[0], (12,), f"{call}: mean")
    return mean, checked_covariance(expect.array(value[1], (12, 12), f"{call}: covariance"), call)


def checked_covariance(covariance, call):
    """The covariance, after making sure that it is symmetric and has no negative variance."""
    deviations = np.sqrt(np.abs(np.diag(covariance))) + 1e-150
    scale = np.outer(deviations, deviations)
    skew = np.abs(covariance - covariance.T) / scale
    if skew.max() > 1e-9:
        i, j = np.unravel_index(np.argmax(skew), skew.shape)
        raise AssertionError(
            f"The covariance is not symmetric: average it with its transpose.\n{call}: P[{i}, {j}] = "
            f"{covariance[i, j]:.6g}, P[{j}, {i}] = {covariance[j, i]:.6g}"
        )
    variances = np.diag(covariance)
    assert (variances >= 0).all(), (
        f"{call}: the variance of {STATE[np.argmin(variances)]} is negative: {variances.min():.3g}"
    )
    least = np.linalg.eigvalsh(covariance / scale).min()
    assert least > -1e-9, (
        f"The covariance has a direction of negative variance: use Joseph's form.\n{call}: least eigenvalue "
        f"{least:.3g}, in units of the standard deviations"
    )
    return covariance


def posterior(value, call):
    """Mean (12,) and covariance (12, 12) of what an estimator returned, after making sure that it is a posterior."""
    if isinstance(value, Step):
        value = value.posterior
    if isinstance(value, np.ndarray) and value.ndim == 2:
        value = (value, np.full(len(value), -np.log(max(len(value), 1))))
    pair = isinstance(value, tuple | list) and len(value) == 2
    assert pair, f"{call}: expected a Gaussian, Particles, or an array (N, 12), got {_called(value)}"
    first = value[0]
    if np.ndim(first) != 2 or isinstance(value, Gaussian):
        return mean_and_covariance(value, call)
    assert len(first) and np.shape(first)[1] == 12, f"{call}: expected states (N, 12), got shape {np.shape(first)}"
    cloud = expect.array(first, np.shape(first), f"{call}: states")
    log_weights = expect.array(value[1], (len(cloud),), f"{call}: log_weights", kind="l")
    total = np.exp(log_weights).sum()
    assert abs(total - 1) < 1e-6, f"{call}: the weights sum to {total:.6g}, expected 1"
    particles = Particles(cloud, log_weights)
    return clouds.mean(particles, ANGLES), clouds.covariance(particles, ANGLES)


def _called(value):
    return f"shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
