"""The checks of the beacon notebook: right answers of several kinds pass, every known wrong one is told what it did.

Whoever draws has a fixed seed here; a check's own chance to fail a right answer is stated where its limits are.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.constants import ANGLES, BEARINGS, MEASURED, RATES, VELOCITY, YAW, Constants
from course_lib.beacon.planning import collisions, problem
from course_lib.beacon.planning.obstacles import distances
from course_lib.filters import (
    Gaussian,
    Particles,
    Step,
    bootstrap,
    covariance,
    effective_sample_size,
    equally_weighted,
    extended_kalman,
    mean,
    multinomial,
    normalise,
    regularized,
    systematic,
)
from grader.assignments.beacon import exercises as course
from grader.assignments.beacon import run_checks
from grader.assignments.beacon.exercises import EXERCISES
from grader.check import judge

WHOLE = ("estimator", "particle-estimator", "planner")
BY_NAME = {exercise.name: exercise for exercise in EXERCISES}
SAMPLES = Path(__file__).parents[3] / "submissions" / "beacon-ekf"
A = list(ANGLES)


@pytest.mark.parametrize("exercise", EXERCISES, ids=lambda exercise: exercise.name)
def test_the_courses_own_version_passes(exercise):
    state, message, printed = judge(exercise, exercise.course_version())
    assert (state, printed) == ("passed", ""), message
    assert bool(message) == (exercise.name in (*WHOLE, "safe-march"))


@pytest.mark.parametrize("exercise", EXERCISES, ids=lambda exercise: exercise.name)
def test_a_stub_is_not_attempted_and_a_crash_is_an_exception(exercise):
    def stub(*arguments):
        raise NotImplementedError()

    def crash(*arguments):
        return [][0]

    assert judge(exercise, stub)[0] == "not attempted"
    state, message, _ = judge(exercise, crash)
    assert state == "exception"
    assert message.startswith("IndexError: list index out of range\nin crash, line ")
    assert len(exercise.hints) == 3 and all(exercise.hints)


@pytest.mark.parametrize("exercise", EXERCISES, ids=lambda exercise: exercise.name)
@pytest.mark.parametrize("value", [None, "text", 1.0, np.array([None]), np.full((3, 3), np.nan), [[1], [1, 2]], (1, 2)])
def test_nonsense_fails_in_words(exercise, value):
    state, message, _ = judge(exercise, lambda *arguments: value)
    assert state == "failed"
    assert "cannot be read" not in message


# Answers that are right, each in another way.


def _range_by_cosine(rho, a, h):
    with np.errstate(all="ignore"):
        return np.nan_to_num(rho * np.cos(np.arcsin((h / 2 - a) / rho)))


def _range_where(rho, a, h):
    with np.errstate(invalid="ignore"):
        square = np.asarray(rho**2 - (h / 2 - a) ** 2)
        return np.where(square > 0, np.sqrt(square), 0.0)


def _range_missing(rho, a, h):
    square = np.asarray(rho**2 - (h / 2 - a) ** 2)
    return np.sqrt(np.where(square > 0, square, np.inf))


def _corner_missing(beacon, rho, alpha, a, theta, constants):
    ground = np.asarray(_range_missing(rho, a, constants.h))
    result = course.corner_position(beacon, rho, alpha, a, theta, constants)
    return np.where(np.isinf(ground)[..., None], np.inf, result)


def _numeric_jacobian(state, constants):
    H = np.empty((MEASURED, 12))
    for i in range(12):
        step = np.zeros(12)
        step[i] = 1e-6
        ahead, behind = (models.observe((state + s)[None], constants)[0] for s in (step, -step))
        H[:, i] = models.innovation(ahead, behind) / 2e-6
    return H


def _atan_innovation(observation, state, constants):
    v = course.innovation(observation, state, constants)
    with np.errstate(invalid="ignore"):
        v[BEARINGS] = np.arctan2(np.sin(v[BEARINGS]), np.cos(v[BEARINGS]))
    return v


def _update_by_cholesky(mean, P, v, H, R):
    K = cho_solve(cho_factor(H @ P @ H.T + R), H @ P).T
    A_ = np.eye(12) - K @ H
    mean = mean + K @ v
    mean[A] = wrap(mean[A])
    return Gaussian(mean, A_ @ P @ A_.T + K @ R @ K.T)


def _likelihood_in_a_loop(observation, states, constants):
    total = np.zeros(len(states))
    for n, state in enumerate(states):
        for v, sigma in zip(course.innovation(observation, state, constants), constants.sigma_z, strict=True):
            if np.isfinite(v):
                total[n] += np.log(np.exp(-0.5 * (v / sigma) ** 2 + 50)) - 50 - np.log(sigma * np.sqrt(2 * np.pi))
    return total


def _regularise_afterwards(states, log_weights, rng):
    # Multinomial, the covariance of the offspring, and an eigenvalues' root instead of Cholesky's.
    cloud = equally_weighted(states[multinomial(np.exp(log_weights), rng)])
    m, (variances, axes) = mean(cloud, ANGLES), np.linalg.eigh(covariance(cloud, ANGLES))
    n, d = states.shape
    h = regularized.bandwidth(n, d)
    apart = cloud.states - m
    apart[:, A] = wrap(apart[:, A])
    noise = (rng.standard_normal((n, d)) * np.sqrt(np.maximum(variances, 0.0))) @ axes.T
    x = m + np.sqrt(1 - h**2) * apart + h * noise
    x[:, A] = wrap(x[:, A])
    return x


def _march_finely(state, thrusts, duration, scene):
    way = [quadrotor.f(state, thrusts, t, scene)[:3] for t in np.linspace(0.0, duration, 200)]
    return distances(np.array(way), scene).min() > scene.radius


def _march_by_growing_speed(state, thrusts, duration, scene):
    return not collisions.march_by_speed(
        lambda t: quadrotor.f(state, thrusts, t, scene)[:3],
        duration,
        lambda place: distances(place[None], scene)[0],
        scene.radius,
        np.linalg.norm(state[VELOCITY]),
        thrusts.sum() / scene.mass + scene.g,
    )[0]


RIGHT = [
    ("horizontal-range", _range_by_cosine),
    ("horizontal-range", _range_where),
    ("horizontal-range", _range_missing),
    ("corner-position", _corner_missing),
    ("obstacle-point", lambda state, r, beta: list(course.obstacle_point(state, r, beta))),
    ("predict", lambda mean, P, u, c: Gaussian(quadrotor.f(mean, u, c.Ts, c), course.predict(mean, P, u, c)[1])),
    ("observation-jacobian", _numeric_jacobian),
    ("innovation", _atan_innovation),
    ("update", _update_by_cholesky),
    ("update", lambda mean, P, v, H, R: extended_kalman.update(Gaussian(mean, P), v, H, R, ANGLES)[0]),
    ("log-likelihood", _likelihood_in_a_loop),
    ("regularise", _regularise_afterwards),
    ("safe-march", _march_finely),
    ("safe-march", _march_by_growing_speed),
]


@pytest.mark.parametrize("name, right", RIGHT, ids=[f"{name}: {right.__name__}" for name, right in RIGHT])
def test_another_right_answer_passes(name, right):
    state, message, _ = judge(BY_NAME[name], right)
    assert state == "passed", message


def test_a_root_taken_of_negative_numbers_and_mended_afterwards_is_right_and_told_so():
    def mended(rho, a, h):
        return np.nan_to_num(np.sqrt(rho**2 - (h / 2 - a) ** 2))

    state, message, _ = judge(BY_NAME["horizontal-range"], mended)
    assert state == "passed" and "though it warns" in message


# Answers that are wrong.


def _range(rho, way_up, sign=-1):
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.maximum(rho**2 + sign * way_up**2, 0.0))


def _corner(angle=lambda theta, alpha: theta + alpha, sign=-1.0, corner=lambda beacon: beacon, scale=0.5, ground=None):
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])

    def corner_position(beacon, rho, alpha, a, theta, c):
        reach = (ground or course.horizontal_range)(rho, a, c.h)
        x, y = scale * c.R * signs[corner(beacon)]
        turn = angle(theta, alpha)
        return np.stack([x + sign * reach * np.cos(turn), y + sign * reach * np.sin(turn), a + 0 * reach], axis=-1)

    return corner_position


def _point(angle):
    return lambda state, r, beta: state[:3] + r * np.array([np.cos(angle(state, beta)), np.sin(angle(state, beta)), 0])


def _predicted(thrust=lambda k, u: k * np.abs(u), gusts=lambda sigma, Ts: sigma**2 * Ts, turned=False, moved=True):
    def predict(mean, P, u, c):
        F_x, F_u = quadrotor.jacobians(mean, u, c.Ts, c)
        F_x = F_x.T if turned else F_x
        noise = np.zeros(12)
        noise[VELOCITY], noise[RATES] = gusts(c.sigma_v, c.Ts), gusts(c.sigma_w, c.Ts)
        mean = quadrotor.f(mean, u, c.Ts, c) if moved else mean
        return mean, F_x @ P @ F_x.T + (F_u * thrust(c.k, u)) @ F_u.T + np.diag(noise)

    return predict


def _jacobian(change):
    def observation_jacobian(state, c):
        H = models.observation_jacobian(state, c)
        change(H, c.beacons - state[:3])
        return H

    return observation_jacobian


def _set(rows, columns, value):
    def change(H, offset):
        H[rows, columns] = value(H, offset) if callable(value) else value

    return change


def _near_corner(H, offset):
    H[:4, :2] = -np.abs(H[:4, :2])
    H[4:8, :2] = np.abs(H[4:8, :2]) * [1, -1]


def _residual(change):
    def innovation(observation, state, c):
        v = course.innovation(observation, state, c)
        return change(v, observation[:MEASURED], models.observe(state[None], c)[0], state)

    return innovation


def _theta_forgotten(v, z, predicted, state):
    v[BEARINGS] = wrap(z[BEARINGS] - predicted[BEARINGS] - state[YAW])
    return np.where(np.isfinite(z), v, np.nan)


def _unwrapped(v, z, predicted, state):
    return np.where(np.isfinite(z), z, np.nan) - predicted


def _updated(form="Joseph", gain=lambda P, H, R: P @ H.T @ np.linalg.inv(H @ P @ H.T + R), sign=1.0, turn=True):
    def update(mean, P, v, H, R):
        K = gain(P, H, R)
        A_ = np.eye(12) - K @ H
        forms = {
            "Joseph": A_ @ P @ A_.T + K @ R @ K.T,
            "short": A_ @ P,
            "short, averaged": 0.5 * (A_ @ P + P @ A_.T),
            "no noise": A_ @ P @ A_.T,
            "as it was": P,
            "right of it": P @ A_,
        }
        mean = mean + sign * K @ v
        mean[A] = wrap(mean[A]) if turn else mean[A]
        return mean, forms[form]

    return update


def _likelihood(half=0.5, power=2, wrapped=True, silent=True, constant=True, over=None):
    def log_likelihood(observation, states, c):
        there = np.isfinite(observation[:MEASURED]) if silent else np.ones(MEASURED, dtype=bool)
        predicted = models.observe(states, c)
        with np.errstate(invalid="ignore"):
            v = models.innovation(observation, predicted) if wrapped else observation[:MEASURED] - predicted
        v, sigma = v[:, there], c.sigma_z[there]
        if over:
            return -(v**2).sum(axis=1) / over(sigma)
        result = -half * (v**2 / sigma**power).sum(axis=1)
        return result - (np.log(sigma).sum() + 0.5 * len(sigma) * np.log(2 * np.pi) if constant else 0.0)

    return log_likelihood


def _shaken(
    shrink=lambda h: np.sqrt(1 - h**2),
    jitter=lambda h: h,
    kernel=lambda L, P: L,
    circle=True,
    weights=True,
    resampled=True,
    before=False,
    turn=True,
    width=1.0,
):
    def regularise(states, log_weights, rng):
        n, d = states.shape
        columns = A if circle else []
        particles = Particles(states, log_weights if weights else np.full(n, -np.log(n)))
        m, P = mean(particles, columns), covariance(particles, columns)
        L = kernel(np.linalg.cholesky(P + 1e-12 * np.eye(d)), P)
        h = width * (4 / (n * (d + 2))) ** (1 / (d + 4))
        noise = jitter(h) * rng.standard_normal((n, d)) @ L.T
        chosen = systematic(np.exp(log_weights), rng) if resampled else np.arange(n)
        apart = (states - m)[chosen]
        apart[:, columns] = wrap(apart[:, columns])
        x = m + shrink(h) * apart + (noise[chosen] if before else noise)
        if turn:
            x[:, A] = wrap(x[:, A])
        return x

    return regularise


def _no_cholesky(states, log_weights, rng):
    np.linalg.cholesky(covariance(Particles(states, log_weights), ANGLES))
    return course.regularise(states, log_weights, rng)


def _march(radius=None, speed=None, until=1.0):
    def safe_march(state, thrusts, duration, scene):
        grown = np.linalg.norm(state[VELOCITY]) + (thrusts.sum() / scene.mass + scene.g) * duration
        t = 0.0
        while t <= until * duration:
            x = quadrotor.f(state, thrusts, t, scene)
            free = distances(x[None, :3], scene)[0] - (scene.radius if radius is None else radius)
            if free < 0.002:
                return False
            t += free / (max(np.linalg.norm(x[VELOCITY]), 1e-9) if speed == "of now" else grown)
        return True

    return safe_march


def _chord(state, thrusts, duration, scene):
    return not collisions.march_by_chord(
        lambda t: quadrotor.f(state, thrusts, t, scene)[:3],
        duration,
        lambda place: distances(place[None], scene)[0],
        scene.radius,
    )[0]


def _sampled(count):
    def safe_march(state, thrusts, duration, scene):
        way = [quadrotor.f(state, thrusts, t, scene)[:3] for t in np.linspace(0.0, duration, count)]
        return bool(distances(np.array(way), scene).min() > scene.radius)

    return safe_march


WRONG = [
    ("horizontal-range", lambda rho, a, h: np.sqrt(rho**2 - (h / 2 - a) ** 2), "The root has no guard"),
    ("horizontal-range", lambda rho, a, h: _range(rho, a), "it is h/2 - a above you"),
    ("horizontal-range", lambda rho, a, h: _range(rho, h - a), "not at h"),
    ("horizontal-range", lambda rho, a, h: _range(rho, h / 2 - a, 1), "the longest side"),
    ("horizontal-range", lambda rho, a, h: np.sqrt(np.abs(rho**2 - (h / 2 - a) ** 2)), "not its absolute root"),
    ("horizontal-range", lambda rho, a, h: np.asarray(rho) + 0.0, "the range itself"),
    ("corner-position", _corner(ground=lambda rho, a, h: rho), "slant range"),
    ("corner-position", _corner(corner=lambda beacon: 0), "The sign of the corner: beacon 1 (the source's 2)"),
    ("corner-position", _corner(corner=lambda beacon: beacon - 1), "The sign of the corner: beacon 0"),
    ("corner-position", _corner(sign=1.0), "subtract"),
    ("corner-position", _corner(angle=lambda theta, alpha: alpha), "θ is missing"),
    ("corner-position", _corner(angle=lambda theta, alpha: theta - alpha), "sign of the bearing"),
    ("corner-position", _corner(angle=lambda theta, alpha: np.radians(theta + alpha)), "in radians already"),
    ("corner-position", _corner(scale=1.0), "±R/2"),
    ("corner-position", lambda *a: course.corner_position(*a[:-1], Constants()), "default room"),
    ("corner-position", lambda *a: course.corner_position(*a).T, "expected shape (40, 3), got (3, 40)"),
    ("obstacle-point", _point(lambda state, beta: beta), "heading θ is missing"),
    ("obstacle-point", _point(lambda state, beta: state[YAW] - beta), "sign of the bearing"),
    ("obstacle-point", _point(lambda state, beta: state[3] + beta), "This is the roll"),
    ("obstacle-point", lambda state, r, beta: course.obstacle_point(state, r, beta)[:2], "got (2,)"),
    ("predict", _predicted(gusts=lambda sigma, Ts: 0.0), "gusts are forgotten"),
    ("predict", _predicted(thrust=lambda k, u: (k * u) ** 2), "squared here, as if a standard deviation"),
    ("predict", _predicted(thrust=lambda k, u: np.sqrt(k * np.abs(u))), "its root, the standard deviation"),
    ("predict", _predicted(thrust=lambda k, u: 0 * u), "F_u Σ_u F_uᵀ is missing"),
    ("predict", _predicted(gusts=lambda sigma, Ts: sigma**2), "σ² T_s"),
    ("predict", _predicted(gusts=lambda sigma, Ts: sigma * Ts), "standard deviations"),
    ("predict", _predicted(turned=True), "transposed F_x comes last"),
    ("predict", _predicted(moved=False), "it moves by f"),
    ("predict", lambda mean, P, u, c: course.predict(mean, P, u, Constants()), "default constants"),
    ("predict", lambda mean, P, u, c: course.predict(mean, P, u, c)[0], "expected mean, covariance, got shape (12,)"),
    ("observation-jacobian", _jacobian(_set(range(4, 8), YAW, 0.0)), "θ column is missing"),
    ("observation-jacobian", _jacobian(_set(range(4, 8), YAW, 1.0)), "sign of ∂α/∂θ"),
    ("observation-jacobian", _jacobian(_near_corner), "those of beacon 1"),
    ("observation-jacobian", _jacobian(_set(slice(0, 4), 2, 0.0)), "∂ρ/∂z is missing"),
    (
        "observation-jacobian",
        _jacobian(_set(slice(0, 4), slice(0, 3), lambda H, offset: -H[:4, :3])),
        "towards the beacon ρ shrinks",
    ),
    (
        "observation-jacobian",
        _jacobian(_set(slice(4, 8), slice(0, 2), lambda H, offset: H[4:8, [1, 0]])),
        "are swapped",
    ),
    (
        "observation-jacobian",
        _jacobian(
            _set(slice(4, 8), slice(0, 2), lambda H, o: o[:, [1, 0]] * [1, -1] / (o**2).sum(axis=1)[:, None]),
        ),
        "ρ_xy² below",
    ),
    ("observation-jacobian", lambda state, c: models.observation_jacobian(state, c).T, "got (12, 9)"),
    ("innovation", _residual(_unwrapped), "not wrapped"),
    ("innovation", _residual(lambda v, *rest: -v), "observed minus predicted"),
    ("innovation", _residual(lambda v, *rest: wrap(v)), "Only bearings are angles"),
    ("innovation", _residual(_theta_forgotten), "θ is missing"),
    ("innovation", _residual(lambda v, *rest: np.nan_to_num(v)), "gives an innovation of 0"),
    ("innovation", _residual(lambda v, z, *rest: np.where(np.isinf(z), np.inf, v)), "gives an innovation of inf"),
    ("innovation", lambda z, state, c: np.append(course.innovation(z, state, c), [0.0, 0.0]), "obstacle's r and β"),
    ("update", _updated(form="short"), "take Joseph's form"),
    ("update", _updated(form="short, averaged"), "take Joseph's form"),
    ("update", _updated(form="no noise"), "K R Kᵀ is missing"),
    ("update", _updated(form="as it was"), "stays what it was"),
    ("update", _updated(form="right of it"), "not symmetric"),
    ("update", _updated(sign=-1.0), "observed minus expected"),
    ("update", _updated(gain=lambda P, H, R: P @ H.T @ np.linalg.inv(R)), "H P Hᵀ is missing"),
    ("update", _updated(gain=lambda P, H, R: P @ H.T @ np.linalg.pinv(H @ P @ H.T)), "R is missing"),
    ("update", _updated(gain=lambda P, H, R: P @ H.T @ np.linalg.inv(H @ P @ H.T + R**2)), "squared here"),
    ("update", _updated(turn=False), "not wrapped"),
    ("log-likelihood", _likelihood(half=1.0), "lacks the half"),
    ("log-likelihood", _likelihood(wrapped=False), "not wrapped"),
    ("log-likelihood", _likelihood(power=1), "divide by its square"),
    ("log-likelihood", _likelihood(power=4), "σ² is the variance"),
    ("log-likelihood", _likelihood(silent=False), "leave it out of the sum"),
    ("log-likelihood", _likelihood(constant=False), "Right but for the constant"),
    ("log-likelihood", _likelihood(over=lambda sigma: np.linalg.norm(sigma)), "the source's weight"),
    ("log-likelihood", lambda z, x, c: np.exp(models.log_likelihood(z, x, c)), "return its logarithm"),
    ("log-likelihood", lambda z, x, c: models.log_likelihood(z, x, Constants()), "default constants"),
    ("regularise", _shaken(shrink=lambda h: 1.0), "shrinkage is forgotten"),
    ("regularise", _shaken(kernel=lambda L, P: np.diag(np.sqrt(np.diag(P)))), "correlations are lost"),
    ("regularise", _shaken(kernel=lambda L, P: L.T), "L is transposed"),
    ("regularise", _shaken(kernel=lambda L, P: np.eye(12)), "L is missing"),
    ("regularise", _shaken(circle=False), "averaged as a number"),
    ("regularise", _shaken(before=True), "Copies stay copies"),
    ("regularise", _shaken(jitter=lambda h: 0.0), "Copies stay copies"),
    ("regularise", _shaken(jitter=lambda h: h**2), "h is squared"),
    ("regularise", _shaken(shrink=lambda h: 1 - h**2), "not 1 - h²"),
    ("regularise", _shaken(width=0.5), "The size of h"),
    ("regularise", _shaken(weights=False), "without its weights"),
    ("regularise", _shaken(resampled=False), "log_weights are not used"),
    ("regularise", _shaken(turn=False), "not wrapped"),
    ("regularise", _no_cholesky, "add 1e-12"),
    ("regularise", lambda x, w, rng: course.regularise(x, w, np.random.default_rng()), "draw from `rng`"),
    ("safe-march", _chord, "The march along the chord is fooled"),
    ("safe-march", _march(radius=0.0), "scene.radius"),
    ("safe-march", _march(radius=0.32), "The edge ends before the box"),
    ("safe-march", _march(speed="of now"), "it grows"),
    ("safe-march", _march(until=1.5), "no longer than `duration`"),
    ("safe-march", _sampled(2), "its middle is not"),
    ("safe-march", _sampled(6), "random edges that touch something are said to be safe"),
    ("safe-march", lambda *a: not course.safe_march(*a), "True means that the vehicle touches nothing"),
    ("safe-march", lambda *a: float(course.safe_march(*a)), "expected True or False, got float"),
]


@pytest.mark.parametrize("name, wrong, words", WRONG, ids=[f"{name}: {words}" for name, _, words in WRONG])
def test_a_wrong_answer_is_told_what_it_did(name, wrong, words):
    state, message, _ = judge(BY_NAME[name], wrong)
    assert state == "failed", message
    assert words in message
    assert len(message) < 700


# Whole filters and planners.


def _sample(name):
    namespace = {"__name__": "sample"}
    exec(compile((SAMPLES / f"{name}.py").read_text(), name, "exec"), namespace)
    return namespace["Estimator"]


@pytest.mark.parametrize("name", sorted(path.stem for path in SAMPLES.glob("good_*.py")))
def test_other_right_kalman_filters_pass(name):
    state, message, _ = judge(BY_NAME["estimator"], _sample(name))
    assert state == "passed", message
    assert "position error 0.0" in message and "(the reference's 0.0" in message


@pytest.mark.parametrize(
    "name, words",
    [
        ("bearing_unwrapped", "bearings' innovations are not wrapped"),
        ("yaw_left_out", "H has no θ column"),
        ("deviation_for_variance", "R holds standard deviations"),
        ("no_gusts", "The gusts are missing"),
        ("inputs_variance_squared", "it is squared here"),
        ("innovation_covariance_of_old_P", "it must take P'"),
        ("covariance_never_corrected", "take both results of `update`"),
        ("drops_incomplete_steps", "loses all the others"),
        ("missing_as_reading", "with some readings missing (inf)"),
        ("horizontal_ranges", "measured through space"),
        ("overconfident_R", "surer than it is right"),
        ("overcautious_Q", "less sure than it could be"),
        ("R_and_Q_swapped", "Do all the pieces above pass?"),
        ("hard_coded_sensors", "read all numbers from `constants`"),
        ("identity_prior", "The first call returns the prior"),
        ("gamed_inflated", "The first call returns the prior"),
        ("returns_none", "expected a Gaussian"),
    ],
)
def test_a_broken_kalman_filter_is_told_what_it_did(name, words):
    state, message, _ = judge(BY_NAME["estimator"], _sample(name))
    assert state == "failed", message
    assert words in message


def _particle_filter(log_likelihood=models.log_likelihood, resample=None, returned=lambda particles: particles):
    def estimator(previous, observation, control, constants, rng):
        if previous is None:
            cloud = equally_weighted(models.sample_prior(3000, constants, rng))
        else:
            cloud = (resample or (lambda cloud, rng: regularized.resample(cloud, rng, angles=ANGLES)))(
                previous.memory, rng
            )
            states = models.transition(cloud.states, control, constants, rng)
            weighed = cloud.log_weights + log_likelihood(observation, states, constants)
            cloud = Particles(states, normalise(weighed)[0])
        return Step(returned(cloud), cloud)

    return estimator


def _joined_kalman(previous, observation, control, constants, rng):
    """What the third hint says."""
    if previous is None:
        start = np.zeros(12)
        start[[0, 1, 2, YAW]] = constants.start
        return Gaussian(start, np.diag(np.repeat(constants.start_sigma, [3, 2, 1, 3, 3]) ** 2))
    mean, P = course.predict(*previous, control, constants)
    v = course.innovation(observation, mean, constants)
    there = np.isfinite(v)
    H = models.observation_jacobian(mean, constants)[there]
    return Gaussian(*course.update(mean, P, v[there], H, np.diag(constants.sigma_z[there] ** 2)))


def _joined_particles(previous, observation, control, constants, rng):
    """What the third hint says."""
    if previous is None:
        return equally_weighted(models.sample_prior(5000, constants, rng))
    particles = previous
    if effective_sample_size(particles) < 0.5 * len(particles.states):
        particles = equally_weighted(course.regularise(*particles, rng))
    states = models.transition(particles.states, control, constants, rng)
    log_weights = particles.log_weights + models.log_likelihood(observation, states, constants)
    return Particles(states, normalise(log_weights)[0])


@pytest.mark.parametrize("name, joined", [("estimator", _joined_kalman), ("particle-estimator", _joined_particles)])
def test_the_pieces_make_filters_that_pass(name, joined):
    state, message, _ = judge(BY_NAME[name], joined)
    assert state == "passed", message
    assert message.count("the reference's") == 2


@pytest.mark.parametrize(
    "estimator, words",
    [
        (_particle_filter(resample=bootstrap.resample), "the others are copies"),
        (_particle_filter(_likelihood(half=1.0)), "surer than it is right"),
        (_particle_filter(_likelihood(power=1)), "to pass here"),
        (_particle_filter(returned=lambda cloud: cloud.states[:, :3]), "expected states (N, 12), got shape (3000, 3)"),
        (
            _particle_filter(returned=lambda cloud: Particles(cloud.states, 0 * cloud.log_weights)),
            "the weights sum to 3000",
        ),
    ],
    ids=["bootstrap", "no half", "variance", "columns", "weights"],
)
def test_a_broken_particle_filter_is_told_what_it_did(monkeypatch, estimator, words):
    monkeypatch.setattr(run_checks, "_reference_figures", lambda *trial: ())
    state, message, _ = judge(BY_NAME["particle-estimator"], estimator)
    assert state == "failed", message
    assert words in message


def test_without_the_reference_the_figures_stand_alone(monkeypatch):
    monkeypatch.setattr(run_checks, "_reference_figures", lambda *trial: ())
    state, message, _ = judge(BY_NAME["estimator"], _sample("good_plain"))
    assert state == "passed" and "reference" not in message


def _by_waypoints(previous, belief, state, constants, rng):
    way = [constants.goal] if not constants.obstacles else [(-1.2, 2.6, 2.0), (1.2, 2.6, 2.0), constants.goal]
    at = 0 if previous is None else previous.memory
    if at < len(way) - 1 and np.linalg.norm(state[:3] - way[at]) < 0.5:
        at += 1
    return Step(quadrotor.fly_to(state, [*way[at], 0.0], constants), at)


def _straight(previous, belief, state, constants, rng):
    return quadrotor.fly_to(state, [*constants.goal, 0.0], constants)


def _open_loop(previous, belief, state, constants, rng):
    plan, step = (problem.plan(constants, state, rng), 0) if previous is None else previous.memory
    return Step(plan.thrusts[min(step, len(plan.thrusts) - 1)], (plan, step + 1))


def _crawling(previous, belief, state, constants, rng):
    ahead = np.array(constants.goal) - state[:3]
    return quadrotor.fly_to(state, [*(state[:3] + 0.5 * ahead / np.linalg.norm(ahead)), 0.0], constants)


def test_a_planner_that_knows_the_way_passes():
    state, message, _ = judge(BY_NAME["planner"], _by_waypoints)
    assert state == "passed", message
    assert message.count("the reference") == 2


@pytest.mark.parametrize(
    "planner, words",
    [
        (_straight, "runs into something.\nPlanner in a room with a wall that is open at one side: step "),
        (_open_loop, "In still air it arrives, in gusts it does not"),
        (_crawling, "more than 4 times as long"),
        (lambda previous, belief, state, constants, rng: quadrotor.hover(constants), "And nothing is in the way"),
        (lambda previous, belief, state, constants, rng: np.full(4, np.nan), "4 of 4 values are nan"),
        (lambda previous, belief, state, constants, rng: np.ones(3), "expected shape (4,), got (3,)"),
    ],
    ids=["straight", "open loop", "crawling", "hover", "nan", "shape"],
)
def test_a_broken_planner_is_told_what_it_did(planner, words):
    state, message, _ = judge(BY_NAME["planner"], planner)
    assert state == "failed", message
    assert words in message
