"""The checks of the vacuum notebook: the course's own answers pass, every known wrong one is told what it did."""

import numpy as np
import pytest

from course_lib.angles import wrap
from course_lib.filters import resampling
from course_lib.vacuum import models
from grader.assignments.vacuum import exercises as course
from grader.assignments.vacuum import filter_checks
from grader.assignments.vacuum.exercises import EXERCISES
from grader.check import judge

SMALL = [exercise for exercise in EXERCISES if exercise.name != "estimator"]
BY_NAME = {exercise.name: exercise for exercise in EXERCISES}


@pytest.mark.parametrize("exercise", SMALL, ids=lambda exercise: exercise.name)
def test_the_courses_own_version_passes(exercise):
    state, message, printed = judge(exercise, exercise.course_version())
    assert (state, message, printed) == ("passed", "", "")


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
@pytest.mark.parametrize("value", [None, "text", 1.0, np.array([None]), np.full((3, 3), np.nan), [[1], [1, 2]]])
def test_nonsense_fails_in_words(exercise, value):
    state, message, _ = judge(exercise, lambda *arguments: value)
    assert state == "failed"
    assert "cannot be read" not in message


def _noise(p, v_bar):
    return v_bar * np.cbrt(2 * p - 1)


def _off_normal(heading, normal):
    off = wrap(heading - normal)
    return np.sign(off), np.abs(off) - np.pi / 2


def _bounce_additive(heading, normal, noise):
    side, before = _off_normal(heading, normal)
    return wrap(normal + side * (np.pi / 2 - before) + noise)


def _bounce_about_the_normal(heading, normal, noise):
    side, before = _off_normal(heading, normal)
    return wrap(normal + side * (np.pi / 2 - before) * (1 + noise))


def _bounce_one_side(heading, normal, noise):
    _, before = _off_normal(heading, normal)
    return wrap(normal + np.pi / 2 - before * (1 + noise))


def _bounce_not_wrapped(heading, normal, noise):
    side, before = _off_normal(heading, normal)
    return normal + side * (np.pi / 2 - before * (1 + noise)) + 2 * np.pi


def _bounce_two_walls(heading, normal, noise):
    return course.bounce(heading, 0.0, noise)


def _prior(change):
    def prior(n, constants, rng):
        states = models.prior(n, constants, rng)
        change(states, constants, rng)
        return states

    return prior


def _same_corner(states, constants, rng):
    sensors = constants.sensors
    states[:, :2], states[:, 3:5] = sensors[0], sensors[2]


def _linked_corners(states, constants, rng):
    n = len(states)
    first = np.array([np.pi / 2, -np.pi, -np.pi / 2, 0.0])
    pick = rng.integers(2, size=n)
    for robot in (0, 1):
        states[:, 3 * robot : 3 * robot + 2] = constants.sensors[pick + 2 * robot]
        states[:, 3 * robot + 2] = first[pick + 2 * robot] + rng.uniform(0, np.pi / 2, n)


def _same_headings(states, constants, rng):
    quarter = np.pi / 2
    states[:, 5] = np.floor(states[:, 5] / quarter) * quarter + states[:, 2] % quarter


def _fixed_room(states, constants, rng):
    states[:, [0, 1, 3, 4]] = 5.0 * (states[:, [0, 1, 3, 4]] > 0)


def _any_heading(states, constants, rng):
    states[:, 2] = rng.uniform(-np.pi, np.pi, len(states))


def _diagonal(states, constants, rng):
    quarter = np.pi / 2
    states[:, 2] = np.floor(states[:, 2] / quarter) * quarter + quarter / 2


def _bounced_once(x, y, heading, distance, constants, rng, rest=True, noise=None, mirror=False):
    """A drive that allows for one bounce, with or without the rest of the way."""
    dx, dy = np.cos(heading), np.sin(heading)
    to_x = np.where(dx > 0, constants.room[0] - x, -x) / dx
    to_y = np.where(dy > 0, constants.room[1] - y, -y) / dy
    hit = np.minimum(to_x, to_y) < distance
    way = np.minimum(distance, np.minimum(to_x, to_y))
    normal = np.where(to_x < to_y, np.where(dx > 0, np.pi, 0.0), np.where(dy > 0, -np.pi / 2, np.pi / 2))
    drawn = models.bounce_noise(rng.random(len(x)), constants.v_bar)
    after = np.where(hit, course.bounce(heading, normal, drawn), heading)
    x, y = x + way * dx, y + way * dy
    if rest:
        x, y = x + (distance - way) * np.cos(after), y + (distance - way) * np.sin(after)
    return x, y, after


