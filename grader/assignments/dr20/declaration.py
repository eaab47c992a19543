"""The three assignments of the DR20, which has to find itself on a map: variants, metrics and thresholds.

Each metric is a proper score, so that nothing is gained by any other answer than what one believes, and none can exceed
a bound, so that a run in which the robot is lost for a while still says how well it was found before and after.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from course_lib.dr20 import maps
from course_lib.dr20.constants import ANGLES, HEADING, Constants, Hidden, X, Y
from course_lib.dr20.world import World
from course_lib.scoring import energy_score, energy_score_and_rank, kernel_score, thin
from grader.assignment import Criterion, EstimatorAssignment, LogUniform, Speed, Uniform, Variant
from grader.result import COVERAGE

#: Particles that stand for a posterior in the scores that cost O(N²).
SCORED_PARTICLES = 200
#: Errors count in full where they are small, and no more than this: metres, and a chord of the unit circle.
FARTHEST = 0.3
#: Who is so far off, in metres and radians, is lost: widths of the kernel.
LOST_POSITION, LOST_HEADING = 0.3, float(np.radians(15.0))
#: Added to "lost", as the share of a run in which nobody need have found himself yet: without it, ratios of next to
#: nothing would grade luck.
PATIENCE = {"local": 0.01, "global": 0.03, "kidnapped": 0.05}


def simulate(variant, rng):
    """One run of a variant."""
    return World(variant.constants, variant.hidden).simulate(rng)


def measure(particles, truth, rng, patience):
    """Errors and scores of one posterior.

    Parameters
    ----------
    particles : Particles
        states (N, 3).
    truth : ndarray, shape (3,)
    rng : numpy.random.Generator
        Thins the posterior: a filter cannot know which of its particles are looked at.
    patience : float
        Added to "lost".

    Returns
    -------
    dict of str to float
        "position score", the energy score of the position, in metres, and "heading score", that of (cos θ, sin θ), for
        small angles in radians, of distances that count no more than `FARTHEST`; "lost", the kernel score of the pose,
        which is 0 when all of the posterior is about the true pose, 1 when all of it is about a wrong one and 1/2 when
        it is nowhere in particular; "found", how much of the posterior is within 0.3 m and 15° of the truth; and
        "within 90 %", 1 when the true position lies in the most central 90 % of the posterior and 0 when not.
    """
    states, _ = thin(particles, SCORED_PARTICLES, rng)
    weights = np.full(len(states), 1.0 / len(states))
    position, true_position = states[:, [X, Y]], truth[[X, Y]]
    heading, true_heading = _on_the_circle(states[:, HEADING]), _on_the_circle(truth[HEADING])
    apart = np.hypot(*(particles.states[:, [X, Y]] - true_position).T)
    turned = 1.0 - np.cos(particles.states[:, HEADING] - truth[HEADING])
    near = (apart <= LOST_POSITION) & (turned <= 1.0 - np.cos(LOST_HEADING))
    return {
        "position score": energy_score(position, weights, true_position[None], FARTHEST),
        "heading score": energy_score(heading, weights, true_heading[None], FARTHEST),
        "lost": patience
        + kernel_score(
            np.hstack([position / LOST_POSITION, heading / LOST_HEADING]),
            weights,
            np.append(true_position / LOST_POSITION, true_heading / LOST_HEADING),
        ),
        "found": float(particles.weights @ near),
        COVERAGE: float(energy_score_and_rank(position, weights, true_position)[1] <= 0.9),
    }


def _on_the_circle(angles):
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def picture(variant):
    """The map from above, for drawings."""
    constants = variant.constants
    return {
        "room": constants.bounds.tolist(),
        "rings": [[list(vertex) for vertex in ring] for ring in (constants.room, *constants.obstacles)],
        "sensors": [],
        "targets": ["robot"],
        "unit": "m",
    }


class OneOf(tuple):
    """Of these, the secret chooses one."""

    def __call__(self, rng):
        """Draw one."""
        return self[rng.integers(len(self))]


# Ratios to the reference on the same run that earn full marks and none. A cloud of 16 000 and then 1000 particles whose
# copies part repeats the reference's scores to 20 %; the textbook's, where they stay copies until the motion's noise
# parts them, is at twice the position score, and jitter of 10 cm in every step at 2.6 times.
LOCAL = {"position score": (1.6, 3.2), "heading score": (1.5, 2.6), "lost": (1.4, 2.6)}
# Where noise is so large that copies part by themselves, right filters are within 10 %; a mean without a spread has √2
# times the score at least.
TIGHT = {"position score": (1.25, 1.7), "heading score": (1.3, 1.8), "lost": (1.3, 2.0)}
# Seven beams at once leave a handful of particles, from which a cloud has to grow again.
SEVEN = {"position score": (3.5, 7.0), "heading score": (2.5, 5.0), "lost": (2.2, 4.0)}
# Where the first scans leave many places, the reference has looked at all of them, a cloud drawn beforehand has not.
GLOBAL = {"position score": (2.2, 5.5), "heading score": (2.2, 5.5), "lost": (2.0, 5.0)}
# The reference needs half a second to find a robot that was carried away; three are to be good, and ten nothing.
KIDNAPPED = {"position score": (2.5, 7.0), "heading score": (2.5, 7.0), "lost": (2.2, 5.0)}


def _variant(name, title, points, limits, steps, episodes=1, constants=None, hidden=None, ranges=None):
    return Variant(
        name=name,
        title=title,
        constants=replace(Constants(), **(constants or {})),
        hidden=replace(Hidden(steps=steps), **(hidden or {})),
        episodes=episodes,
        criteria=tuple(Criterion(metric, worth, *limits[metric]) for metric, worth in zip(limits, points, strict=True)),
        ranges=ranges or {},
    )


def _local(name, title, points=(1.5, 1.0, 1.5), limits=LOCAL, steps=60, constants=None, **setting):
    return _variant(
        name,
        title,
        points,
        limits,
        steps,
        constants={"near": (1.0, 1.0), "within": 1.0, **(constants or {})},
        **setting,
    )


def _global(name, title, points=(1.5, 1.0, 2.5), limits=GLOBAL, steps=100, **setting):
    return _variant(name, title, points, limits, steps, **setting)


def _kidnapped(
    name, title, points=(1.5, 1.0, 3.5), limits=KIDNAPPED, steps=200, kidnaps=1, constants=None, hidden=None, **setting
):
    constants = {"kidnap_rate": kidnaps / (steps * (constants or {}).get("Ts", Constants.Ts)), **(constants or {})}
    hidden = {"kidnaps": kidnaps, **(hidden or {})}
    return _variant(name, title, points, limits, steps, constants=constants, hidden=hidden, **setting)


def _degrees(angle):
    return float(np.radians(angle))


#: Where a robot may stand in the default room, with a metre about it that is not all tables.
STARTS = OneOf([(1.0, 1.0), (4.0, 2.5), (1.0, 4.0), (3.5, 3.0), (4.2, 0.8)])
FLAT = {"room": maps.FLAT, "obstacles": maps.PARTITIONS}
ATTIC = {"room": maps.ATTIC, "obstacles": maps.CHIMNEYS}
PRECISE = {"sigma": 0.02}
NOISY = {"sigma": 0.15, "sigma_v": 0.1, "sigma_omega": _degrees(10.0)}
CLUTTER = {"p_short": 0.4, "rate_short": 1.5}
NEARSIGHTED = {"r_max": 1.5}
MOUNT = {"mount": 0.18, "radius": 0.2}
# Seven beams, from left to right, two of which look back.
BEAMS = {"bearings": tuple(_degrees(angle) for angle in (150.0, 90.0, 30.0, 0.0, -30.0, -90.0, -150.0))}
COARSE = {"Ts": 0.3}
FAST = {"slowest": 0.8, "fastest": 1.5}
# A beam that is often missed, as far as anyone is told, and that is never heard.
DEAF = {"p_miss": 0.15}

# What the course's secret draws nobody can have tuned to. The ranges keep out what needs limits of its own.
BEAM = {
    "sigma": LogUniform(0.03, 0.1),
    "p_short": Uniform(0.02, 0.2),
    "rate_short": LogUniform(0.5, 2.0),
    "p_miss": Uniform(0.01, 0.15),
    "r_max": Uniform(2.5, 5.0),
}
ROBOT = {
    "radius": Uniform(0.1, 0.2),
    "mount": Uniform(0.0, 0.1),
    "sigma_v": LogUniform(0.02, 0.08),
    "sigma_omega": LogUniform(0.03, 0.15),
    "Ts": LogUniform(0.08, 0.2),
    "fastest": Uniform(0.5, 1.0),
}

LOCAL_VARIANTS = (
    _local("default", "the room with five tables", (14, 8, 14), steps=100, episodes=4),
    _local("precise", "precise beams: 2 cm", constants=PRECISE),
    _local("noisy", "noisy beams and a noisy robot: 15 cm, 10 cm/s, 10°/s", limits=TIGHT, constants=NOISY),
    _local("clutter", "two readings in five end at something before the wall", constants=CLUTTER),
    _local("dead", "a beam that never reports", constants=DEAF, hidden={"dead": (3,)}),
    _local("near-sighted", "beams that see no farther than 1.5 m", constants=NEARSIGHTED),
    _local("fast", "a robot of 0.8 to 1.5 m/s", hidden=FAST, constants={"near": (4.0, 2.5)}),
    _local("mount", "beams that start ahead of the axle", constants=MOUNT),
    _local("beams", "seven beams in other directions", limits=SEVEN, constants={"near": (1.0, 4.0), **BEAMS}),
    _local("coarse", "sampled every 0.3 s", constants=COARSE, steps=40),
    _local("slip", "a robot three times as noisy as told", hidden={"slip": 3.0}),
    _local("flat", "two rooms and a corridor", constants={**FLAT, "near": (3.5, 1.5)}),
    _local("attic", "a room without a right angle", constants={**ATTIC, "near": (2.8, 3.4)}),
    _local("drawn beams", "beams of your grader's choosing", ranges={"near": STARTS, **BEAM}),
    _local("drawn robot", "a robot and a sampling time of your grader's choosing", ranges={"near": STARTS, **ROBOT}),
)

GLOBAL_VARIANTS = (
    _global("default", "the room with five tables", (14, 9, 19), episodes=4),
    _global("precise", "precise beams: 2 cm", constants=PRECISE),
    _global("noisy", "noisy beams and a noisy robot: 15 cm, 10 cm/s, 10°/s", constants=NOISY),
    _global("clutter", "two readings in five end at something before the wall", constants=CLUTTER),
    _global("dead", "a beam that never reports", constants=DEAF, hidden={"dead": (3,)}),
    _global("near-sighted", "beams that see no farther than 1.5 m", constants=NEARSIGHTED),
    _global("beams", "seven beams in other directions", constants=BEAMS),
    _global("flat", "two rooms and a corridor", constants=FLAT),
    _global("attic", "a room without a right angle", constants=ATTIC),
    _global("drawn beams", "beams of your grader's choosing", ranges=BEAM),
    _global("drawn robot", "a robot and a sampling time of your grader's choosing", ranges=ROBOT),
)

KIDNAPPED_VARIANTS = (
    _kidnapped("default", "the room with five tables, kidnapped once in 20 s", (10, 6, 20), episodes=4),
    _kidnapped("twice", "kidnapped twice in 30 s", (5, 3, 12), steps=300, kidnaps=2, episodes=2),
    _kidnapped("noisy", "noisy beams and a noisy robot: 15 cm, 10 cm/s, 10°/s", constants=NOISY),
    _kidnapped("clutter", "two readings in five end at something before the wall", constants=CLUTTER),
    _kidnapped("beams", "seven beams in other directions", constants=BEAMS),
    _kidnapped("flat", "two rooms and a corridor", constants=FLAT),
    _kidnapped("attic", "a room without a right angle", constants=ATTIC),
    _kidnapped("drawn beams", "beams of your grader's choosing", ranges=BEAM),
)

#: Beside these, the map's polygons and what every unit shares is given.
WITHHELD = (
    "course_lib.dr20.models",
    "course_lib.dr20.world",
    "course_lib.dr20.report.method",
    "course_lib.dr20.report.listing",
    "course_lib.dr20.field",
    "course_lib.dr20.mcl",
    "course_lib.dr20.candidates",
    "course_lib.dr20.symmetry",
    "course_lib.dr20.success",
    "course_lib.dr20.reference",
    "course_lib.dr20.recorded.laser",
    "course_lib.dr20.recorded.scans",
    "course_lib.geometry.raycast",
    "course_lib.geometry.lookup",
    "course_lib.filters.adaptive",
    "course_lib.filters.modes",
)

_SHARED = dict(
    entry_point="Estimator",
    reference="course_lib.dr20.reference:Estimator",
    simulate=simulate,
    dimension=3,
    angles=ANGLES,
    picture=picture,
    positions=((X, Y),),
    withheld=WITHHELD,
    given=("course_lib.geometry.polygons",),
    deadline=5.0,
)

ASSIGNMENTS = (
    EstimatorAssignment(
        name="dr20-local",
        title="DR20: Monte Carlo localization from a known start",
        variants=LOCAL_VARIANTS,
        measure=partial(measure, patience=PATIENCE["local"]),
        speed=Speed(variant="default", steps=50, points=8, full=10.0, none=50.0),
        **_SHARED,
    ),
    EstimatorAssignment(
        name="dr20-global",
        title="DR20: Monte Carlo localization from an unknown start",
        variants=GLOBAL_VARIANTS,
        measure=partial(measure, patience=PATIENCE["global"]),
        speed=Speed(variant="default", steps=50, points=8, full=10.0, none=50.0),
        **_SHARED,
    ),
    EstimatorAssignment(
        name="dr20-kidnapped",
        title="DR20: Monte Carlo localization of a kidnapped robot",
        variants=KIDNAPPED_VARIANTS,
        measure=partial(measure, patience=PATIENCE["kidnapped"]),
        speed=Speed(variant="default", steps=50, points=8, full=10.0, none=50.0),
        **_SHARED,
    ),
)
