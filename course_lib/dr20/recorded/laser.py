"""A real robot with a laser scanner: Monte Carlo localization in a map that `scans` made of its first laps.

What is called truth here are the poses that SLAM gave to the scans. They come from the same scans, so neither the map
nor the errors are independent of them: an error of a few centimetres is as much theirs as the filter's. The map and all
numbers that are fitted come from laps 1 and 2, and the later laps are the test.

References
----------
S. Thrun, W. Burgard, D. Fox, *Probabilistic Robotics*, MIT Press 2005: the odometry model (table 5.6).
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, nnls

from course_lib.angles import wrap
from course_lib.dr20.recorded.scans import anywhere, scan_log_likelihood
from course_lib.filters import adaptive, modes
from course_lib.filters.bootstrap import update
from course_lib.filters.particles import Particles, effective_sample_size, equally_weighted

ANGLES = (2,)
#: Bins of KLD-sampling and of the clusters of the estimate: m, m, rad.
BINS = (0.2, 0.2, 0.15)
CLUSTERS = (0.4, 0.4, 0.3)


class Odometry(NamedTuple):
    """How the wheels err, and where the scanner is.

    Attributes
    ----------
    scale : float
        True distance over the wheels'.
    gain : float
        True turn over the wheels'.
    drift : float
        Turn that the wheels do not notice (rad/m).
    mount : float
        How far ahead of the wheels' axle the scanner is (m).
    alphas : tuple of float
        Variances of Thrun's model: of a turn per rad² turned and per m² gone, of a distance per m² gone and per rad²
        turned.
    """

    scale: float
    gain: float
    drift: float
    mount: float
    alphas: tuple


class Track(NamedTuple):
    """What a filter said after each scan.

    Attributes
    ----------
    estimates : ndarray, shape (T, 3)
        The mean of the heaviest cluster: x, y (m), heading (rad).
    means : ndarray, shape (T, 3)
        The mean of all particles, of the headings too as if they were numbers on a line.
    shares : ndarray, shape (T,)
        How much of the weight is in the heaviest cluster.
    counts : ndarray of int, shape (T,)
        Particles.
    """

    estimates: np.ndarray
    means: np.ndarray
    shares: np.ndarray
    counts: np.ndarray


def increments(poses, odometry=None):
    """Motion from each pose to the next: a turn, a way straight on, a turn.

    Parameters
    ----------
    poses : ndarray, shape (T + 1, 3)
        The scanner's; or the axle's, as the wheels have them, if `odometry` is given.
    odometry : Odometry, optional
        Corrects what the wheels say.

    Returns
    -------
    ndarray, shape (T, 3)
        Turn (rad), way (m, negative when going back), turn (rad).
    """
    if odometry is not None:
        ahead = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=-1)
        poses = np.column_stack([poses[:, :2] + odometry.mount * ahead, poses[:, 2]])
    step = np.diff(poses, axis=0)
    way = np.hypot(step[:, 0], step[:, 1])
    # The direction of a way of nothing is noise.
    first = np.where(way > 0.01, wrap(np.arctan2(step[:, 1], step[:, 0]) - poses[:-1, 2]), 0.0)
    back = np.abs(first) > np.pi / 2
    first, way = np.where(back, wrap(first + np.pi), first), np.where(back, -way, way)
    second = wrap(step[:, 2] - first)
    if odometry is not None:
        scale, gain, drift = odometry[:3]
        first, second = gain * first + 0.5 * drift * way, gain * second + 0.5 * drift * way
        way = scale * way
    return np.column_stack([first, way, second])


def move(poses, increments):
    """Poses after a turn, a way and a turn.

    Parameters
    ----------
    poses, increments : ndarray, shape (N, 3)

    Returns
    -------
    ndarray, shape (N, 3)
    """
    first, way, second = np.moveaxis(increments, -1, 0)
    direction = poses[:, 2] + first
    return np.column_stack(
        [
            poses[:, 0] + way * np.cos(direction),
            poses[:, 1] + way * np.sin(direction),
            wrap(direction + second),
        ]
    )


def transition(poses, increment, odometry, rng):
    """Draw where each particle went.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
    increment : ndarray, shape (3,)
        What the wheels say, corrected.
    odometry : Odometry
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (N, 3)
    """
    deviations = np.sqrt(_variances(increment, odometry.alphas))
    return move(poses, increment + deviations * rng.standard_normal((len(poses), 3)))


def _variances(increments, alphas):
    first, way, second = (np.moveaxis(increments, -1, 0)) ** 2
    of_turn, of_turn_by_way, of_way, of_way_by_turn = alphas
    # Scans themselves are placed to about a centimetre and a third of a degree.
    return np.stack(
        [
            of_turn * first + of_turn_by_way * way + 0.006**2,
            of_way * way + of_way_by_turn * (first + second) + 0.01**2,
            of_turn * second + of_turn_by_way * way + 0.006**2,
        ],
        axis=-1,
    )


def calibrate(odometry, corrected):
    """How the wheels err, from a part of the log in which the poses are known.

    Parameters
    ----------
    odometry, corrected : ndarray, shape (T + 1, 3)
        Successive poses, as the wheels have them and as they were.

    Returns
    -------
    Odometry
        Systematic errors by least squares; variances from what these leave, by non-negative least squares.
    """
    step, heading = np.diff(corrected, axis=0), corrected[:-1, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    actual = np.column_stack([cos * step[:, 0] + sin * step[:, 1], cos * step[:, 1] - sin * step[:, 0], step[:, 2]])

    def residuals(parameters):
        difference = move(np.zeros_like(actual), increments(odometry, Odometry(*parameters, ()))) - actual
        return np.column_stack([difference[:, :2], wrap(difference[:, 2])]).ravel()

    fitted = least_squares(residuals, (1.0, 1.0, 0.0, 0.0), loss="soft_l1", f_scale=0.05).x
    said, was = increments(odometry, Odometry(*fitted, ())), increments(corrected)
    turned, gone = said[:, 0] ** 2 + said[:, 2] ** 2, said[:, 1] ** 2
    turn_error = wrap(was[:, 0] + was[:, 2] - said[:, 0] - said[:, 2])
    of_turn, of_turn_by_way = nnls(np.column_stack([turned, 2.0 * gone]), turn_error**2)[0]
    of_way, of_way_by_turn = nnls(np.column_stack([gone, turned]), (was[:, 1] - said[:, 1]) ** 2)[0]
    alphas = (of_turn, of_turn_by_way, of_way, of_way_by_turn)
    return Odometry(*map(float, fitted), tuple(map(float, alphas)))


def localize(recording, scans, field, odometry, start, rng, beams, temper, alphas=None, least=1000, most=50_000):
    """Monte Carlo localization.

    Neighbouring beams see the same wall, the same door that has been closed since, the same error of the map: their
    errors are not independent, and the product of their likelihoods claims to know far more than they do. A power less
    than 1 of it, `temper`, says how many of the beams count.

    Parameters
    ----------
    recording : LaserRecording
    scans : range
        Successive scans.
    field : ScanField
    odometry : Odometry
    start : ndarray, shape (N, 3)
        The particles before the first of these scans is looked at.
    rng : numpy.random.Generator
    beams : ndarray of int
        Those to be used.
    temper : float
        In (0, 1].
    alphas : (float, float), optional
        α_slow and α_fast of augmented MCL, which strews particles over the free cells when scans stop fitting; without
        it none are. In a room that the map does not have they stop fitting, too.
    least, most : int
        Bounds of KLD-sampling on the number of particles.

    Returns
    -------
    Track
    """
    steps = increments(recording.odometry[scans.start : scans.stop], odometry)
    bearings, particles, averages, said = recording.bearings[beams], equally_weighted(start), None, []
    for i, k in enumerate(scans):
        if i:
            share = averages.share if alphas else 0.0
            if share > 0.0 or effective_sample_size(particles) < 0.5 * len(particles.states):
                particles = adaptive.kld_resample(
                    particles, rng, BINS, epsilon=0.05, delta=0.01, least=least, most=most, angles=ANGLES
                )
                particles = adaptive.inject(particles, share, lambda n, rng: anywhere(n, field.grid, rng), rng)
            moved = transition(particles.states, steps[i - 1], odometry, rng)
            particles = Particles(moved, particles.log_weights)
        log_likelihood = scan_log_likelihood(particles.states, recording.ranges[k, beams], bearings, field)
        particles, log_evidence = update(particles, temper * log_likelihood)
        if alphas:
            # Of a scan with all its beams: with those that came back alone, it would rise and fall with their number.
            share_back = np.isfinite(recording.ranges[k, beams]).mean()
            averages = adaptive.averages(averages, log_evidence / max(share_back, 0.1), *alphas)
        mode = modes.heaviest(particles, CLUSTERS, ANGLES)
        said.append((mode.mean, particles.weights @ particles.states, mode.weight, len(particles.states)))
    return Track(*(np.array(column) for column in zip(*said, strict=True)))