def _clamped(x, y, heading, distance, constants, rng):
    _, _, after = course.drive(x, y, heading, distance, constants, rng)
    far_x, far_y = x + distance * np.cos(heading), y + distance * np.sin(heading)
    return np.clip(far_x, 0, constants.room[0]), np.clip(far_y, 0, constants.room[1]), after


def _through_walls(x, y, heading, distance, constants, rng):
    return x + distance * np.cos(heading), y + distance * np.sin(heading), heading


def _old_heading(x, y, heading, distance, constants, rng):
    return *course.drive(x, y, heading, distance, constants, rng)[:2], heading


class _OtherNoise:
    """A generator whose `random` feeds the course's inverse with another law."""

    def __init__(self, rng, law):
        self.rng, self.law = rng, law

    def random(self, size):
        # models.bounce_noise takes the cube root, which the cube undoes.
        return (self.law(self.rng, size) ** 3 + 1) / 2


def _noisy(law):
    def drive(x, y, heading, distance, constants, rng):
        return course.drive(x, y, heading, distance, constants, _OtherNoise(rng, law))

    return drive


def _drive_in_place(x, y, heading, distance, constants, rng):
    x[:], y[:], heading[:] = course.drive(x, y, heading, distance, constants, rng)
    return x, y, heading


def _likelihood(
    each=lambda right, wrong, s: (1 - s) * right + s * wrong, tuned=(0, 0, 1, 1), order=(0, 1, 2, 3), silent=True
):
    def log_likelihood(observation, states, constants):
        total = np.zeros(len(states))
        for i in range(4):
            if silent and not np.isfinite(observation[i]):
                continue
            apart = [np.hypot(*(states[:, c : c + 2] - constants.sensors[order[i]]).T) for c in (0, 3)]
            right, wrong = (
                np.maximum(1 - np.abs(observation[i] - apart[robot]) / constants.w_bar, 0) / constants.w_bar
                for robot in (tuned[i], 1 - tuned[i])
            )
            with np.errstate(divide="ignore"):
                total += np.log(each(right, wrong, constants.s_bar))
        return total

    return log_likelihood


def _warns(observation, states, constants):
    with np.errstate(divide="warn"):
        np.log(np.zeros(1))
    return models.log_likelihood(observation, states, constants)


def _averaged(observation, states, constants):
    if not np.isfinite(observation).any():
        return np.zeros(len(states))
    alone = [
        models.log_likelihood(np.where(np.arange(4) == i, observation, np.inf), states, constants)
        for i in np.flatnonzero(np.isfinite(observation))
    ]
    with np.errstate(divide="ignore"):
        return np.log(np.exp(alone).mean(axis=0))


def _biased_residual(weights, rng):
    # Draws what whole copies leave by the weights, not by what the copies left of them.
    n = len(weights)
    copies = np.floor(n * weights).astype(int)
    ends = np.cumsum(weights / weights.sum())
    ends[-1] = 1.0
    drawn = np.searchsorted(ends, rng.random(n - copies.sum()))
    return np.concatenate([np.repeat(np.arange(n), copies), drawn])


def _no_division(weights, rng):
    return np.searchsorted(np.cumsum(weights), (np.arange(len(weights)) + rng.random()) / len(weights))


def _jitter(factor, shape=lambda n, d: (n, d), walls=True, angles=True):
    def roughen(states, K, constants, rng):
        n, d = states.shape
        sigma = factor(K, states, n, constants)
        states = states + sigma * rng.standard_normal(shape(n, d))
        for c in (0, 3):
            if walls:
                states[:, c : c + 2] = np.clip(states[:, c : c + 2], 0, constants.room)
            if angles:
                states[:, c + 2] = wrap(states[:, c + 2])
        return states

    return roughen


def _right(K, states, n, constants):
    return K * np.ptp(states, axis=0) * n ** (-1 / 6)


