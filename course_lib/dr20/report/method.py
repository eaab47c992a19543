"""The method of the report behind the exercise, as its listing has it: the baseline, and what each of its errors costs.

`estimator()` does to arrays of particles on any map what `listing` does to one particle after the other, from the same
random numbers; and each of its errors is a choice that can be made differently.

What the listing leaves out is filled in here as the text describes it: the search among the horizontal lines, which
mirrors the one among the vertical; the commands, which are drawn about the given one, and a step x + v Δt cos θ,
y + v Δt sin θ, θ + ω Δt through whatever is in the way; the start, which is the course's prior. Its simulated beams had
no largest range: here a reading beyond it, and an expected one, is r_max.

References
----------
X. Bu, J. Song, report on homework 3 of AI3603, Shanghai Jiao Tong University, 2021: sections II.B and IV.A.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from course_lib.angles import circular_mean
from course_lib.dr20 import models
from course_lib.dr20.constants import HEADING
from course_lib.dr20.report.listing import NOWHERE
from course_lib.filters import Particles, Step, equally_weighted
from course_lib.geometry.polygons import inside
from course_lib.geometry.raycast import cast_fan


@dataclass(frozen=True)
class Choices:
    """What the report does, each error a choice.

    Attributes
    ----------
    count : int
        Particles: 400 for a known start and the kidnapped robot, 1 000 for an unknown one.
    weight : str
        "inverse" 1 / ‖Δ‖₂, the listing's; "manhattan" 1 / ‖Δ‖₁², the text's; "norm" ‖Δ‖₂, the text's in section IV,
        which is largest for the worst particle; "gaussian" exp(-‖Δ‖² / 2σ²); "beam", the course's beam model.
    sigma : float
        σ of "gaussian" in metres; the assignment advises 0.15.
    zero_inside : bool
        Whether a particle inside an obstacle has no weight: the text has this test, the listing has not.
    jitter : (float, float, float)
        Half-widths of the uniform noise on x, y (m) and θ (rad) after resampling.
    collisions : bool
        Whether walls stop particles (`models.transition`).
    circular : bool
        Whether the mean heading of the estimate is that of directions, or that of numbers that were never wrapped.
    paired : bool
        Whether the posterior's weights belong to its particles (which are equally weighted), or to their parents.
    augmented : bool
        Whether random particles are injected: sections II and III do not.
    alpha_slow, alpha_fast : float
        Rates of the averages; the report has them swapped.
    from_zero : bool
        Whether the averages start at zero, or at the first likelihood.
    reset : bool
        Whether the averages start anew after each injection: nav2_amcl's choice, not the report's.
    headings : (float, float)
        Injected headings are uniform between these, in radians.
    free : bool
        Whether injected positions are free ones, or anywhere in the box about the room.
    """

    count: int = 1000
    weight: str = "inverse"
    sigma: float = 0.15
    zero_inside: bool = False
    jitter: tuple = (0.1, 0.1, 0.1)
    collisions: bool = False
    circular: bool = False
    paired: bool = False
    augmented: bool = True
    alpha_slow: float = 0.7
    alpha_fast: float = 0.3
    from_zero: bool = True
    reset: bool = False
    headings: tuple = (0.0, np.pi)
    free: bool = False

    def __post_init__(self):
        if self.weight not in LOG_WEIGHTS:
            raise ValueError(f"weight = {self.weight!r} must be one of {', '.join(LOG_WEIGHTS)}")


class Memory(NamedTuple):
    """What the estimator keeps.

    Attributes
    ----------
    states : ndarray, shape (N, 3)
        Resampled.
    log_slow, log_fast : float or None
        Logarithms of the averages; None before there are any.
    estimate : ndarray, shape (3,)
        The report's x_est, read before resampling.
    share : float
        1 - w_fast / w_slow, at least zero: of the particles, how many were drawn anew.
    """

    states: np.ndarray
    log_slow: float | None
    log_fast: float | None
    estimate: np.ndarray
    share: float


def _inverse(difference, choices):
    # An exact match weighs infinitely much, and no index can be drawn then.
    return -np.log(np.linalg.norm(difference, axis=1))


def _manhattan(difference, choices):
    return -2.0 * np.log(np.abs(difference).sum(axis=1))


def _norm(difference, choices):
    return np.log(np.linalg.norm(difference, axis=1))


def _gaussian(difference, choices):
    return -0.5 * np.square(difference / choices.sigma).sum(axis=1)


#: Names of weights, and log w of expected minus read ranges (N, B); the beam model needs more than their difference.
LOG_WEIGHTS = {"inverse": _inverse, "manhattan": _manhattan, "norm": _norm, "gaussian": _gaussian, "beam": None}


def distances(states, constants):
    """`listing.detect_obstacles` of many particles on any map.

    Parameters
    ----------
    states : ndarray, shape (N, 3)
    constants : Constants
        Its `mount` does not matter: the report takes the sensor's pose for the axle's.

    Returns
    -------
    ndarray, shape (N, B)
        Metres, without a largest range. A ray that meets nothing ends at `NOWHERE`.
    """
    ranges = cast_fan(states, np.asarray(constants.bearings), constants.walls)
    away = np.hypot(states[:, 0] - NOWHERE[0], states[:, 1] - NOWHERE[1])
    return np.where(np.isfinite(ranges), ranges, away[:, None])


def estimator(choices=None):
    """The report's filter as an `Estimator`.

    Parameters
    ----------
    choices : Choices, optional
        The report's own when left out.

    Returns
    -------
    callable
        `Estimator(previous, observation, control, constants, rng) -> Step`. The posterior is what the report plots;
        `step.memory.estimate` is its estimate.
    """
    choices = choices or Choices()

    def Estimator(previous, observation, control, constants, rng):
        if previous is None:
            states = models.prior(choices.count, constants, rng)
            particles = equally_weighted(states)
            return Step(particles, Memory(states, None, None, _mean(states, particles.weights, choices), 0.0))
        return _update(previous.memory, observation, control, choices, constants, rng)

    return Estimator


def _update(memory, observation, control, choices, constants, rng):
    n = len(memory.states)
    states = _moved(memory.states, control, choices, constants, rng)
    log_weights = _weighed(states, observation, choices, constants)
    log_total = logsumexp(log_weights)
    with np.errstate(invalid="ignore"):
        log_weights = log_weights - log_total
    weights = np.exp(log_weights)
    log_slow, log_fast = _averaged(memory, log_total - np.log(n), choices)
    estimate = _mean(states, weights, choices)

    share = -np.expm1(log_fast - log_slow) if choices.augmented and log_fast < log_slow else 0.0
    parents = rng.choice(n, n, p=weights)
    # With replacement, so that fewer are injected than the share says.
    replaced = rng.choice(n, int(n * share))
    states = states[parents] + 2.0 * np.asarray(choices.jitter) * (rng.random((3, n)).T - 0.5)
    states[replaced] = _random(len(replaced), choices, constants, rng)
    if choices.reset and share > 0.0:
        log_slow = log_fast = None
    posterior = equally_weighted(states) if choices.paired else Particles(states, log_weights)
    return Step(posterior, Memory(states, log_slow, log_fast, estimate, share))


def _moved(states, control, choices, constants, rng):
    if choices.collisions:
        return models.transition(states, control, constants, rng)
    noise = rng.standard_normal((len(states), 2)) * [constants.sigma_v, constants.sigma_omega]
    v, omega = (np.asarray(control) + noise).T
    heading = states[:, HEADING]
    return states + constants.Ts * np.column_stack([v * np.cos(heading), v * np.sin(heading), omega])


def _weighed(states, observation, choices, constants):
    if choices.weight == "beam":
        log_weights = models.log_likelihood(observation, states, constants)
    else:
        expected = np.minimum(distances(states, constants), constants.r_max)
        with np.errstate(divide="ignore"):
            log_weights = LOG_WEIGHTS[choices.weight](expected - np.minimum(observation, constants.r_max), choices)
    if choices.zero_inside:
        log_weights[~inside(np.ascontiguousarray(states[:, :2]), constants.walls)] = -np.inf
    return log_weights


def _averaged(memory, log_mean, choices):
    if memory.log_slow is None and not choices.from_zero:
        return log_mean, log_mean
    slow, fast = (-np.inf if old is None else old for old in (memory.log_slow, memory.log_fast))
    return (
        np.logaddexp(np.log1p(-choices.alpha_slow) + slow, np.log(choices.alpha_slow) + log_mean),
        np.logaddexp(np.log1p(-choices.alpha_fast) + fast, np.log(choices.alpha_fast) + log_mean),
    )


def _mean(states, weights, choices):
    mean = weights @ states
    if choices.circular:
        mean[HEADING] = circular_mean(states[:, HEADING], weights)
    return mean


def _random(n, choices, constants, rng):
    if choices.free:
        states = models.anywhere(n, constants, rng)
        states[:, HEADING] = rng.uniform(*choices.headings, n)
        return states
    low, high = constants.bounds[:2], constants.bounds[2:]
    return rng.uniform((*low, choices.headings[0]), (*high, choices.headings[1]), (n, 3))
