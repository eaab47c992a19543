"""The exercises of the DR20 notebook, from one step of the motion to a filter that notices a kidnapping.

Metres, seconds, radians; states are (N, 3), columns x, y, heading, in the map's frame; `constants` is
`course_lib.dr20.constants.Constants`, of which B = len(bearings) beams. Headings of results are in [-π, π).

motion
    transition(states, control, constants, rng) -> (N, 3)
        control (2,): commanded v and ω. Noise on both, an arc, up to the wall; `polygons.reach` is given.
ray
    ray(x, y, angle, walls) -> float
        walls (S, 4). Metres to the first wall; inf where there is none.
scan
    distances(states, constants) -> (N, B)
        However far; inf where there is no wall.
log-likelihood
    log_likelihood(observation, states, constants) -> (N,)
        observation (B,), inf where a beam sees nothing. Natural logarithm, not normalised.
resample
    resample(log_weights, rng) -> indices (N,)
        log_weights (N,), not normalised, some -inf. Systematic.
heading
    mean_pose(states, weights) -> (3,)
        weights (N,), normalised.
estimator
    Estimator(previous, observation, control, constants, rng) -> Particles, array (N, 3) or Step of these
        As handed in for dr20-local and dr20-global.
averages
    averages(w_avg, w_slow, w_fast, alpha_slow, alpha_fast) -> w_slow, w_fast, share
        Likelihoods; w_slow and w_fast are None on the first call.
augmented
    Estimator(previous, observation, control, constants, rng)
        As handed in for dr20-kidnapped.
kld
    kld_size(occupied_bins, epsilon, z) -> int
        Rounded up; 1 for one bin.
mode
    modal_pose(states, weights) -> (3,)
        weights (N,), normalised. The mean of the heaviest cluster.
"""

import math

import numpy as np

from course_lib.dr20.constants import ANGLES
from course_lib.filters import Particles, modes
from grader.assignments.dr20 import cloud_checks, likelihood_checks, motion_checks, pose_checks, run_checks, scan_checks
from grader.check import Exercise

#: Bins of clusters: metres, metres, radians.
CLUSTER = (0.25, 0.25, 0.35)


def ray(x, y, angle, walls):
    """Distance to the first wall along one ray."""
    # o + t u = a + s (b - a):  t = (a - o) × (b - a) / u × (b - a),  s = (a - o) × u / u × (b - a)
    px, py = walls[:, 0] - x, walls[:, 1] - y
    ex, ey = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    ux, uy = np.cos(angle), np.sin(angle)
    across = ux * ey - uy * ex
    with np.errstate(divide="ignore", invalid="ignore"):
        t, s = (px * ey - py * ex) / across, (px * uy - py * ux) / across
        return float(np.min(t[(t >= 0) & (s >= 0) & (s <= 1)], initial=np.inf))


def resample(log_weights, rng):
    """Indices of the offspring, by systematic resampling."""
    ends = np.cumsum(np.exp(log_weights - np.max(log_weights)))
    positions = (rng.random() + np.arange(len(ends))) / len(ends)
    return np.searchsorted(ends / ends[-1], positions)


def mean_pose(states, weights):
    """Weighted mean of poses, of headings on the circle."""
    x, y, _ = weights @ states
    heading = np.arctan2(weights @ np.sin(states[:, 2]), weights @ np.cos(states[:, 2]))
    return np.array([x, y, heading])


def averages(w_avg, w_slow, w_fast, alpha_slow, alpha_fast):
    """Both running averages of the likelihood, and the share of particles to draw anew."""
    if w_slow is None:
        return w_avg, w_avg, 0.0
    w_slow = w_slow + alpha_slow * (w_avg - w_slow)
    w_fast = w_fast + alpha_fast * (w_avg - w_fast)
    return w_slow, w_fast, max(0.0, 1.0 - w_fast / w_slow)


def kld_size(occupied_bins, epsilon, z):
    """How many particles a histogram of so many bins needs, by Fox's bound."""
    if occupied_bins <= 1:
        return 1
    freedom = occupied_bins - 1
    part = 2.0 / (9.0 * freedom)
    return math.ceil(freedom / (2.0 * epsilon) * (1.0 - part + math.sqrt(part) * z) ** 3)


def modal_pose(states, weights):
    """Mean of the heaviest cluster."""
    with np.errstate(divide="ignore"):
        return modes.heaviest(Particles(states, np.log(weights)), CLUSTER, ANGLES).mean


