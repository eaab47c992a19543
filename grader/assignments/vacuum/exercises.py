"""The exercises of the vacuum notebook, from one line to the whole filter.

Each is one equation of the derivation as a NumPy function; N robots or particles at once, no loop over them. Metres,
seconds, radians; headings counter-clockwise from the x axis; `constants` is `course_lib.vacuum.constants.Constants`.

bounce-noise
    bounce_noise(p, v_bar) -> v
        p, v any shape: the inverse of F(v) for f(v) = c v² on [-v_bar, v_bar].
bounce
    bounce(heading, normal, noise) -> heading
        heading (N,) of robots driving into a wall, normal (N,) or a number: the direction of the wall's inward normal
        (0 for x = 0, π/2 for y = 0, π for the wall opposite x = 0, -π/2 for the one opposite y = 0), noise (N,) in
        [-1, 1]. Result (N,), wrapped to [-π, π).
prior
    sample_prior(n, constants, rng) -> states (n, 6)
        Columns x_A, y_A, θ_A, x_B, y_B, θ_B. Headings in [-π, π].
drive
    drive(x, y, heading, distance, constants, rng) -> x, y, heading
        All (N,): straight on and round by round off the walls, until each robot has driven its distance; headings in
        [-π, π]. The arguments stay as they are.
likelihood
    log_likelihood(observation, states, constants) -> log-likelihoods (N,)
        observation (4,), inf where a sensor is silent; states (N, 6); -inf, without a warning, where a reading is
        impossible.
resample
    systematic(weights, rng) -> indices (N,) of integers
        weights (N,), normalised.
roughen
    roughen(states, K, constants, rng) -> states (N, 6)
        Normal jitter of standard deviation K Eᵢ N^(-1/6), Eᵢ the largest minus the smallest value in column i;
        positions are kept in the room, headings wrapped to [-π, π).
estimator
    Estimator(previous, observation, control, constants, rng) -> posterior
        As handed in: Particles(states, log_weights) or an array (N, 6) of equally weighted particles.
"""

import numpy as np

from course_lib.angles import wrap
from course_lib.filters import resampling
from course_lib.vacuum import models
from grader.assignments.vacuum import filter_checks, motion_checks
from grader.check import Exercise


def bounce(heading, normal, noise):
    """Heading after a bounce, from the heading before it, the wall's inward normal and the noise."""
    # ψ = θ⁻ - φ;  α⁻ = |ψ| - π/2;  α⁺ = α⁻ (1 + v);  θ⁺ = φ + sgn(ψ) (π/2 - α⁺)
    off_normal = wrap(heading - normal)
    before = np.abs(off_normal) - np.pi / 2
    after = before * (1 + noise)
    return wrap(normal + np.where(off_normal < 0, -1, 1) * (np.pi / 2 - after))


