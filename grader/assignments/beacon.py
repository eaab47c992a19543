"""The beacons' two assignments for estimators: their variants, metrics and thresholds."""

from dataclasses import replace

import numpy as np

from course_lib.angles import circular_mean, wrap
from course_lib.beacon.constants import POSITION, VELOCITY, YAW, Constants, Hidden
from course_lib.beacon.world import World
from course_lib.scoring import energy_score_and_rank, thin
from grader.assignment import Criterion, EstimatorAssignment, LogUniform, Speed, Uniform, Variant
from grader.result import COVERAGE, NEES

#: Particles that stand for a posterior in the scores that cost O(N²).
SCORED_PARTICLES = 200


def simulate(variant, rng):
    """One run of a variant."""
    return World(variant.constants, variant.hidden).simulate(rng)


def measure(particles, truth, rng):
    """Errors and scores of one posterior.

    Parameters
    ----------
    particles : Particles
        states (N, 12).
    truth : ndarray, shape (12,)
    rng : numpy.random.Generator
        Thins the posterior: a filter cannot know which of its particles are looked at.

    Returns
    -------
    dict of str to float
        "energy score" of the position in metres; "position", "velocity" and "yaw", the errors of the mean in m, m/s
        and rad; and "within 90 %", 1 when the true position lies in the most central 90 % of the posterior and 0 when
        not.
    """
    weights, states = particles.weights, particles.states
    mean = weights @ states
    points, _ = thin(particles, SCORED_PARTICLES, rng)
    points = points[:, POSITION]
    score, rank = energy_score_and_rank(points, np.full(len(points), 1.0 / len(points)), truth[POSITION])
    return {
        "energy score": score,
        "position": float(np.linalg.norm(mean[POSITION] - truth[POSITION])),
        "velocity": float(np.linalg.norm(mean[VELOCITY] - truth[VELOCITY])),
        "yaw": float(abs(wrap(circular_mean(states[:, YAW], weights) - truth[YAW]))),
        COVERAGE: float(rank <= 0.9),
    }
