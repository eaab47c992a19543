"""Where the robot may be, by one scan alone: poses drawn about as likely as the scan makes them.

A uniform pose is right with a probability of 10⁻⁵, so that a filter which is to find a kidnapped robot at once cannot
guess. Instead the scans of all poses of a coarse grid are known beforehand; a scan picks the cells that explain it, and
a pose is drawn in each. What that proposal prefers is divided out again: the weights are those of importance sampling.

References
----------
S. Lenser, M. Veloso, *Sensor resetting localization for poorly modelled mobile robots*, ICRA 2000: the idea.
S. Thrun, D. Fox, W. Burgard, F. Dellaert, *Robust Monte Carlo localization for mobile robots*, Artificial Intelligence
128, 2001, sec. 3: dual MCL, whose weights these are.
"""

from typing import NamedTuple

import numpy as np

from course_lib.angles import wrap
from course_lib.dr20 import models
from course_lib.filters import multinomial, normalise
from course_lib.geometry import polygons

#: Side of a cell in metres, and how many headings there are.
SPACING, HEADINGS = 0.1, 48
#: Scans within a cell differ by about this much in a beam, in metres.
BLUR = 0.12


class Catalogue(NamedTuple):
    """The scans of a grid of poses.

    Attributes
    ----------
    poses : ndarray, shape (M, 3)
        Centres of those cells that hold free positions.
    distances : ndarray, shape (M, B)
        What perfect beams would read there, in metres.
    """

    poses: np.ndarray
    distances: np.ndarray


def catalogue(constants, low=None, high=None):
    """The scans of all poses between two corners.

    Parameters
    ----------
    constants : Constants
    low, high : array_like, shape (2,), optional
        Corners in metres; the whole map when left out.

    Returns
    -------
    Catalogue
    """
    low = constants.bounds[:2] if low is None else np.maximum(low, constants.bounds[:2])
    high = constants.bounds[2:] if high is None else np.minimum(high, constants.bounds[2:])
    axes = [np.arange(a + 0.5 * SPACING, b + 0.5 * SPACING, SPACING) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    # Where the centre does not fit, a corner of the cell may.
    fitting = polygons.fits(points, constants.walls, max(constants.radius - SPACING / np.sqrt(2.0), 0.0))
    points = points[fitting]
    headings = wrap(2.0 * np.pi / HEADINGS * np.arange(HEADINGS))
    poses = np.column_stack([np.repeat(points, HEADINGS, axis=0), np.tile(headings, len(points))])
    return Catalogue(poses, models.distances(poses, constants))


def draw(n, observation, catalogue, constants, rng):
    """Poses that may explain a scan, as a weighted sample of p(z | x) p(x) with p(x) uniform.

    Parameters
    ----------
    n : int
    observation : array_like, shape (B,)
    catalogue : Catalogue
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    states : ndarray, shape (n, 3)
    log_weights : ndarray, shape (n,)
        Not normalised: their exponentials sum to an estimate of p(z), had the robot been anywhere in the catalogue.
    """
    blurred = models.beam_log_likelihood(
        np.ascontiguousarray(observation, dtype=float),
        catalogue.distances,
        float(np.hypot(constants.sigma, BLUR)),
        constants.r_max,
        constants.p_short,
        constants.rate_short,
        constants.p_miss,
        constants.p_random,
    )
    log_share, total = normalise(blurred)
    if not np.isfinite(total):
        log_share = np.full(len(blurred), -np.log(len(blurred)))
    cells = multinomial(np.exp(log_share), rng, n)
    states = catalogue.poses[cells]
    size = np.array([SPACING, SPACING, 2.0 * np.pi / HEADINGS])
    states += size * rng.uniform(-0.5, 0.5, states.shape)
    states[:, 2] = wrap(states[:, 2])
    # w = p(z | x) p(x) / q(x) / n,  p(x) = 1 / (M V) at free poses,  q(x) = π_c / V
    log_likelihood = models.log_likelihood(observation, states, constants)
    log_weights = log_likelihood - np.log(len(catalogue.poses)) - log_share[cells] - np.log(n)
    log_weights[~models.free(states, constants)] = -np.inf
    return states, log_weights
