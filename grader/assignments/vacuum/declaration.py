"""The vacuum robots' assignment: its variants, metrics and thresholds."""

from dataclasses import replace

import numpy as np

from course_lib.scoring import best_share_error, energy_score, energy_score_and_rank, thin
from course_lib.vacuum.constants import Constants, Hidden
from course_lib.vacuum.world import World
from grader.assignment import Criterion, EstimatorAssignment, LogUniform, Speed, Uniform, Variant
from grader.result import COVERAGE

#: Particles that stand for a posterior in the scores that cost O(N²).
SCORED_PARTICLES = 200
#: Particles, and truths to compare them with, in the variant without readings.
PREDICTED = 1000

# Ratios to the reference that earn full marks and none. ETH's own filter, 0.40 m, is to earn full marks and 0.90 m
# none, where the reference is at 0.29 m.
ACCURACY = (1.4, 3.1)
PROPER = (1.25, 2.0)
# With long steps particles spread more than filters differ, which lets the limits be tight.
COARSE = (1.25, 1.7)
# Where nothing is random but the start, roughening is what is measured: a plain filter is at twice the reference.
MIRROR = ((2.6, 6.0), (2.1, 5.0))
# A cloud of 2000 exact particles is as far from the truths as the reference's, within a factor of 1.5.
PREDICTION = (2.0, 6.0)