def drive(x, y, heading, distance, constants, rng):
    """Robots after they drove their distance, bouncing off walls as often as it takes."""
    position, heading, left = np.column_stack([x, y]), np.array(heading), np.array(distance)
    moving = np.arange(len(heading))
    while moving.size:
        direction = np.column_stack([np.cos(heading[moving]), np.sin(heading[moving])])
        # cos(π/2) is 6e-17: a robot that drives along a wall must not bounce off it for ever.
        direction[np.abs(direction) < 1e-15] = 0.0
        wall = np.where(direction > 0, constants.room, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_wall = np.where(direction == 0, np.inf, (wall - position[moving]) / direction)
        axis = np.argmin(to_wall, axis=1)
        nearest = to_wall.min(axis=1)
        way = np.minimum(left[moving], nearest)
        position[moving] = np.clip(position[moving] + way[:, None] * direction, 0.0, constants.room)
        bouncing = nearest < left[moving]
        left[moving] -= way
        moving, axis, direction = moving[bouncing], axis[bouncing], direction[bouncing]
        rows = np.arange(moving.size)
        # The inward normal is 0 or π at the walls across x, ±π/2 at those across y.
        normal = np.where(direction[rows, axis] > 0, np.pi, 0.0) + np.where(axis == 1, np.pi / 2, 0.0)
        position[moving, axis] = wall[bouncing][rows, axis]
        heading[moving] = bounce(heading[moving], normal, models.bounce_noise(rng.random(moving.size), constants.v_bar))
    return position[:, 0], position[:, 1], heading


def roughen(states, K, constants, rng):
    """Particles with jitter of standard deviation K E N^(-1/6), kept in the room."""
    n, d = states.shape
    deviation = K * np.ptp(states, axis=0) * n ** (-1 / d)
    states = states + deviation * rng.standard_normal((n, d))
    for column in (0, 3):
        states[:, column : column + 2] = np.clip(states[:, column : column + 2], 0.0, constants.room)
        states[:, column + 2] = wrap(states[:, column + 2])
    return states


EXERCISES = (
    Exercise(
        "bounce-noise",
        "Draw the bounce noise",
        motion_checks.bounce_noise,
        models.bounce_noise,
        (
            r"Integrate $f(v) = c v^2$ from $-\bar v$ to $v$ to get $F(v)$, then solve $F(v) = p$ for $v$.",
            r"$F(v) = (v^3 + \bar v^3) / (2 \bar v^3)$. It is 0 at $-\bar v$, 1/2 at 0 and 1 at $\bar v$. "
            "NumPy's `**` does not take negative numbers to the power 1/3; `np.cbrt` does.",
            r"$v = \bar v \, (2p - 1)^{1/3}$, the root taken of all of $2p - 1$: `v_bar * np.cbrt(...)`.",
        ),
    ),
    Exercise(
        "bounce",
        "Bounce off any of the four walls",
        motion_checks.bounce,
        bounce,
        (
            "Turn the room so that every wall is the same wall: look at the heading relative to the wall's normal.",
            r"With $\psi$ = heading - normal, wrapped, a robot that drives into the wall has $|\psi| > "
            r"\pi/2$, and its angle to the wall is $\alpha^- = |\psi| - \pi/2$. The sign of $\psi$ says from "
            r"which side it comes; it leaves to the other side, which has the same sign of $\psi$.",
            r"$\theta^+ = \varphi + \mathrm{sgn}(\psi)\,(\pi/2 - \alpha^-(1 + v))$: `wrap` it, and take `wrap` and "
            "`np.sign` from `course_lib.angles` and NumPy.",
        ),
    ),
    Exercise(
        "prior",
        "Draw the two robots at time 0",
        motion_checks.sample_prior,
        models.prior,
        (
            "Draw a corner for each particle and robot, then a heading that depends on the corner.",
            "`constants.sensors` is a (4, 2) array of the corners S1 to S4. `rng.integers(2, size=n)` draws a "
            "row for A; add 2 to a second such draw for B. Into the room lie a quarter of the circle: from "
            "which angle on, at each corner?",
            "The quarters begin at π/2, -π, -π/2 and 0 for S1 to S4. So `first = np.array([...])`, and with "
            "`corner` (n,): position `constants.sensors[corner]`, heading `first[corner] + rng.uniform(0, np.pi "
            "/ 2, n)`.",
        ),
    ),
    Exercise(
        "drive",
        "Drive with bounces as events within a step",
        motion_checks.drive,
        drive,
        (
            "A robot drives to the next wall or to the end of its distance, whichever comes first. What is left "
            "after a bounce is driven in the new direction, and may end at another wall.",
            "The way to the wall across x is (L_x - x) / cos θ when cos θ > 0 and -x / cos θ when cos θ < 0, "
            "likewise for y; the smaller one counts. Loop over rounds, not robots: in each round all robots "
            "that have distance left drive on, those at a wall bounce, the loop ends when no robot bounced.",
            "In each round: `way = np.minimum(left, to_wall)`; move all by `way`; `left = left - way`; `hit = "
            "to_wall < left_before`; for these, `heading[hit] = bounce(heading[hit], normal[hit], "
            "bounce_noise(rng.random(hit.sum()), constants.v_bar))`. Set the coordinate of a robot at a wall "
            "exactly to the wall, so that rounding leaves nobody behind it.",
        ),
    ),
    Exercise(
        "likelihood",
        "The likelihood of four readings",
        filter_checks.log_likelihood,
        models.log_likelihood,
        (
            "For one sensor, use the theorem of total probability over which robot it measured. Then: the "
            "sensors are independent, and a silent one says nothing.",
            r"$f(z_i \mid p) = (1 - \bar s)\, f_w(z_i - d_{right}) + \bar s\, f_w(z_i - d_{wrong})$ with $f_w(w) "
            r"= \max(1 - |w|/\bar w, 0) / \bar w$. S1 and S2 are tuned to A, S3 and S4 to B.",
            "Start with `total = np.zeros(len(states))`; for each sensor i with `np.isfinite(observation[i])`, "
            "compute both distances by `np.hypot`, the mixture, and add its `np.log` to `total`, within `with "
            'np.errstate(divide="ignore"):` since log 0 = -inf is meant.',
        ),
    ),
    Exercise(
        "resample",
        "Systematic resampling",
        filter_checks.systematic,
        resampling.systematic,
        (
            "Lay the weights end to end on [0, 1] and place N equally spaced marks on it: a particle has as "
            "many offspring as marks fall on its weight.",
            "One number u shifts all marks: (u + n) / N for n = 0 ... N - 1. `np.cumsum` gives the ends of the "
            "weights, `np.searchsorted` the weight each mark falls on.",
            "`ends = np.cumsum(weights)`; divide by `ends[-1]`, which rounding leaves beside 1; then "
            "`np.searchsorted(ends, (rng.random() + np.arange(N)) / N)`.",
        ),
    ),
    Exercise(
        "roughen",
        "Roughen after resampling",
        filter_checks.roughen,
        roughen,
        (
            "Add a normal number to each entry. Its deviation differs from column to column, not from row to row.",
            r"$\sigma_i = K E_i N^{-1/6}$: $E_i$ is what `np.ptp(states, axis=0)` gives, N the number of rows. "
            "Then see to the walls and to the headings.",
            "`states + sigma * rng.standard_normal(states.shape)`, a new array; then `np.clip` columns 0, 1 and "
            "3, 4 between 0 and `constants.room`, and `wrap` columns 2 and 5.",
        ),
    ),
    Exercise(
        "estimator",
        "The whole filter",
        filter_checks.estimator,
        "course_lib.vacuum.reference:Estimator",
        (
            "You have all the pieces. On the first call `previous` is None: return the prior. On every other: "
            "drive, weigh, resample, roughen.",
            "`control` holds the speeds of A and B; a robot drives speed times `constants.Ts`. Subtract the "
            "largest log-likelihood before you exponentiate and normalise. When all are -inf, no weight is left "
            "to normalise: decide what then (keep the prior, or draw positions all over the room).",
            "`states = previous.copy()`; drive columns 0 to 2 by `np.full(N, control[0] * constants.Ts)` and 3 "
            "to 5 with `control[1]`; `logw = log_likelihood(observation, states, constants)`; if `logw.max()` "
            "is -inf return the states; `w = np.exp(logw - logw.max())`; `states = states[systematic(w / "
            "w.sum(), rng)]`; return `roughen(states, 0.03, constants, rng)`. Roughen and resample only in "
            "steps in which a sensor reports: otherwise the weights are equal. N = 2000 is enough.",
        ),
    ),
)
