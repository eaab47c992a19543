"""The vacuum robots' assignment: its variants, metrics and thresholds."""

from dataclasses import replace

import numpy as np

from course_lib.scoring import best_share_error, energy_score, region_rank, thin
from course_lib.vacuum.constants import Constants, Hidden
from course_lib.vacuum.world import World
from grader.assignment import Assignment, Criterion, Speed, Variant

#: Particles that stand for a posterior in the scores that cost O(N²).
SCORED_PARTICLES = 250
#: Truths a prediction is compared with, in the variant without readings.
PREDICTED_TRUTHS = 300

# ETH's own figure, 0.40 m, earns full marks and 0.90 m none; the reference is at 0.29 m.
ACCURACY = (1.45, 3.1)
PROPER = (1.35, 2.2)


def simulate(variant, rng):
    """One run of a variant; many truths at once where no sensor ever reports."""
    world = World(variant.constants, variant.hidden)
    if variant.hidden.report_probability == 0.0:
        return world.simulate_many(rng, PREDICTED_TRUTHS)
    return world.simulate(rng)


def measure(particles, truth, rng):
    """Errors and scores of one posterior.

    Parameters
    ----------
    particles : Particles
        states (N, 6).
    truth : ndarray, shape (6,) or (M, 6)
        The true state, or M draws of it that share the estimator's inputs.
    rng : numpy.random.Generator
        Thins the posterior: a filter cannot know which of its particles are looked at.

    Returns
    -------
    dict of str to float
        "energy score" of the joint position (x_A, y_A, x_B, y_B) in metres; for a single truth also "best half" and
        "all particles", the exercise's errors of 2015 and of 2018 in metres, and "within 90 %", 1 when the truth
        lies in the most central 90 % of the posterior and 0 when not.
    """
    columns = [0, 1, 3, 4]
    states, _ = thin(particles, SCORED_PARTICLES, rng)
    weights = np.full(len(states), 1.0 / len(states))
    points, truths = states[:, columns], np.atleast_2d(truth)[:, columns]
    scores = {"energy score": energy_score(points, weights, truths)}
    if len(truths) > 1:
        return scores
    distances = [
        np.hypot(*(particles.states[:, column : column + 2] - truth[column : column + 2]).T) for column in (0, 3)
    ]
    return scores | {
        "best half": float(np.mean([best_share_error(distance, particles.weights) for distance in distances])),
        "all particles": float(np.mean([distance @ particles.weights for distance in distances])),
        "within 90 %": float(region_rank(points, weights, truths[0]) <= 0.9),
    }


def picture(variant):
    """The room and its sensors, for drawings."""
    constants = variant.constants
    names = ["S1 (A)", "S2 (A)", "S3 (B)", "S4 (B)"]
    return {
        "room": constants.room.tolist(),
        "sensors": [[x, y, name] for (x, y), name in zip(constants.sensors.tolist(), names, strict=True)],
        "targets": ["robot A", "robot B"],
        "unit": "m",
    }


def _variant(name, title, episodes, accuracy, proper, metric="best half", constants=None, hidden=None):
    return Variant(
        name=name,
        title=title,
        constants=replace(Constants(), **(constants or {})),
        hidden=replace(Hidden(), **(hidden or {})),
        episodes=episodes,
        criteria=(Criterion(metric, accuracy, *ACCURACY), Criterion("energy score", proper, *PROPER)),
    )


VARIANTS = (
    _variant("default", "the exercise as it is", 8, 20, 8),
    _variant("precise", "precise sensors: w̄ = 0.5 m", 2, 3, 1, constants={"w_bar": 0.5}),
    _variant("noisy", "noisy sensors: w̄ = 2 m", 2, 3, 1, constants={"w_bar": 2.0}),
    _variant("unmistaken", "sensors never take the wrong robot: s̄ = 0", 2, 3, 1, constants={"s_bar": 0.0}),
    _variant("mistaken", "sensors take either robot: s̄ = 0.5", 2, 3, 1, constants={"s_bar": 0.5}),
    _variant("mirror", "ideal reflections: v̄ = 0", 2, 3, 1, constants={"v_bar": 0.0}),
    _variant("rebound", "slightly random reflections: v̄ = 0.3", 2, 3, 1, constants={"v_bar": 0.3}),
    _variant("talkative", "every sensor reports in every step", 2, 3, 1, hidden={"report_probability": 1.0}),
    _variant("taciturn", "a sensor reports once in 20 steps", 2, 3, 1, hidden={"report_probability": 0.05}),
    _variant("fast", "fast robots: 2 to 4 m/s", 2, 3, 1, hidden={"slowest": 2.0, "fastest": 4.0}),
    _variant(
        "steady",
        "speeds that never change",
        2,
        3,
        1,
        hidden={"shortest_segment": 200, "longest_segment": 200},
    ),
    _variant("hall", "a room of 10 m, sampled every 0.2 s", 2, 3, 1, constants={"L": 10.0, "Ts": 0.2}),
    _variant("2017", "as in 2017: a room of 2L × L, random speeds", 2, 3, 1, constants={"length": 2.0, "v_s_bar": 0.1}),
    _variant(
        "2018",
        "as in 2018: as in 2017, all particles count",
        2,
        3,
        1,
        metric="all particles",
        constants={"length": 2.0, "v_s_bar": 0.1},
    ),
    Variant(
        name="silent",
        title="silent sensors: the motion model alone",
        constants=Constants(),
        hidden=Hidden(
            steps=40, shortest_segment=5, longest_segment=10, slowest=2.0, fastest=4.0, report_probability=0.0
        ),
        episodes=4,
        criteria=(Criterion("energy score", 10, 1.01, 1.15),),
    ),
)

ASSIGNMENTS = (
    Assignment(
        name="vacuum",
        title="Two vacuum robots: a particle filter",
        entry_point="Estimator",
        parameters=("previous", "observation", "control", "constants", "rng"),
        reference="course_lib.vacuum.reference:Estimator",
        simulate=simulate,
        measure=measure,
        dimension=6,
        picture=picture,
        positions=((0, 1), (3, 4)),
        variants=VARIANTS,
        speed=Speed(variant="default", steps=100, points=10, full=10.0, none=60.0),
        withheld=("course_lib.vacuum.models", "course_lib.vacuum.world", "course_lib.vacuum.reference"),
        deadline=5.0,
        landmarks={"best half": ((0.4, "ETH's own filter"), (1.8, "a uniform cloud"))},
    ),
)
