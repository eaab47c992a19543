"""The reference estimator: its kernels against array twins, its posterior against another filter's, and its accuracy.

Random seeds are fixed, so that every test here has one outcome.
"""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from course_lib.filters import Particles, Step, bootstrap_step, equally_weighted
from course_lib.recording import replay
from course_lib.scoring import best_share_error
from course_lib.vacuum import models, reference
from course_lib.vacuum.constants import Constants, Hidden
from course_lib.vacuum.reference import COS, DRIVEN, HEADING, SIN, Estimator, X, Y
from course_lib.vacuum.world import World
from tests.course_lib.vacuum.twins import drive_numpy

DEFAULT = Constants()
SILENT = np.full(4, np.inf)
SPEEDS = np.array([1.5, 1.2])

VARIANTS = {
    "ideal reflections": (Constants(v_bar=0.0), Hidden()),
    "precise sensors that always report": (Constants(w_bar=0.2), Hidden(report_probability=1.0)),
    "no wrong robots": (Constants(s_bar=0.0), Hidden()),
    "either robot": (Constants(s_bar=0.5), Hidden(report_probability=0.05)),
    "small room, slow sampling": (Constants(L=2.5, Ts=0.5), Hidden(slowest=2.0, fastest=4.0)),
    "2017": (Constants(length=2.0, v_s_bar=0.1), Hidden(shortest_segment=200, longest_segment=200)),
}


def robots_on_the_way(n, rng, constants=DEFAULT):
    """One robot's rows after 5 s of driving: some have bounced, some have not."""
    states = models.prior(n, constants, rng)[:, :3]
    rows = np.array([*states.T, np.cos(states[:, 2]), np.sin(states[:, 2]), np.zeros(n)])
    reference.advance(rows, rng.uniform(4.0, 8.0, n), *constants.room, constants.v_bar, rng)
    return rows


def run_error(run, constants, seed):
    """Best-half error of the reference over a recorded run in metres, taken at every fourth step."""
    steps = islice(replay(Estimator, run, constants, np.random.default_rng(seed)), 0, None, 4)
    errors = []
    for step, truth in zip(steps, run.truth[::4], strict=True):
        for column in (0, 3):
            distance = np.hypot(*(step.posterior.states[:, column : column + 2] - truth[column : column + 2]).T)
            errors.append(best_share_error(distance, step.posterior.weights))
    return np.mean(errors)


# The kernels and their twins


def turn_copies_numpy(robot, parents, scale, room_x, room_y, rng):
    """`reference.turn_copies` in polar form: the bounce is the centre, the distance driven since then the radius."""
    copies = 1 + np.flatnonzero(np.diff(parents) == 0)
    x, y, heading, _, _, driven = robot[:, copies]
    u = 2.0 * rng.random(len(copies)) - 1.0
    turned = heading + np.arctan(scale * u / (1.0 - np.abs(u)))
    x = x - driven * np.cos(heading) + driven * np.cos(turned)
    y = y - driven * np.sin(heading) + driven * np.sin(turned)
    turned = (turned + np.pi) % (2 * np.pi) - np.pi
    inside = (x > 0.0) & (x < room_x) & (y > 0.0) & (y < room_y)
    robot[:, copies[inside]] = np.array([x, y, turned, np.cos(turned), np.sin(turned), driven])[:, inside]


def advance_numpy(robot, distance, room_x, room_y, v_bar, rng):
    """`reference.advance` by the array twin of `models.drive`; the distance since the last bounce from its path."""
    states, path = np.ascontiguousarray(robot[:3].T), []
    drive_numpy(states, 0, distance, room_x, room_y, v_bar, rng, path)
    legs = np.linalg.norm(np.diff(path, axis=0), axis=2)
    # Legs after the last bounce have length zero, so that the last leg of all is the last that is not.
    last = legs.shape[0] - 1 - np.argmax(legs[::-1] > 0.0, axis=0)
    driven = legs[last, np.arange(len(states))] + np.where(last == 0, robot[DRIVEN], 0.0)
    robot[:] = [*states.T, np.cos(states[:, 2]), np.sin(states[:, 2]), driven]