WRONG = [
    ("bounce-noise", lambda p, v: v * np.sign(2 * p - 1) * np.abs(2 * p - 1) ** 3, "This is the cube"),
    ("bounce-noise", lambda p, v: v * (2 * p - 1) ** (1 / 3), "use np.cbrt"),
    ("bounce-noise", lambda p, v: v * (2 * p - 1), "uniform noise"),
    ("bounce-noise", lambda p, v: np.cbrt(v * (2 * p - 1)), "in front of the cube root"),
    ("bounce-noise", lambda p, v: np.cbrt(2 * p - 1), "does not depend on v_bar"),
    ("bounce-noise", lambda p, v: v * np.cbrt(p), "never negative"),
    ("bounce-noise", lambda p, v: v * np.cbrt(1 - 2 * p), "sign is wrong"),
    ("bounce-noise", lambda p, v: _noise(p, v) if v else np.nan * p, "values are nan"),
    ("bounce-noise", lambda p, v: np.array([_noise(q, v) for q in p.ravel()]), "expected shape (2, 4), got (8,)"),
    ("bounce", lambda h, n, v: h, "drives on into the wall"),
    ("bounce", lambda h, n, v: wrap(h + np.pi), "turns back"),
    ("bounce", lambda h, n, v: course.bounce(h, n, 0 * v), "noise is not used"),
    ("bounce", lambda h, n, v: course.bounce(h, n, -v), "not α⁻ (1 - v)"),
    ("bounce", _bounce_additive, "noise is added"),
    ("bounce", _bounce_about_the_normal, "not the one to its normal"),
    ("bounce", _bounce_one_side, "from one side only"),
    ("bounce", _bounce_not_wrapped, "not wrapped"),
    ("bounce", _bounce_two_walls, "bounce off y = 0"),
    ("prior", lambda n, c, rng: models.prior(n, c, np.random.default_rng()), "draw from `rng`"),
    ("prior", _prior(_same_corner), "Not all four combinations"),
    ("prior", _prior(_linked_corners), "Not all four combinations"),
    ("prior", _prior(_same_headings), "depend on each other"),
    ("prior", _prior(_fixed_room), "6 m x 3 m"),
    ("prior", _prior(_any_heading), "drives out of the room"),
    ("prior", _prior(_diagonal), "not uniform"),
    (
        "prior",
        lambda n, c, rng: models.prior(n, c, rng)[:, [3, 4, 5, 0, 1, 2]],
        "robot A starts in the corner of S1 or S2",
    ),
    ("prior", lambda n, c, rng: models.prior(n, c, rng).T, "expected shape (4000, 6), got (6, 4000)"),
    ("drive", _clamped, "what is left to drive after a bounce is lost"),
    ("drive", lambda *a: _bounced_once(*a, rest=False), "stop at the wall"),
    ("drive", _bounced_once, "Right for one bounce"),
    ("drive", _through_walls, "through the walls"),
    ("drive", lambda x, y, h, *rest: course.drive(x, y, wrap(np.pi / 2 - h), *rest), "cos and sin are swapped"),
    ("drive", lambda x, y, h, *rest: (x, y, h), "do not move"),
    ("drive", _old_heading, "the heading after it is wrong"),
    ("drive", _noisy(lambda rng, n: rng.uniform(-1, 1, n)), "but uniform"),
    (
        "drive",
        _noisy(lambda rng, n: np.full(n, np.cbrt(rng.uniform(-1, 1)))),
        "all 4000 robots leave at the same angle",
    ),
    ("drive", _noisy(lambda rng, n: np.cbrt(rng.uniform(0, 1, n))), "not distributed as c v²"),
    ("drive", _drive_in_place, "changes its argument x"),
    ("likelihood", _likelihood(lambda right, wrong, s: right), "mixture is missing"),
    (
        "likelihood",
        _likelihood(lambda right, wrong, s: s * right + (1 - s) * wrong),
        "weights of the mixture are swapped",
    ),
    ("likelihood", _likelihood(lambda right, wrong, s: right + wrong), "probabilities 1 - s̄ and s̄"),
    ("likelihood", _likelihood(silent=False), "inf is treated as a reading"),
    ("likelihood", _likelihood(tuned=(0, 0, 0, 0)), "tuned to robot A"),
    ("likelihood", _likelihood(order=(1, 0, 2, 3)), "positions of the sensors"),
    ("likelihood", _likelihood(order=(3, 2, 1, 0)), "positions of the sensors"),
    ("likelihood", lambda z, x, c: models.log_likelihood(z, x, filter_checks.Constants()), "default constants"),
    ("likelihood", lambda z, x, c: np.logaddexp(models.log_likelihood(z, x, c), np.log(1e-300)), "hides zeros"),
    ("likelihood", _averaged, "do not average"),
    ("likelihood", _warns, "it warns"),
    ("resample", resampling.multinomial, "not systematic"),
    ("resample", resampling.stratified, "not systematic"),
    ("resample", _biased_residual, "biased"),
    ("resample", _no_division, "index 1000, one too many"),
    ("resample", lambda w, rng: resampling.systematic(w, rng).astype(float), "expected integers"),
    ("resample", lambda w, rng: np.arange(len(w)), "The same offspring in every draw"),
    ("resample", lambda w, rng: resampling.systematic(w, np.random.default_rng()), "draw from `rng`"),
    ("roughen", lambda states, *rest: states.copy(), "unchanged"),
    ("roughen", _jitter(lambda K, x, n, c: K * np.ptp(x, axis=0)), "factor N^(-1/6) is missing"),
    ("roughen", _jitter(lambda K, x, n, c: K * np.ptp(x, axis=0) * n**-0.5), "not 1/2"),
    ("roughen", _jitter(lambda K, x, n, c: K * n ** (-1 / 6)), "factor E is missing"),
    ("roughen", _jitter(lambda K, x, n, c: K * x.std(axis=0) * n ** (-1 / 6)), "not the standard deviation"),
    ("roughen", _jitter(lambda K, x, n, c: _right(K, x, n, c) ** 2), "it is squared here"),
    ("roughen", _jitter(_right, shape=lambda n, d: (1, d)), "same jitter"),
    ("roughen", _jitter(_right, shape=lambda n, d: (n, 1)), "columns get the same jitter"),
    ("roughen", lambda x, K, c, rng: course.roughen(x, K, c, np.random.default_rng()), "draw from `rng`"),
    ("roughen", _jitter(_right, walls=False), "leave the room"),
    ("roughen", _jitter(_right, angles=False), "not wrapped"),
]


