"""What the map makes impossible, by computing it: which poses a scan cannot tell apart, and which runs an exact filter
cannot solve.

    grid = symmetry.pose_grid(constants)
    other = symmetry.explanations(pose, grid, constants, rng)

`explanations` asks, of the scan that perfect beams would read at a pose, which other poses explain it about as well.
One scan being ambiguous does not make a robot that drives on ambiguous: `mass_near_truth` follows it with a filter
large enough to be called exact, from the moment at which nothing is known.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, types

from course_lib.dr20 import models, success
from course_lib.dr20.constants import ANGLES
from course_lib.filters import Particles, equally_weighted, normalise, resample, systematic
from course_lib.filters.modes import components
from course_lib.geometry.polygons import fits

#: Poses this far apart in every column are one explanation: metres, metres, radians.
APART = (success.NEAR_POSITION, success.NEAR_POSITION, success.NEAR_HEADING)
#: Rounds of the search for the best pose near one of the grid, and poses tried in each.
ROUNDS, TRIES = 8, 24
#: Draws that the first scan weighs, for each particle of the filter: few of them keep any weight.
DRAWS = 10


class PoseGrid(NamedTuple):
    """Poses at equal spacings, the centres of all cells that hold free poses, and their scans.

    Attributes
    ----------
    poses : ndarray, shape (M, 3)
    ranges : ndarray, shape (M, B)
        What perfect beams read there, in metres; r_max for what is farther.
    spacings : ndarray, shape (3,)
        Metres, metres, radians.
    """

    poses: np.ndarray
    ranges: np.ndarray
    spacings: np.ndarray


class Explanations(NamedTuple):
    """Poses that explain a scan.

    Attributes
    ----------
    poses : ndarray, shape (K, 3)
        The pose whose scan it is comes first.
    log_ratios : ndarray, shape (K,)
        log p(scan | pose) minus that of the first; above zero where another explains it better.
    modes : ndarray of int, shape (K,)
        Which separate place each belongs to; 0 is the first's, which may reach far where beams see nothing.
    """

    poses: np.ndarray
    log_ratios: np.ndarray
    modes: np.ndarray

    @property
    def count(self):
        """Separate places, at least 1."""
        return int(self.modes.max()) + 1

    @property
    def elsewhere(self):
        """Of the poses, those that would not be near (`success.near`) if the first were true; shape (L, 3)."""
        return self.poses[~success.near(*success.errors(self.poses, self.poses[0]))]


def pose_grid(constants, spacing=0.05, headings=180):
    """The poses of a map at a spacing.

    Parameters
    ----------
    constants : Constants
    spacing : float
        Between positions, in metres.
    headings : int
        How many there are on the circle.

    Returns
    -------
    PoseGrid
    """
    low, high = constants.bounds[:2], constants.bounds[2:]
    axes = [np.arange(a + 0.5 * spacing, b, spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    # All cells that free positions reach into.
    within = max(constants.radius - spacing / np.sqrt(2.0), 0.0)
    points = points[fits(points, constants.walls, within)]
    turn = 2.0 * np.pi / headings
    angles = -np.pi + turn * (np.arange(headings) + 0.5)
    poses = np.column_stack([np.repeat(points, headings, axis=0), np.tile(angles, len(points))])
    ranges = np.minimum(models.distances(poses, constants), constants.r_max)
    return PoseGrid(poses, ranges, np.array([spacing, spacing, turn]))


def explanations(pose, grid, constants, rng, threshold=3.0):
    """The poses that explain the perfect scan of one about as well as it does itself.

    Parameters
    ----------
    pose : array_like, shape (3,)
    grid : PoseGrid
        Of the same constants.
    constants : Constants
    rng : numpy.random.Generator
        Of the search between the grid's poses.
    threshold : float
        How much less likely, in nats, an explanation may be. Between poses whose scans differ by Δ in beams that read a
        wall it is Σ Δ² / 2σ², which is what one noisy scan says for the true one on average.

    Returns
    -------
    Explanations
        One pose, the best found, for each box of `APART` that holds any.
    """
    pose = np.atleast_2d(np.asarray(pose, dtype=float))
    exact = models.distances(pose, constants)[0]
    scan = np.where(exact > constants.r_max, np.inf, exact)

    surprise = _cost_of_surprise(constants)
    cost = mismatch(np.minimum(scan, constants.r_max), grid.ranges, _blur(grid, constants), surprise)
    # At a corner a range jumps between one pose of the grid and the next: a beam's surprise is allowed for.
    likely = np.flatnonzero(cost <= threshold + surprise)
    likely = _best_of_each_box(grid.poses[likely], -cost[likely])[0]

    poses, log_likelihood = _climb(likely, scan, grid, constants, rng)
    own = models.log_likelihood(scan, pose, constants)[0]
    good = log_likelihood >= own - threshold
    poses, log_likelihood = _best_of_each_box(poses[good], log_likelihood[good])
    poses = np.vstack([pose, poses])
    return Explanations(poses, np.concatenate([[0.0], log_likelihood - own]), components(poses, APART, ANGLES))


class Ambiguity(NamedTuple):
    """How ambiguous single scans are.

    Attributes
    ----------
    poses : ndarray, shape (N, 3)
    counts : ndarray of int, shape (N,)
        Separate places that explain the scan of each pose.
    elsewhere : ndarray, shape (N, 3)
        The pose, not near this one, that explains its scan best; NaN where there is none.
    """

    poses: np.ndarray
    counts: np.ndarray
    elsewhere: np.ndarray

    @property
    def ambiguous(self):
        """Whether a scan from each pose may come from elsewhere, shape (N,)."""
        return ~np.isnan(self.elsewhere[:, 0])


def ambiguity(poses, grid, constants, rng, threshold=3.0):
    """`explanations` of many poses.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
        Of `models.anywhere`, for the share of the map.
    grid, constants, rng, threshold
        As in `explanations`.

    Returns
    -------
    Ambiguity
    """
    counts, elsewhere = np.empty(len(poses), dtype=int), np.full((len(poses), 3), np.nan)
    for i, pose in enumerate(poses):
        found = explanations(pose, grid, constants, rng, threshold)
        counts[i] = found.count
        far = ~success.near(*success.errors(found.poses, pose))
        if far.any():
            elsewhere[i] = found.poses[far][np.argmax(found.log_ratios[far])]
    return Ambiguity(np.asarray(poses), counts, elsewhere)


def mass_near_truth(run, grid, constants, rng, first=1, steps=50, count=100_000):
    """How much of the posterior lies near the truth, when nothing is known before a step.

    A filter with the true models: what it cannot tell no filter can. How exact it is shows in `maps.TWIN`, where the
    answer is a half or less: two equal modes exchange weight at random, faster the fewer particles there are. So it
    answers which modes are left, and not to the second digit how likely each is.

    Parameters
    ----------
    run : Run
    grid : PoseGrid
        Of the same constants; the first particles are drawn in its cells.
    constants : Constants
    rng : numpy.random.Generator
    first : int
        Row of the truth whose scan is the first to be used: 1, or one of `success.kidnapped`.
    steps : int
        Scans used.
    count : int
        Particles.

    Returns
    -------
    ndarray, shape (at most steps,)
        After the scans of rows first, first + 1, ...: the posterior probability of poses within 0.3 m and 15° of the
        truth. Ends with the run.
    """
    particles = _after_one_scan(run.observations[first - 1], grid, DRAWS * count, constants, rng)
    mass = [_near(particles, run.truth[first])]
    particles = equally_weighted(particles.states[systematic(particles.weights, rng, count)])
    for row in range(first + 1, min(first + steps, len(run.truth))):
        states = models.transition(particles.states, run.controls[row - 1], constants, rng)
        log_likelihood = models.log_likelihood(run.observations[row - 1], states, constants)
        particles = Particles(states, normalise(particles.log_weights + log_likelihood)[0])
        mass.append(_near(particles, run.truth[row]))
        particles = resample(particles, rng)
    return np.array(mass)


@njit(types.float64[::1](types.float64[::1], types.float64[:, ::1], types.float64, types.float64), cache=True)
def mismatch(scan, ranges, blur, most):
    """How badly each row of ranges fits a scan: Σ min(Δ² / 2 blur², most).

    Parameters
    ----------
    scan : ndarray, shape (B,)
        Finite, in metres.
    ranges : ndarray, shape (M, B)
    blur : float
        Metres.
    most : float
        What one beam can cost.

    Returns
    -------
    ndarray, shape (M,)
    """
    cost, scale = np.zeros(len(ranges)), 1.0 / (np.sqrt(2.0) * blur)
    for i in range(len(ranges)):
        for b in range(len(scan)):
            part = (ranges[i, b] - scan[b]) * scale
            cost[i] += min(part * part, most)
    return cost


def _blur(grid, constants):
    """How far a range is from that of the grid's next pose, and the noise: metres."""
    # Half a spacing, or half a turn of a long beam; and more on a slanting wall.
    return np.hypot(constants.sigma, np.hypot(grid.spacings[0], 0.5 * grid.spacings[2] * constants.r_max))