def simulate(variant, rng):
    """One run of a variant; many truths at once where no sensor ever reports."""
    world = World(variant.constants, variant.hidden)
    if variant.hidden.report_probability == 0.0:
        return world.simulate_many(rng, PREDICTED)
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
        For a single truth "energy score" of the joint position (x_A, y_A, x_B, y_B) in metres, "best half" and
        "all particles", the exercise's errors of 2015 and of 2018 in metres, and "within 90 %", 1 when the truth
        lies in the most central 90 % of the posterior and 0 when not. For many truths "divergence": by how much
        the posterior's energy score exceeds that of the truths themselves, in metres.
    """
    columns = [0, 1, 3, 4]
    states, _ = thin(particles, SCORED_PARTICLES if truth.ndim == 1 else PREDICTED, rng)
    points, weights = states[:, columns], np.full(len(states), 1.0 / len(states))
    if truth.ndim > 1:
        truths = truth[:, columns]
        least = energy_score(truths, np.full(len(truths), 1.0 / len(truths)), truths)
        return {"divergence": energy_score(points, weights, truths) - least}
    distances = [
        np.hypot(*(particles.states[:, column : column + 2] - truth[column : column + 2]).T) for column in (0, 3)
    ]
    shares = particles.weights
    score, rank = energy_score_and_rank(points, weights, truth[columns])
    return {
        "best half": float(np.mean([best_share_error(distance, shares) for distance in distances])),
        "all particles": float(np.mean([distance @ shares for distance in distances])),
        "energy score": score,
        COVERAGE: float(rank <= 0.9),
    }


def picture(variant):
    """The room and its sensors, for drawings."""
    constants = variant.constants
    names = ["S1 (A)", "S2 (A)", "S3 (B)", "S4 (B)"]
    return {
        "room": [0.0, 0.0, *constants.room.tolist()],
        "sensors": [[x, y, name] for (x, y), name in zip(constants.sensors.tolist(), names, strict=True)],
        "targets": ["robot A", "robot B"],
        "unit": "m",
    }


def _variant(
    name,
    title,
    points,
    episodes=1,
    steps=100,
    metric="best half",
    limits=(ACCURACY, PROPER),
    constants=None,
    hidden=None,
    ranges=None,
):
    accuracy, proper = points
    return Variant(
        name=name,
        title=title,
        constants=replace(Constants(), **(constants or {})),
        hidden=replace(Hidden(steps=steps), **(hidden or {})),
        episodes=episodes,
        criteria=(Criterion(metric, accuracy, *limits[0]), Criterion("energy score", proper, *limits[1])),
        ranges=ranges or {},
    )


VARIANTS = (
    _variant("default", "the exercise as it is", (18, 8), episodes=6, steps=200),
    _variant("precise", "precise sensors: w̄ = 0.5 m", (2, 1), constants={"w_bar": 0.5}),
    # Where many filters lose a robot: few points.
    _variant("sharp", "very precise sensors: w̄ = 0.2 m", (1, 1), constants={"w_bar": 0.2}),
    _variant("noisy", "noisy sensors: w̄ = 2 m", (2, 1), constants={"w_bar": 2.0}),
    _variant("unmistaken", "sensors never take the wrong robot: s̄ = 0", (2, 1), constants={"s_bar": 0.0}),
    _variant("mistaken", "sensors take either robot: s̄ = 0.5", (2, 1), constants={"s_bar": 0.5}),
    _variant("mirror", "ideal reflections: v̄ = 0", (2, 1), limits=MIRROR, constants={"v_bar": 0.0}),
    _variant("rebound", "slightly random reflections: v̄ = 0.3", (1, 1), constants={"v_bar": 0.3}),
    _variant("talkative", "every sensor reports in every step", (2, 1), hidden={"report_probability": 1.0}),
    _variant("taciturn", "a sensor reports once in 20 steps", (2, 1), hidden={"report_probability": 0.05}),
    _variant("fast", "fast robots: 2 to 4 m/s", (2, 1), hidden={"slowest": 2.0, "fastest": 4.0}),
    _variant("steady", "speeds that never change", (2, 1), hidden={"shortest_segment": 100, "longest_segment": 100}),
    _variant("hall", "a room of 10 m, sampled every 0.2 s", (2, 1), constants={"L": 10.0, "Ts": 0.2}),
    _variant("2017", "as in 2017: a room of 2L × L, random speeds", (2, 1), constants={"length": 2.0, "v_s_bar": 0.1}),
    _variant(
        "2018",
        "as in 2018: as in 2017, and all particles count",
        (2, 1),
        metric="all particles",
        constants={"length": 2.0, "v_s_bar": 0.1},
    ),
    _variant(
        "coarse",
        "long steps of 0.5 s with several bounces",
        (4, 2),
        episodes=2,
        limits=(COARSE, COARSE),
        constants={"Ts": 0.5},
        hidden={"shortest_segment": 1, "longest_segment": 3, "fastest": 4.0, "report_probability": 0.4},
    ),
    # What the course's secret draws nobody can have tuned to. The ranges keep out what needs limits of its own.
    _variant(
        "drawn room",
        "a room of your grader's choosing",
        (3, 1),
        ranges={"L": Uniform(6.0, 10.0), "length": Uniform(1.0, 1.8)},
    ),
    _variant(
        "drawn sensors",
        "sensors of your grader's choosing",
        (3, 1),
        ranges={
            "w_bar": LogUniform(1.4, 2.2),
            "s_bar": Uniform(0.15, 0.35),
            "report_probability": LogUniform(0.1, 0.6),
        },
    ),
    _variant(
        "drawn robots",
        "speeds, bounces and a sampling time of your grader's choosing",
        (3, 1),
        ranges={
            "Ts": LogUniform(0.15, 0.3),
            "v_bar": Uniform(0.4, 0.9),
            "v_s_bar": Uniform(0.02, 0.1),
            "slowest": Uniform(0.5, 1.2),
            "fastest": Uniform(1.8, 3.0),
        },
    ),
    Variant(
        name="silent",
        title="silent sensors: the prior and the motion model alone",
        constants=Constants(Ts=0.5),
        hidden=Hidden(
            steps=12, shortest_segment=1, longest_segment=3, slowest=2.0, fastest=4.0, report_probability=0.0
        ),
        episodes=3,
        criteria=(Criterion("divergence", 8, *PREDICTION),),
    ),
)

ASSIGNMENTS = (
    EstimatorAssignment(
        name="vacuum",
        title="Two vacuum robots: a particle filter",
        entry_point="Estimator",
        reference="course_lib.vacuum.reference:Estimator",
        simulate=simulate,
        measure=measure,
        dimension=6,
        angles=(2, 5),
        picture=picture,
        positions=((0, 1), (3, 4)),
        variants=VARIANTS,
        speed=Speed(variant="default", steps=100, points=8, full=5.0, none=25.0),
        withheld=(
            "course_lib.vacuum.models",
            "course_lib.vacuum.world",
            "course_lib.vacuum.reference",
            "course_lib.vacuum.ablations",
        ),
        deadline=5.0,
        landmarks={"best half": ((0.4, "ETH's own filter"), (1.8, "a uniform cloud"))},
    ),
)
