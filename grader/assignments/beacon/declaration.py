"""The assignments of the quadrotor's estimators, an EKF and a particle filter: variants, metrics and thresholds.

The planner's stand in `planner`.
"""

from dataclasses import replace

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon.constants import ANGLES, POSITION, VELOCITY, YAW, Constants, Hidden
from course_lib.beacon.world import World
from course_lib.filters import Gaussian, covariance, mean
from course_lib.scoring import energy_score, energy_score_and_rank, nees, thin
from grader.assignment import Criterion, EstimatorAssignment, LogUniform, Speed, Uniform, Variant
from grader.assignments.beacon import planner
from grader.result import COVERAGE, NEES

#: Particles that stand for a posterior in the scores that cost O(N²).
SCORED_PARTICLES = 200
#: What a particle cloud is wrong by counts no more than this: one that has shrunk to a point is wrong by infinity.
LARGEST_NEES = 1e4

# Ratios to the reference on the same run that earn full marks and none. Filters that are right and deterministic repeat
# the reference's energy scores to 8 % and its NEES to 4 %. A mean without a spread has √2 times the score at least.
KALMAN = {"energy score": (1.1, 1.4), "velocity score": (1.1, 1.5), "yaw": (1.15, 2.0), NEES: (1.2, 2.0)}
# One beacon holds the position by the yaw alone, and ranges to corners at half the height hardly hold the altitude:
# there linearisations part.
ALONE = {"energy score": (1.5, 2.5), "velocity score": (1.3, 1.8), "yaw": (1.5, 3.0), NEES: (1.8, 4.0)}
# The reference finds out that a beacon is biased, which nobody is asked to: that costs a plain filter 1.6 to 2.5 times.
OFF = {"energy score": (2.8, 6.0), "velocity score": (1.3, 2.0), "yaw": (1.3, 2.5), NEES: (4.0, 12.0)}
# Particles are drawn, so that right filters differ.
PARTICLES = {"energy score": (1.12, 1.5), "velocity score": (1.15, 1.6), NEES: (1.4, 2.5)}
# With so much between two readings, a particle or a few carry all the weight at times: NEES jumps, the scores do not.
BLOWN = {"energy score": (1.1, 1.4), "velocity score": (1.15, 1.6), NEES: (2.5, 10.0)}
# Where they are few for what there is to find out, or told something that is not so, they differ more.
ADRIFT = {"energy score": (1.6, 3.0), "velocity score": (1.6, 3.0), NEES: (3.0, 10.0)}


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
        "energy score" of the position in m, "velocity score", that of the velocity in m/s; "position", "velocity" and
        "yaw", the errors of the mean in m, m/s and rad; "NEES" of mean and covariance; and "within 90 %", 1 when the
        true position lies in the most central 90 % of the posterior and 0 when not.
    """
    centre = mean(particles, ANGLES)
    states, _ = thin(particles, SCORED_PARTICLES, rng)
    weights = np.full(len(states), 1.0 / len(states))
    score, rank = energy_score_and_rank(states[:, POSITION], weights, truth[POSITION])
    moments = Gaussian(centre, covariance(particles, ANGLES))
    return {
        "energy score": score,
        "velocity score": energy_score(states[:, VELOCITY], weights, truth[None, VELOCITY]),
        "position": float(np.linalg.norm(centre[POSITION] - truth[POSITION])),
        "velocity": float(np.linalg.norm(centre[VELOCITY] - truth[VELOCITY])),
        "yaw": float(abs(wrap(centre[YAW] - truth[YAW]))),
        NEES: float(min(nees(moments, truth[None], ANGLES)[0], LARGEST_NEES)),
        COVERAGE: float(rank <= 0.9),
    }


def picture(variant):
    """The room from above with its beacons, for drawings."""
    r = variant.constants.R / 2
    corners = variant.constants.beacons[:, :2].tolist()
    return {
        "room": [-r, -r, r, r],
        "sensors": [[x, y, f"beacon {number}"] for number, (x, y) in enumerate(corners, 1)],
        "targets": ["vehicle"],
        "unit": "m",
    }


def _degrees(angle):
    return float(np.radians(angle))


def _start(position=0.5, tilt=2.0, yaw=5.0, velocity=0.3, rates=0.1):
    """`Constants.start_sigma`, with angles in degrees."""
    return (position, _degrees(tilt), _degrees(yaw), velocity, rates)


def _variant(name, title, points, limits, steps, episodes=1, constants=None, hidden=None, ranges=None):
    return Variant(
        name=name,
        title=title,
        constants=replace(Constants(), **(constants or {})),
        hidden=replace(Hidden(steps=steps), **(hidden or {})),
        episodes=episodes,
        criteria=tuple(
            Criterion(metric, worth, *limits[metric]) for metric, worth in zip(limits, points, strict=True) if worth
        ),
        ranges=ranges or {},
    )


def _kalman(name, title, points=(1.25, 0.5, 0.5, 1.25), limits=KALMAN, steps=80, **setting):
    return _variant(name, title, points, limits, steps, **setting)


def _particles(name, title, points=(2.5, 1.0, 2.0), limits=PARTICLES, steps=50, constants=None, **setting):
    # From half a metre, most of 5000 particles are lost at the first reading: that is a variant of its own.
    constants = {"start_sigma": _start(0.2, 2.0, 5.0, 0.2, 0.05), **(constants or {})}
    return _variant(name, title, points, limits, steps, constants=constants, **setting)


PRECISE = {"sigma_rho": 0.03, "sigma_alpha": _degrees(0.5), "sigma_a": 0.03}
NOISY = {"sigma_rho": 0.4, "sigma_alpha": _degrees(8.0), "sigma_a": 0.4}
NOISIER = {"sigma_rho": 0.2, "sigma_alpha": _degrees(5.0), "sigma_a": 0.2}
FAINT = {"sigma_rho": 0.6, "sigma_alpha": _degrees(12.0), "sigma_a": 0.6}
BEHIND = {"start": (0.0, 0.0, 2.0, float(np.pi))}
TOWER = {"R": 6.0, "h": 12.0, "start": (1.5, -1.0, 2.5, 0.0)}
HALL = {"R": 20.0, "h": 6.0, "start": (3.0, -2.0, 3.0, 1.0)}
HEAVY = {"mass": 1.6, "inertia": (0.03, 0.03, 0.05), "arm": 0.3, "drag": 1.0}
STORM = {"Ts": 0.1, "sigma_v": 0.8, "sigma_w": 0.2}

# What the course's secret draws nobody can have tuned to. The ranges keep out what needs limits of its own.
ROOM = {"R": Uniform(7.0, 18.0), "h": Uniform(3.0, 6.0)}
SENSORS = {
    "sigma_rho": LogUniform(0.06, 0.25),
    "sigma_alpha": LogUniform(0.02, 0.08),
    "sigma_a": LogUniform(0.06, 0.25),
    "outage": Uniform(0.05, 0.4),
}
VEHICLE = {
    "Ts": LogUniform(0.03, 0.09),
    "mass": Uniform(0.8, 1.6),
    "drag": Uniform(0.1, 1.0),
    "k": LogUniform(0.0001, 0.001),
    "sigma_v": LogUniform(0.1, 0.5),
    "sigma_w": LogUniform(0.03, 0.1),
}

KALMAN_VARIANTS = (
    _kalman("default", "a room of 10 m with four beacons", (4.5, 2, 2, 4.5), steps=150, episodes=3),
    _kalman("precise", "precise sensors: 3 cm, half a degree", constants=PRECISE),
    _kalman("noisy", "noisy sensors: 40 cm, 8 degrees", constants=NOISY),
    _kalman("outages", "every other reading is missing", hidden={"outage": 0.5}),
    _kalman("dead", "beacon 2 is never heard", hidden={"dead": (1,)}),
    _kalman("two", "only beacons 1 and 3 are heard", hidden={"dead": (1, 3)}),
    _kalman(
        "alone",
        "only beacon 3 is heard",
        limits=ALONE,
        constants={"start_sigma": _start(0.3, 2.0, 3.0, 0.2, 0.1)},
        hidden={"dead": (0, 1, 3)},
    ),
    _kalman(
        "bias",
        "the range of a beacon is off, and nobody says so",
        (1.0, 0.25, 0.25, 0.5),
        OFF,
        hidden={"bias": (0.3, 0.0, 0.0, 0.0)},
    ),
    _kalman("shaky", "noisy rotors: k = 0.003 N", constants={"k": 0.003}),
    _kalman("shakier", "rotors four times as noisy as told", constants={"k": 0.001}, hidden={"gain": 4.0}),
    _kalman("calm", "hardly any gusts", constants={"sigma_v": 0.02, "sigma_w": 0.005}),
    _kalman("storm", "strong gusts, sampled every 0.1 s", (2.5, 1, 1, 2.5), constants=STORM),
    _kalman("yaw", "a yaw known to 40 degrees at the start", constants={"start_sigma": _start(yaw=40.0)}),
    _kalman("behind", "starts with its back to the x axis", constants=BEHIND),
    _kalman("tower", "a room of 6 m, 12 m high", (2.5, 1, 1, 2.5), constants=TOWER),
    _kalman("hall", "a room of 20 m, 6 m high", constants=HALL),
    _kalman("heavy", "a heavier vehicle with more drag", constants=HEAVY),
    _kalman(
        "corner",
        "starts beside a beacon",
        constants={"start": (4.5, 4.5, 3.4, 0.5), "start_sigma": _start(position=0.1)},
        hidden={"reach": 0.9},
    ),
    _kalman("altimeter", "an altimeter that is off by a metre", limits=ALONE, constants={"sigma_a": 1.0}),
    _kalman("drawn room", "a room of your grader's choosing", constants={"start": (0.0, 0.0, 1.5, 2.0)}, ranges=ROOM),
    _kalman("drawn sensors", "sensors of your grader's choosing", ranges=SENSORS),
    _kalman("drawn vehicle", "vehicle, gusts and sampling time of your grader's choosing", ranges=VEHICLE),
)

PARTICLE_VARIANTS = (
    _particles("default", "a room of 10 m with four beacons", (9, 4, 8), steps=80, episodes=2),
    _particles(
        "precise",
        "precise sensors: 5 cm, one degree",
        constants={
            "sigma_rho": 0.05,
            "sigma_alpha": _degrees(1.0),
            "sigma_a": 0.05,
            "start_sigma": _start(0.1, 1.0, 3.0, 0.1, 0.03),
        },
    ),
    _particles("outages", "every other reading is missing", hidden={"outage": 0.5}),
    _particles(
        "faint",
        "sensors that are noisy and seldom heard",
        (4.5, 1.0, 2.0),
        constants={**FAINT, "start_sigma": _start(yaw=20.0)},
        hidden={"outage": 0.7},
    ),
    _particles("two", "only beacons 1 and 3 are heard", hidden={"dead": (1, 3)}),
    _particles(
        "behind",
        "starts with its back to the x axis",
        (3.5, 1.0, 3.0),
        steps=30,
        episodes=3,
        constants={**BEHIND, "start_sigma": _start(0.2, 2.0, 0.5, 0.2, 0.05)},
    ),
    _particles(
        "yaw",
        "a yaw known to 120 degrees at the start",
        (2.5, 1.0, 1.5),
        ADRIFT,
        constants={"start_sigma": _start(0.1, 1.0, 120.0, 0.1, 0.03)},
    ),
    _particles("wide", "starts anywhere in a metre", (1.0, 0.5, 0.5), ADRIFT, constants={"start_sigma": _start(0.5)}),
    _particles(
        "shakier",
        "rotors twice as noisy as told",
        (1.0, 0.5, 0.5),
        ADRIFT,
        constants={"k": 0.0003},
        hidden={"gain": 2.0},
    ),
    _particles(
        "bias",
        "the range of a beacon is off, and nobody says so",
        (1.0, 0.5, 0.5),
        ADRIFT,
        hidden={"bias": (0.2, 0.0, 0.0, 0.0)},
    ),
    _particles(
        "hurricane",
        "gusts that move the vehicle farther than readings are off",
        (3.5, 1.0, 2.0),
        BLOWN,
        constants={**NOISIER, "Ts": 0.1, "sigma_v": 3.0, "sigma_w": 0.1},
    ),
    _particles("tower", "a room of 6 m, 12 m high", constants=TOWER),
    _particles(
        "drawn room", "a room of your grader's choosing", constants={"start": (0.0, 0.0, 1.5, 2.0)}, ranges=ROOM
    ),
    _particles("drawn sensors", "sensors of your grader's choosing", ranges=SENSORS),
    _particles("drawn vehicle", "vehicle, gusts and sampling time of your grader's choosing", ranges=VEHICLE),
)

#: Beside these, the quadrotor and what every unit shares is given.
WITHHELD = (
    "course_lib.beacon.models",
    "course_lib.beacon.geometry",
    "course_lib.beacon.world",
    "course_lib.beacon.ekf",
    "course_lib.beacon.particle_filter",
    "course_lib.beacon.reference",
    "course_lib.beacon.planar.robot",
    "course_lib.beacon.planar.filters",
    "course_lib.beacon.planar.calibration",
    "course_lib.filters.extended_kalman",
    "course_lib.filters.regularized",
)

_SHARED = dict(
    simulate=simulate,
    measure=measure,
    dimension=12,
    angles=ANGLES,
    picture=picture,
    positions=((0, 1),),
    withheld=WITHHELD,
    deadline=5.0,
    landmarks={"energy score": ((0.05, "the worked examination's filter, mended"), (10.8, "dead reckoning"))},
)

ASSIGNMENTS = (
    EstimatorAssignment(
        name="beacon-ekf",
        title="A quadrotor among beacons: an extended Kalman filter",
        entry_point="Estimator",
        reference="course_lib.beacon.reference:Estimator",
        variants=KALMAN_VARIANTS,
        given=("course_lib.beacon.quadrotor", "filterpy.kalman"),
        speed=Speed(variant="default", steps=100, points=8, full=2.0, none=10.0),
        **_SHARED,
    ),
    EstimatorAssignment(
        name="beacon-pf",
        title="A quadrotor among beacons: a particle filter",
        entry_point="ParticleEstimator",
        reference="course_lib.beacon.reference:ParticleEstimator",
        variants=PARTICLE_VARIANTS,
        given=("course_lib.beacon.quadrotor",),
        speed=Speed(variant="default", steps=50, points=8, full=2.0, none=6.0),
        **_SHARED,
    ),
    *planner.ASSIGNMENTS,
)