def weigh_numpy(weights, tuned_to, other, reading, sensor_x, sensor_y, w_bar, s_bar):
    """`reference.weigh` on arrays."""
    right, wrong = (
        models.triangular_density(reading - np.hypot(robot[X] - sensor_x, robot[Y] - sensor_y), w_bar)
        for robot in (tuned_to, other)
    )
    weights *= (1.0 - s_bar) * right + s_bar * wrong


def test_turn_copies_matches_its_twin():
    rng = np.random.default_rng(3)
    robot = robots_on_the_way(2000, rng)
    parents = np.sort(rng.integers(2000, size=2000))
    expected = robot.copy()
    turn_copies_numpy(expected, parents, 0.3, 5.0, 5.0, np.random.default_rng(4))
    original = robot.copy()
    reference.turn_copies(robot, parents, 0.3, 5.0, 5.0, np.random.default_rng(4))
    np.testing.assert_allclose(robot, expected, atol=1e-12)
    moved = np.any(robot != original, axis=0)
    first = np.diff(parents, prepend=-1) > 0
    assert not moved[first].any() and moved[~first].mean() > 0.7


@pytest.mark.parametrize("v_bar", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("longest", [0.2, 20.0])
def test_advance_matches_its_twin(v_bar, longest):
    rng = np.random.default_rng(5)
    robot = robots_on_the_way(2000, rng)
    distance = rng.uniform(0.01, longest, 2000)
    expected = robot.copy()
    advance_numpy(expected, distance, 5.0, 5.0, v_bar, np.random.default_rng(6))
    reference.advance(robot, distance, 5.0, 5.0, v_bar, np.random.default_rng(6))
    np.testing.assert_allclose(robot, expected, atol=1e-9 if longest > 1.0 else 1e-12)


@pytest.mark.parametrize("s_bar", [0.0, 0.1, 1.0])
def test_weigh_matches_its_twin(s_bar):
    rng = np.random.default_rng(7)
    a, b = robots_on_the_way(2000, rng), robots_on_the_way(2000, rng)
    weights = rng.random(2000)
    expected = weights.copy()
    weigh_numpy(expected, a, b, 3.0, 5.0, 0.0, 0.7, s_bar)
    reference.weigh(weights, a, b, 3.0, 5.0, 0.0, 0.7, s_bar)
    np.testing.assert_allclose(weights, expected, rtol=1e-12)


# The estimator


def test_the_first_call_returns_the_prior():
    constants = Constants(L=3.0, length=2.0)
    step = Estimator(None, None, None, constants, np.random.default_rng(8))
    states, weights = step.posterior.states, step.posterior.weights
    assert isinstance(step, Step) and isinstance(step.posterior, Particles)
    assert states.shape == (len(weights), 6) and weights.sum() == pytest.approx(1.0)
    for column, sensors in [(0, constants.sensors[:2]), (3, constants.sensors[2:])]:
        for corner in sensors:
            share = np.all(states[:, column : column + 2] == corner, axis=1).mean()
            # A share of one half of five thousand has a standard deviation of 0.007.
            assert share == pytest.approx(0.5, abs=0.04)


def test_the_same_generator_gives_the_same_posterior_and_nothing_given_is_changed():
    run = World(hidden=Hidden(steps=12)).simulate(np.random.default_rng(9))
    first, second = (
        [step.posterior.states for step in replay(Estimator, run, DEFAULT, np.random.default_rng(10))] for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)
    steps = list(replay(Estimator, run, DEFAULT, np.random.default_rng(10)))
    rng = np.random.default_rng(11)
    once = Estimator(steps[-2], run.observations[-1], run.controls[-1], DEFAULT, rng)
    again = Estimator(steps[-2], run.observations[-1], run.controls[-1], DEFAULT, np.random.default_rng(11))
    np.testing.assert_array_equal(once.posterior.states, again.posterior.states)


@pytest.mark.parametrize("name", VARIANTS)
def test_no_robot_leaves_the_room_and_headings_match_directions(name):
    constants, hidden = VARIANTS[name]
    run = World(constants, replace(hidden, steps=60)).simulate(np.random.default_rng(12))
    for step in replay(Estimator, run, constants, np.random.default_rng(13)):
        states, log_weights = step.posterior
        assert np.all(np.isfinite(states)) and np.exp(log_weights).sum() == pytest.approx(1.0)
        positions = states[:, [0, 1, 3, 4]]
        assert np.all((positions >= 0.0) & (positions <= np.tile(constants.room, 2)))
        assert np.all(np.abs(states[:, [2, 5]]) <= np.pi)
    robots, weights = step.memory
    np.testing.assert_allclose(np.cos(robots[:, HEADING]), robots[:, COS], atol=1e-9)
    np.testing.assert_allclose(np.sin(robots[:, HEADING]), robots[:, SIN], atol=1e-9)
    assert weights.sum() == pytest.approx(1.0)


def test_a_silent_step_is_the_motion_model_alone():
    rng = np.random.default_rng(14)
    prior = Estimator(None, None, None, DEFAULT, rng)
    step = Estimator(prior, SILENT, SPEEDS, DEFAULT, rng)
    assert np.ptp(step.memory.weights) == 0.0
    for robot in (0, 1):
        driven = np.hypot(*(step.memory.robots[robot, [X, Y]] - prior.memory.robots[robot, [X, Y]]))
        np.testing.assert_allclose(driven, SPEEDS[robot] * DEFAULT.Ts)


def test_impossible_readings_are_survived():
    rng = np.random.default_rng(15)
    step = Estimator(None, None, None, DEFAULT, rng)
    for _ in range(3):
        step = Estimator(step, np.full(4, 100.0), SPEEDS, DEFAULT, rng)
        assert np.all(np.isfinite(step.posterior.states)) and np.ptp(step.memory.weights) == 0.0


def test_agrees_with_a_bootstrap_filter_of_independent_code():
    """Mean positions over 15 steps, where the posterior's two corners of each robot matter most.

    Both filters have a Monte Carlo error of about 1 cm in the mean; the seeds are fixed.
    """
    run = World(hidden=Hidden(steps=15, report_probability=0.4)).simulate(np.random.default_rng(16))
    rng = np.random.default_rng(17)
    particles = equally_weighted(models.prior(200_000, DEFAULT, rng))
    steps = replay(Estimator, run, DEFAULT, np.random.default_rng(18))
    next(steps)
    for step, observation, control in zip(steps, run.observations, run.controls, strict=True):
        particles, _ = bootstrap_step(
            particles,
            lambda states, rng, control=control: models.transition(states, control, DEFAULT, rng),
            lambda states, observation=observation: models.log_likelihood(observation, states, DEFAULT),
            rng,
        )
        for column in (0, 1, 3, 4):
            own = step.posterior.weights @ step.posterior.states[:, column]
            assert own == pytest.approx(particles.weights @ particles.states[:, column], abs=0.08)


def test_accuracy_at_the_defaults():
    """Eight runs with fixed seeds; `make bench` measures 200."""
    errors = [run_error(World().simulate(np.random.default_rng([19, i])), DEFAULT, [20, i]) for i in range(8)]
    assert np.mean(errors) < 0.32 and max(errors) < 0.45


def test_is_not_lost_where_readings_are_precise_and_frequent():
    constants, hidden = VARIANTS["precise sensors that always report"]
    run = World(constants, hidden).simulate(np.random.default_rng(21))
    assert run_error(run, constants, 22) < 0.06