@pytest.mark.parametrize("name, wrong, words", WRONG, ids=[f"{name}: {words}" for name, _, words in WRONG])
def test_a_wrong_answer_is_told_what_it_did(name, wrong, words):
    state, message, _ = judge(BY_NAME[name], wrong)
    assert state == "failed", message
    assert words in message
    assert len(message) < 700


def test_headings_are_compared_on_the_circle():
    """-π and π are one direction: a robot that drives at the wall head-on may leave with either sign."""

    def by_reflection(heading, normal, noise):
        along = np.copysign(1, np.sin(normal - heading)) * -1
        into = np.arccos(np.clip(-np.cos(heading - normal), -1, 1))
        return wrap(normal + along * (np.pi / 2 - (np.pi / 2 - into) * (1 + noise)))

    assert judge(BY_NAME["bounce"], by_reflection)[0] == "passed"


N = 1000


def plain_filter(previous, observation, control, constants, rng, log_likelihood=models.log_likelihood):
    """What a student has who joined the pieces."""
    if previous is None:
        return models.prior(N, constants, rng)
    states = previous.copy()
    for robot in (0, 1):
        columns = slice(3 * robot, 3 * robot + 3)
        distance = np.full(N, control[robot] * constants.Ts)
        states[:, columns] = np.column_stack(course.drive(*states[:, columns].T, distance, constants, rng))
    log_weights = log_likelihood(observation, states, constants)
    if np.all(log_weights == log_weights[0]):
        return states
    weights = np.exp(log_weights - log_weights.max())
    return course.roughen(states[resampling.systematic(weights, rng)], 0.05, constants, rng)


def test_the_pieces_make_a_filter_that_passes_beside_the_reference(monkeypatch):
    monkeypatch.setattr(filter_checks, "RUNS", 1)
    filter_checks._reference_errors.cache_clear()
    state, message, _ = judge(BY_NAME["estimator"], plain_filter)
    filter_checks._reference_errors.cache_clear()
    assert state == "passed", message
    assert "yours 0." in message and "the course's reference 0." in message


def _changed(change):
    def estimator(previous, observation, control, constants, rng):
        return change(plain_filter(previous, observation, control, constants, rng))

    return estimator


def _one_start(previous, observation, control, constants, rng):
    states = plain_filter(previous, observation, control, constants, rng)
    if previous is None:
        states[:] = states[0]
    return states


def _divides(previous, observation, control, constants, rng):
    states = plain_filter(previous, observation, control, constants, rng)
    if observation is not None:
        with np.errstate(all="ignore"):
            likelihood = np.exp(models.log_likelihood(observation, states, constants))
            likelihood /= likelihood.sum()
        if np.isnan(likelihood).any():
            states[:] = np.nan
    return states


def _no_mixture(*arguments):
    return plain_filter(*arguments, log_likelihood=_likelihood(lambda right, wrong, s: right))


@pytest.mark.parametrize(
    "estimator, words",
    [
        (_changed(lambda states: states[:, :3]), "an array (N, 6), got shape (1000, 3)"),
        (_changed(lambda states: (states, np.zeros(N))), "the weights sum to 1000"),
        (_changed(lambda states: states + [9, 0, 0, 0, 0, 0]), "outside the room"),
        (_one_start, "with probability 1/2"),
        (_divides, "when no particle can explain the readings"),
        (_no_mixture, "Error over 3 recorded runs: yours "),
    ],
    ids=["columns", "weights", "outside", "one start", "division by zero", "no mixture"],
)
def test_a_broken_filter_is_told_what_it_did(monkeypatch, estimator, words):
    monkeypatch.setattr(filter_checks, "_reference_errors", list)
    state, message, _ = judge(BY_NAME["estimator"], estimator)
    assert state == "failed"
    assert words in message
