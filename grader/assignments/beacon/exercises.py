"""The exercises of the beacon notebook, from Pythagoras to two filters and a planner.

Letters are the source's; metres, seconds, radians, newtons; `constants` is `course_lib.beacon.constants.Constants`, and
columns of states and observations are named there. A reading that is missing is `inf`. Beacons are 0 to 3, the source's
1 to 4, in the corners (+, +), (-, +), (-, -), (+, -) at half height.

horizontal-range
    horizontal_range(rho, a, h) -> ρ_xy
        Any shape. Where noise makes ρ shorter than the way up to the beacon: 0 (`inf`, for missing, passes too).
corner-position
    corner_position(beacon, rho, alpha, a, theta, constants) -> (..., 3)
        Numbers give (3,), arrays (N,) give (N, 3): x, y and z of the vehicle by one beacon.
obstacle-point
    obstacle_point(state, r, beta) -> (3,)
        state (12,).
predict
    predict(mean, covariance, u, constants) -> mean, covariance
        (12,), (12, 12), u (4,); f and its Jacobians are those of `course_lib.beacon.quadrotor`.
observation-jacobian
    observation_jacobian(state, constants) -> (9, 12)
        Of ρ₁...ρ₄, α₁...α₄, a at state (12,).
innovation
    innovation(observation, state, constants) -> (9,)
        observation (11,), of which the first nine count. Observed minus expected at state (12,), bearings wrapped, NaN
        where a reading is missing.
update
    update(mean, covariance, v, H, R) -> mean, covariance
        v (m,), H (m, 12), R (m, m) of the readings that are there, with m ≥ 1 and no NaN. Angles of the mean wrapped,
        covariance symmetric.
estimator
    Estimator(previous, observation, control, constants, rng) -> Gaussian
        As handed in for beacon-ekf.
log-likelihood
    log_likelihood(observation, states, constants) -> (N,)
        states (N, 12); natural logarithm of the density with its constant; 0 when nothing is there.
regularise
    regularise(states, log_weights, rng) -> states (N, 12)
        log_weights (N,), normalised. Resampled, shrunk and shaken, of equal weight; angles wrapped.
particle-estimator
    ParticleEstimator(previous, observation, control, constants, rng) -> Particles, array (N, 12) or Step of these
        As handed in for beacon-pf.
safe-march
    safe_march(state, thrusts, duration, scene) -> bool
        True when the vehicle, a ball of `scene.radius`, touches nothing within 0 ≤ t ≤ duration. Distances are those of
        `course_lib.beacon.planning.obstacles.distances`.
planner
    Planner(previous, belief, state, constants, rng) -> thrusts (4,) or Step of them
        As handed in for beacon-rrt; `constants` is a `course_lib.beacon.planning.obstacles.Scene`.
"""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.constants import ANGLES, RATES, VELOCITY, YAW
from course_lib.beacon.planning.obstacles import distances
from course_lib.filters import Particles, covariance, mean, systematic
from grader.assignments.beacon import (
    geometry_checks,
    kalman_checks,
    particle_checks,
    planning_checks,
    reading_checks,
    run_checks,
)
from grader.check import Exercise

#: What is left between vehicle and obstacle when a march gives up, in metres.
NEAR = 0.002


def horizontal_range(rho, a, h):
    """Horizontal distance to a beacon at half height; 0 where ρ is too short for it."""
    return np.sqrt(np.maximum(np.square(rho) - np.square(h / 2 - a), 0.0))


def corner_position(beacon, rho, alpha, a, theta, constants):
    """The vehicle's position by one beacon."""
    ground = horizontal_range(rho, a, constants.h)
    x, y, _ = constants.beacons[beacon]
    return np.stack(
        np.broadcast_arrays(x - ground * np.cos(theta + alpha), y - ground * np.sin(theta + alpha), a), axis=-1
    )


def obstacle_point(state, r, beta):
    """What the obstacle sensor sees, in the world frame."""
    direction = state[YAW] + beta
    return state[:3] + r * np.array([np.cos(direction), np.sin(direction), 0.0])


def predict(mean, covariance, u, constants):
    """P' = F_x P F_xᵀ + F_u Σ_u F_uᵀ and the gusts."""
    F_x, F_u = quadrotor.jacobians(mean, u, constants.Ts, constants)
    mean = quadrotor.f(mean, u, constants.Ts, constants)
    mean[list(ANGLES)] = wrap(mean[list(ANGLES)])
    gusts = np.zeros(12)
    gusts[VELOCITY], gusts[RATES] = constants.sigma_v**2 * constants.Ts, constants.sigma_w**2 * constants.Ts
    Sigma_u = np.diag(constants.k * np.abs(u))
    return mean, F_x @ covariance @ F_x.T + F_u @ Sigma_u @ F_u.T + np.diag(gusts)