EXERCISES = (
    Exercise(
        "motion",
        "One step of a noisy robot",
        motion_checks.motion,
        "course_lib.dr20.models:transition",
        (
            "What is noisy is what the robot executes. Draw a v and an ω for each particle; everything else is "
            "geometry, up to the wall.",
            r"$\hat v = v + \sigma_v \varepsilon$, $\hat\omega = \omega + \sigma_\omega \varepsilon'$. An arc that "
            r"turns by $\hat\omega T_s$ has the chord $\hat v T_s \sin(a)/a$, $a = \hat\omega T_s / 2$, along "
            r"$\theta + a$; `np.sinc(a / np.pi)` is sin(a)/a at 0 too. The robot stops at contact, and goes on "
            r"turning.",
            "`chord = v * constants.Ts * np.sinc(a / np.pi)`; `direction = heading + a + np.where(chord < 0, np.pi, "
            "0.0)`; `dx, dy = np.cos(direction), np.sin(direction)`; `way = reach(x, y, dx, dy, np.abs(chord), "
            "constants)`; return `np.column_stack([x + way * dx, y + way * dy, wrap(heading + 2 * a)])`.",
        ),
    ),
    Exercise(
        "ray",
        "One ray against all walls",
        scan_checks.ray,
        ray,
        (
            "Where do two lines meet? And is that place on the wall, and ahead?",
            r"With the wall from $a$ to $b$, $p = a - o$, $e = b - a$ and $u = (\cos\varphi, \sin\varphi)$: $t = (p "
            r"\times e) / (u \times e)$ along the ray, $s = (p \times u) / (u \times e)$ along the wall, where $p "
            r"\times e = p_x e_y - p_y e_x$. It is met when $t \geq 0$ and $0 \leq s \leq 1$.",
            'With `px, py, ex, ey` (S,): `across = ux * ey - uy * ex`; within `with np.errstate(divide="ignore", '
            'invalid="ignore"):` `t = (px * ey - py * ex) / across`, `s = (px * uy - py * ux) / across`; return '
            "`float(np.min(t[(t >= 0) & (s >= 0) & (s <= 1)], initial=np.inf))`.",
        ),
    ),
    Exercise(
        "scan",
        "All rays of all particles",
        scan_checks.scan,
        "course_lib.dr20.models:distances",
        (
            "The same two quotients; particles, beams and walls each have an axis of their own: (N, B, S).",
            "Directions are `heading[:, None] + bearings`, (N, B); the beams start `constants.mount` ahead along the "
            "heading. `p` has shape (N, 1, S), `e` (S,), `u` (N, B, 1): NumPy does the rest. The smallest along the "
            "last axis counts.",
            "`x = states[:, 0] + constants.mount * np.cos(states[:, 2])`, likewise y; `px = walls[:, 0] - x[:, None, "
            "None]`; `ux = np.cos(directions)[:, :, None]`; t and s as in `ray`; return `np.where((t >= 0) & (s >= "
            "0) & (s <= 1), t, np.inf).min(axis=2)`.",
        ),
    ),
    Exercise(
        "log-likelihood",
        "The beam model",
        likelihood_checks.log_likelihood,
        "course_lib.dr20.models:log_likelihood",
        (
            "A reading has four possible causes, whose densities add, each with its probability. Beams are "
            "independent, so their logarithms add. And a beam that sees nothing says something too: with which "
            "probability does it?",
            r"$p(z | d) = p_{hit}\, \mathcal N(z; d, \sigma^2) + p_{short}\, \lambda e^{-\lambda z} / (1 - "
            r"e^{-\lambda d})\, [z \leq d] + p_{random} / r_{max}$. $P(\infty | d) = p_{miss} + p_{hit}\, \Phi((d - "
            r"r_{max}) / \sigma) + p_{short}\, (e^{-\lambda r_{max}} - e^{-\lambda d}) / (1 - e^{-\lambda d})\, [d > "
            r"r_{max}]$. $p_{hit}$ is what the others leave of 1.",
            "`d = distances(states, constants)`; `there = np.isfinite(observation)`; `z = np.where(there, "
            "observation, 0.0)`; both formulas for all, with `np.where(z <= d, ..., 0.0)`, `np.where(d > "
            "constants.r_max, ..., 0.0)` and `scipy.special.ndtr` for Φ; return `np.log(np.where(there, reading, "
            "nothing)).sum(axis=1)`.",
        ),
    ),
    Exercise(
        "resample",
        "Low-variance resampling from logarithms",
        cloud_checks.resample,
        resample,
        (
            "Only ratios of weights count, and so differences of their logarithms. Lay the weights end to end and "
            "put N equally spaced marks on them.",
            "Subtract the largest log-weight before `np.exp`. One number u shifts all marks: (u + n) / N. "
            "`np.cumsum` ends a little beside 1, whatever you divide by before it.",
            "`ends = np.cumsum(np.exp(log_weights - log_weights.max()))`; return `np.searchsorted(ends / ends[-1], "
            "(rng.random() + np.arange(N)) / N)`.",
        ),
    ),
    Exercise(
        "heading",
        "The mean of poses",
        pose_checks.heading,
        mean_pose,
        (
            "What is half-way between 179° and -179°? Not what their mean is as numbers.",
            r"A heading is a direction $(\cos\theta, \sin\theta)$. Average these by weight; the mean heading is "
            r"where the "
            "average points to.",
            "`np.arctan2(weights @ np.sin(states[:, 2]), weights @ np.cos(states[:, 2]))`; x and y are `weights @ "
            "states[:, :2]`.",
        ),
    ),
    Exercise(
        "estimator",
        "Monte Carlo localization",
        run_checks.estimator,
        "course_lib.dr20.reference:Estimator",
        (
            "You have all the pieces. On the first call draw the prior; on every other move, weigh, resample. Then "
            "look at how many particles are near the robot, step by step.",
            "A likelihood of five beams of 5 cm is a needle in a room of 25 m² and 360°: of 1000 particles hardly "
            "one is near enough to win. More particles on the first call, of which you keep fewer from step to step; "
            "a likelihood made wider; a little jitter, so that copies part.",
            "First call: `cloud = prior(FIRST, constants, rng)`, return `Step(equally_weighted(cloud), (cloud, 0))`. "
            "Then `cloud, k = previous.memory`; `states = transition(cloud, control, constants, rng)`; weigh by "
            "`log_likelihood(observation, states, told)`, where `told = replace(constants, sigma=3 * constants.sigma)` "
            "in the first ten steps; the posterior is `Particles(states, log_weights)`; and "
            "`shaken(states[evenly(resample(log_weights, rng), n)], rng)` is what you remember, with n = FIRST in "
            "these steps and KEPT after them.",
        ),
    ),
    Exercise(
        "averages",
        "Notice that something is wrong",
        cloud_checks.averages,
        averages,
        (
            "When the cloud explains the scans worse than it used to, the robot has been carried off. Used to: a long "
            "average. Worse now: a short one.",
            r"$w \leftarrow w + \alpha (w_{avg} - w)$ for both, with $\alpha_{slow} \ll \alpha_{fast}$; share $= "
            r"\max(0, 1 - w_{fast} / w_{slow})$. On the first call both are $w_{avg}$.",
            "`if w_slow is None: return w_avg, w_avg, 0.0`; `w_slow = w_slow + alpha_slow * (w_avg - w_slow)`; "
            "likewise `w_fast`; return `w_slow, w_fast, max(0.0, 1.0 - w_fast / w_slow)`.",
        ),
    ),
    Exercise(
        "augmented",
        "A filter that survives a kidnapping",
        run_checks.augmented,
        "course_lib.dr20.reference:Estimator",
        (
            "The cloud cannot get to where it has no particle. Put some there, when `averages` says so: there is "
            "everywhere.",
            "The mean likelihood of the cloud, before you normalise, goes into `averages`; after resampling each "
            "particle is replaced with probability `share` by one from `anywhere`: free positions, headings all "
            "around. What you remember from call to call is the `memory` of `Step(posterior, memory)`.",
            "With `log_weights, log_sum = normalise(log_likelihood(...) - np.log(N))`, per beam: `w_slow, w_fast, "
            "share = averages(np.exp(log_sum / len(observation)), w_slow, w_fast, 0.05, 0.5)`; `strewn = "
            "np.flatnonzero(rng.random(n) < share)`; `offspring[strewn] = anywhere(len(strewn), constants, rng)`, or "
            "better so many of 5000 such candidates, resampled by how they explain the scan. The memory is "
            "`(offspring, w_slow, w_fast)`, with None, None on the first call.",
        ),
    ),
    Exercise(
        "kld",
        "As many particles as the cloud needs",
        cloud_checks.kld,
        kld_size,
        (
            "A histogram of k bins has k - 1 numbers to find out; a χ² quantile of that many degrees of freedom says "
            "how many draws it takes.",
            r"Fox: $n = \frac{k - 1}{2 \varepsilon} \left(1 - \frac{2}{9 (k - 1)} + \sqrt{\frac{2}{9 (k - 1)}}\, "
            r"z\right)^3$ with the normal quantile $z$, and one draw for one bin.",
            "`if occupied_bins <= 1: return 1`; `part = 2 / (9 * (occupied_bins - 1))`; return "
            "`math.ceil((occupied_bins - 1) / (2 * epsilon) * (1 - part + math.sqrt(part) * z) ** 3)`.",
        ),
    ),
    Exercise(
        "mode",
        "Where the filter would go",
        pose_checks.mode,
        modal_pose,
        (
            "The mean of two clusters is between them, where nothing is. Which particle has most weight about it?",
            "About it: within 0.3 m, and within 0.5 rad, of which the difference is wrapped. The answer is the mean "
            "pose of that particle's neighbours, by their weights.",
            "`near = (np.hypot(x[:, None] - x, y[:, None] - y) < 0.3) & (np.abs(wrap(heading[:, None] - heading)) < "
            "0.5)`; `members = near[np.argmax(near @ weights)]`; return `mean_pose(states[members], weights[members] / "
            "weights[members].sum())`.",
        ),
    ),
)