def _cost_of_surprise(constants):
    """What a beam costs at most, in nats, that does not read what it should; infinite where that is impossible."""
    p_hit = 1.0 - constants.p_short - constants.p_miss - constants.p_random
    peak = p_hit / (constants.sigma * np.sqrt(2.0 * np.pi))
    other = (constants.p_short + constants.p_random) / constants.r_max
    # Beyond 4 blurs it is no longer the grid's fault.
    return min(np.log(peak / other), 8.0) if 0.0 < other < peak else 8.0


def _best_of_each_box(poses, values):
    """One pose of each box of `APART`, that of the largest value, and the values: in no particular order."""
    if not len(poses):
        return poses, values
    order = np.argsort(-values, kind="stable")
    boxes = np.floor(poses[order] / APART).astype(int)
    # Of equal rows `unique` returns the first.
    first = order[np.unique(boxes, axis=0, return_index=True)[1]]
    return poses[first], values[first]


def _climb(poses, scan, grid, constants, rng):
    """The likeliest poses found near some: random steps that get shorter."""
    poses = poses.copy()
    best, scale = models.log_likelihood(scan, poses, constants), grid.spacings.copy()
    for _ in range(ROUNDS):
        tried = poses[:, None] + scale * rng.uniform(-1.0, 1.0, (len(poses), TRIES, 3))
        flat = tried.reshape(-1, 3)
        values = models.log_likelihood(scan, flat, constants)
        values[~models.free(flat, constants)] = -np.inf
        values = values.reshape(len(poses), TRIES)
        i, j = np.arange(len(poses)), values.argmax(axis=1)
        better = values[i, j] > best
        poses[better], best[better] = tried[i, j][better], values[i, j][better]
        scale *= 0.7
    return poses, best


def _after_one_scan(scan, grid, count, constants, rng):
    """The posterior of one scan, when any free pose was possible: importance sampling in the grid's cells."""
    blur, surprise = _blur(grid, constants), _cost_of_surprise(constants)
    # Half the surprise: where a range jumps within a cell, its poses must not weigh hundreds of times their share.
    log_proposal = -mismatch(np.minimum(scan, constants.r_max), grid.ranges, blur, 0.5 * surprise)
    proposal = np.exp(log_proposal - log_proposal.max())
    cells = systematic(proposal, rng, count)
    states = grid.poses[cells] + grid.spacings * (rng.random((count, 3)) - 0.5)
    log_weights = models.log_likelihood(scan, states, constants) - log_proposal[cells]
    log_weights[~models.free(states, constants)] = -np.inf
    return Particles(states, normalise(log_weights)[0])


def _near(particles, pose):
    return float(particles.weights @ success.near(*success.errors(particles.states, pose)))