def innovation(observation, state, constants):
    """Observed minus expected."""
    return models.innovation(observation, models.observe(state[None], constants)[0])


def update(mean, covariance, v, H, R):
    """Joseph's form, made symmetric."""
    S = H @ covariance @ H.T + R
    K = np.linalg.solve(S, H @ covariance).T
    mean = mean + K @ v
    mean[list(ANGLES)] = wrap(mean[list(ANGLES)])
    A = np.eye(12) - K @ H
    covariance = A @ covariance @ A.T + K @ R @ K.T
    return mean, 0.5 * (covariance + covariance.T)


def regularise(states, log_weights, rng):
    """x = m + √(1 - h²) (xⁱ - m) + h L ε of resampled xⁱ."""
    n, d = states.shape
    particles = Particles(states, log_weights)
    m, P = mean(particles, ANGLES), covariance(particles, ANGLES)
    L = np.linalg.cholesky(P + 1e-12 * np.eye(d))
    h = (4 / (n * (d + 2))) ** (1 / (d + 4))
    apart = states[systematic(particles.weights, rng)] - m
    apart[:, ANGLES] = wrap(apart[:, ANGLES])
    result = m + np.sqrt(1 - h**2) * apart + h * rng.standard_normal((n, d)) @ L.T
    result[:, ANGLES] = wrap(result[:, ANGLES])
    return result


def safe_march(state, thrusts, duration, scene):
    """Conservative advancement in time."""
    # |v| grows by no more than thrust and weight together; drag only slows.
    fastest = np.linalg.norm(state[VELOCITY]) + (np.sum(thrusts) / scene.mass + scene.g) * duration
    t = 0.0
    while t <= duration:
        place = quadrotor.f(state, thrusts, t, scene)[:3]
        free = distances(place[None], scene)[0] - scene.radius
        if free < NEAR:
            return False
        t += free / fastest
    return True


EXERCISES = (
    Exercise(
        "horizontal-range",
        "Project the range into the plane",
        geometry_checks.horizontal_range,
        horizontal_range,
        (
            "Draw the vertical triangle: the vehicle, the beacon, and the point below or above it at your own height.",
            r"$\rho_{xy} = \sqrt{\rho^2 - (h/2 - a)^2}$. The range is noisy: what if $\rho < |h/2 - a|$?",
            "`np.sqrt(np.maximum(rho**2 - (h / 2 - a) ** 2, 0.0))`.",
        ),
    ),
    Exercise(
        "corner-position",
        "Where am I, by one beacon?",
        geometry_checks.corner_position,
        corner_position,
        (
            r"Seen from the vehicle the beacon lies $\rho_{xy}$ away in the direction $\theta + \alpha$. And the "
            "vehicle, seen from the beacon?",
            r"$x = \pm R/2 - \rho_{xy} \cos(\theta + \alpha)$, $y = \pm R/2 - \rho_{xy} \sin(\theta + \alpha)$, $z = "
            r"a$, with the signs of the corner and this beacon's own $\rho_{xy}$: the source writes $\rho_{xy,1}$ for "
            "beacon 2.",
            "`x, y, _ = constants.beacons[beacon]`; `ground = horizontal_range(rho, a, constants.h)`; then "
            "`np.stack([x - ground * np.cos(theta + alpha), y - ground * np.sin(theta + alpha), a + 0 * ground], "
            "axis=-1)`, which does for numbers and arrays.",
        ),
    ),
    Exercise(
        "obstacle-point",
        "Where is the obstacle?",
        geometry_checks.obstacle_point,
        obstacle_point,
        (
            "This is the last exercise turned around: now your own place is known, and you look for the other end.",
            r"$x = x_r + r \cos(\theta + \beta)$, $y = y_r + r \sin(\theta + \beta)$, $z = z_r$.",
            "`state[:3] + r * np.array([np.cos(state[YAW] + beta), np.sin(state[YAW] + beta), 0.0])`.",
        ),
    ),
    Exercise(
        "predict",
        "Predict mean and covariance",
        kalman_checks.predict,
        predict,
        (
            "The mean goes through $f$, the covariance through its linearisation, and noise comes in twice: through "
            "the rotors and by the wind.",
            r"$P' = F_x P F_x^T + F_u \Sigma_u F_u^T + \mathrm{diag}(\ldots)$ with $\Sigma_u = \mathrm{diag}(k "
            r"|u_i|)$, a variance; gusts add $\sigma_v^2 T_s$ to each velocity's variance and $\sigma_w^2 T_s$ to "
            "each body rate's. The Jacobians belong at the old mean.",
            "`F_x, F_u = quadrotor.jacobians(mean, u, constants.Ts, constants)`; `Sigma_u = np.diag(constants.k * "
            "np.abs(u))`; `gusts = np.zeros(12)`, `gusts[VELOCITY] = constants.sigma_v**2 * constants.Ts`, likewise "
            "`gusts[RATES]`; return `quadrotor.f(mean, u, constants.Ts, constants)` and `F_x @ covariance @ F_x.T + "
            "F_u @ Sigma_u @ F_u.T + np.diag(gusts)`.",
        ),
    ),
    Exercise(
        "observation-jacobian",
        "The Jacobian of the readings",
        reading_checks.observation_jacobian,
        models.observation_jacobian,
        (
            "Nine rows, twelve columns, most of them zero. Which columns does a range depend on, and which a bearing?",
            r"With $(\Delta_x, \Delta_y, \Delta_z) = b_i - p$: $\partial\rho/\partial p = -(\Delta_x, \Delta_y, "
            r"\Delta_z)/\rho$ and $\partial\alpha/\partial(x, y) = (\Delta_y, -\Delta_x)/\rho_{xy}^2$. And the bearing "
            "counts from the heading, so there is a column that the source forgot.",
            "`offset = constants.beacons - state[:3]`; `H[:4, :3] = -offset / rho[:, None]` with `rho = "
            "np.linalg.norm(offset, axis=1)`; `square = offset[:, 0]**2 + offset[:, 1]**2`; `H[4:8, 0] = offset[:, 1] "
            "/ square`; `H[4:8, 1] = -offset[:, 0] / square`; `H[4:8, YAW] = -1.0`; `H[8, 2] = 1.0`.",
        ),
    ),
    Exercise(
        "innovation",
        "The innovation",
        reading_checks.innovation,
        innovation,
        (
            "Observed minus expected, reading by reading. Two directions 2° apart may be 358° apart as numbers.",
            r"Expected are $\|b_i - p\|$, $\mathrm{atan2}(b_{i,y} - y, b_{i,x} - x) - \theta$ and $z$. `wrap` the "
            "differences of the bearings, and only these; what is `inf` becomes NaN before you subtract.",
            "`z = np.where(np.isfinite(observation[:9]), observation[:9], np.nan)`; `v = z - np.concatenate([rho, "
            "alpha, [state[2]]])`; `v[4:8] = wrap(v[4:8])`, with `offset = constants.beacons - state[:3]`, `rho = "
            "np.linalg.norm(offset, axis=1)`, `alpha = np.arctan2(offset[:, 1], offset[:, 0]) - state[YAW]`.",
        ),
    ),
    Exercise(
        "update",
        "Gain and update",
        kalman_checks.update,
        update,
        (
            "How sure is the innovation, given $P'$ and $R$? The gain divides what state and innovation share by that.",
            r"$S = H P' H^T + R$, $K = P' H^T S^{-1}$, $\hat x = \hat x' + K v$, and Joseph's form $P = (I - K H) P' "
            "(I - K H)^T + K R K^T$, which stays a covariance when $(I - K H) P'$ is rounded away.",
            "`K = np.linalg.solve(S, H @ covariance).T`; `mean = mean + K @ v`, then `wrap` its columns "
            "`list(ANGLES)`; `A = np.eye(12) - K @ H`; `P = A @ covariance @ A.T + K @ R @ K.T`; return `mean, 0.5 * "
            "(P + P.T)`.",
        ),
    ),
    Exercise(
        "estimator",
        "The extended Kalman filter",
        run_checks.estimator,
        "course_lib.beacon.reference:Estimator",
        (
            "You have all the pieces. On the first call `previous` is None: return the prior that `constants` "
            "describes.",
            "Predict with `control`; take innovation and Jacobian at the predicted mean; leave out the rows of what is "
            r"missing; update with $R = \mathrm{diag}(\sigma^2)$ of the rows that are left, with the predicted $P'$.",
            "First: mean with `constants.start` in columns x, y, z and θ, covariance "
            "`np.diag(np.repeat(constants.start_sigma, [3, 2, 1, 3, 3])**2)`. Then: `mean, P = predict(*previous, "
            "control, constants)`; `v = innovation(observation, mean, constants)`; `there = np.isfinite(v)`; `H = "
            "observation_jacobian(mean, constants)[there]`; `R = np.diag(constants.sigma_z[there]**2)`; return "
            "`Gaussian(*update(mean, P, v[there], H, R))`.",
        ),
    ),
    Exercise(
        "log-likelihood",
        "The likelihood of the readings",
        particle_checks.log_likelihood,
        models.log_likelihood,
        (
            "Given the state the readings are independent: a normal density for each, of which the logarithms add. "
            "Their covariance is $R$ alone; the prior's uncertainty is already in the cloud.",
            r"$\sum_i -\frac{1}{2} (v_i/\sigma_i)^2 - \log \sigma_i - \frac{1}{2} \log 2\pi$ over the readings that "
            "are there: with the half that the source lacks, and numbers in the exponent where it has metres.",
            "As in `innovation`, for all particles at once: `offset = constants.beacons - states[:, None, :3]` is (N, "
            "4, 3). With `there = np.isfinite(observation[:9])`, `v` (N, 9) and `sigma = constants.sigma_z[there]`: "
            "`e = v[:, there] / sigma`; return `-0.5 * (e**2).sum(axis=1) - np.log(sigma).sum() - 0.5 * there.sum() * "
            "np.log(2 * np.pi)`.",
        ),
    ),
    Exercise(
        "regularise",
        "Resample with a memory of the correlations",
        particle_checks.regularise,
        regularise,
        (
            "Copies must part, but not in any direction: tilt, velocity and position hang together, and the cloud "
            "knows how. And jitter adds variance: what takes it away again?",
            r"$x = m + \sqrt{1 - h^2}\,(x^i - m) + h L \varepsilon$ with the weighted mean $m$ and covariance $L L^T$ "
            r"of the cloud *before* resampling, $\varepsilon$ standard normal, $h = (4 / (N (d + 2)))^{1/(d + 4)}$. "
            "Angles: a mean direction, and wrapped differences.",
            "`m, P = mean(particles, ANGLES), covariance(particles, ANGLES)` of `course_lib.filters` with `particles "
            "= Particles(states, log_weights)`; `L = np.linalg.cholesky(P + 1e-12 * np.eye(12))`; `apart = "
            "states[systematic(np.exp(log_weights), rng)] - m`, its columns `ANGLES` wrapped; `x = m + np.sqrt(1 - "
            "h**2) * apart + h * rng.standard_normal((N, 12)) @ L.T`, wrapped again.",
        ),
    ),
    Exercise(
        "particle-estimator",
        "The particle filter",
        run_checks.particle_estimator,
        "course_lib.beacon.reference:ParticleEstimator",
        (
            "Draw the prior on the first call. On every other: move, weigh, and when few particles have all the "
            "weight, `regularise`.",
            r"Each particle has thrusts of its own, $u_i + \sqrt{k |u_i|}\,\varepsilon$, goes through `quadrotor.f`, "
            r"and gets gusts of its own, $\sigma_v \sqrt{T_s}\,\varepsilon$ on its velocity and $\sigma_w "
            r"\sqrt{T_s}\,\varepsilon$ on its rates. Weights multiply from step to step until you resample, which is "
            r"due when $1/\sum w_i^2 < N/2$.",
            "`particles = previous`; if `effective_sample_size(particles) < 0.5 * N`: `particles = "
            "equally_weighted(regularise(*particles, rng))`. Then move the states, and `logw = particles.log_weights "
            "+ log_likelihood(observation, states, constants)`; return `Particles(states, normalise(logw)[0])`. N = "
            "5000 is enough, 1000 is not.",
        ),
    ),
    Exercise(
        "safe-march",
        "A collision check that misses nothing",
        planning_checks.safe_march,
        safe_march,
        (
            "The distance to the closest obstacle says how far you can fly in *any* direction without touching it. "
            "How long does that take at least?",
            "With $d$ free around the vehicle (its radius is not free) and a speed that never exceeds $v_{max}$, "
            r"nothing is touched for $\Delta t = d / v_{max}$. Over an edge $v_{max} = |v| + (\sum u / m + g)\,\Delta "
            "t_n$ is safe: thrust and weight at most add up. The source takes chord and mean speed instead.",
            "`t = 0.0`; while `t <= duration`: `free = distances(quadrotor.f(state, thrusts, t, scene)[None, :3], "
            "scene)[0] - scene.radius`; if `free < 0.002` return False; `t += free / fastest`. After the loop return "
            "True.",
        ),
    ),
    Exercise(
        "planner",
        "Plan, and fly the plan in gusts",
        planning_checks.planner,
        "course_lib.beacon.planning.pilot:Planner",
        (
            "Two tasks: find a way on the first call, and on every call see to it that the vehicle keeps to it. Which "
            "of them do you have already?",
            "Grow the tree by flights of the controller `quadrotor.fly_to` towards sampled points, now and then the "
            "goal, instead of random thrusts, checking each with `safe_march` and a larger radius: gusts will push. "
            "The route is a list of targets; keep it in `Step(action, memory)`.",
            "On each call: if the vehicle is within half a metre of the next target of the route, go on to the one "
            "after it; return `Step(quadrotor.fly_to(state, [*target, 0.0], constants), (route, next))`. That is "
            "feedback on the state, so gusts are corrected. Short legs keep the flight close to the way that was "
            "checked.",
        ),
    ),
)
