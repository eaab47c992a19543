"""The report's method: the listing, its array form, and each of its errors.

Random seeds are fixed: every test here has one outcome.
"""

from dataclasses import replace

import numpy as np
import pytest

from course_lib.angles import circular_mean
from course_lib.dr20 import maps, models, success
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.report import listing, method
from course_lib.dr20.world import World
from course_lib.filters import Particles, Step, equally_weighted
from course_lib.geometry.polygons import inside
from course_lib.recording import replay

SHEET = Constants()
LINES = listing.half_metre_lines(SHEET)
CONTROL = np.array([0.5, 0.25])
SCAN = np.array([0.9, 1.0, 1.6, 1.3, 0.8])
#: The report's weights and everything else put right.
MENDED = method.Choices(
    weight="gaussian",
    zero_inside=True,
    jitter=(0.01, 0.01, 0.01),
    collisions=True,
    circular=True,
    paired=True,
    alpha_slow=0.05,
    alpha_fast=0.5,
    from_zero=False,
    headings=(-np.pi, np.pi),
    free=True,
)


def anywhere(n, seed, margin=0.0):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(margin, 5.0 - margin, (n, 2)), rng.uniform(-9.0, 9.0, n)])


def started(states, **memory):
    """A step as the estimator leaves it, with this cloud."""
    memory = {"log_slow": None, "log_fast": None, "estimate": states.mean(axis=0), "share": 0.0} | memory
    return Step(equally_weighted(states), method.Memory(states, **memory))


def stepped(choices, states, observation=SCAN, seed=0, **memory):
    previous = started(states, **memory)
    return method.estimator(choices)(previous, observation, CONTROL, SHEET, np.random.default_rng(seed))


# The listing, and the same on arrays


def test_the_assignments_printed_scan():
    ranges = listing.detect_obstacles(2.3297, 0.4813, np.radians(0.35), LINES)
    # The heading is known to a hundredth of a degree only.
    np.testing.assert_allclose(ranges, [0.4813, 0.6849, 2.6704, 0.9539, 0.5187], atol=2e-4)


def test_the_listings_rays_are_exact_inside_the_room():
    states = anywhere(500, 1)
    expected = [listing.detect_obstacles(*state, LINES) for state in states]
    np.testing.assert_allclose(expected, method.distances(states, SHEET), atol=1e-12)


def test_rays_along_the_axes_do_not_divide_by_zero():
    for heading in (-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi):
        expected = listing.detect_obstacles(0.7, 4.2, heading, LINES)
        np.testing.assert_allclose(expected, method.distances(np.array([[0.7, 4.2, heading]]), SHEET)[0], atol=1e-12)


def test_outside_the_room_the_array_form_sees_nothing_where_the_listing_sees_the_wall_behind():
    state = np.array([[-0.1, 2.5, np.pi]])
    assert listing.detect_obstacles(*state[0], LINES)[2] == pytest.approx(0.1)
    assert method.distances(state, SHEET)[0, 2] == pytest.approx(np.hypot(100.1, 97.5))
    assert listing.detect_obstacles(5.1, 2.5, 0.0, LINES)[2] == pytest.approx(np.hypot(94.9, 97.5))


def test_the_array_form_is_the_listing_draw_by_draw():
    n, run = 60, World().simulate(np.random.default_rng(2))
    estimator, slow, fast = method.estimator(), 0.0, 0.0
    step = started(anywhere(n, 3, margin=0.3))
    for k in range(6):
        # A wall's back looks different in the two: nobody comes near one.
        states = step.memory.states.copy()
        states[:, :2] = np.clip(states[:, :2], 0.3, 4.7)
        step = Step(step.posterior, step.memory._replace(states=states))
        observation, control = run.observations[k], run.controls[k]
        estimate, px, pw, slow, fast = listing.pf_localization(
            states.T, np.zeros((1, n)), slow, fast, observation, control, LINES, SHEET, np.random.default_rng(k)
        )
        step = estimator(step, observation, control, SHEET, np.random.default_rng(k))
        np.testing.assert_allclose(step.posterior.states, px.T, atol=1e-12)
        np.testing.assert_allclose(step.posterior.weights, pw[0], atol=1e-12)
        np.testing.assert_allclose(step.memory.estimate, estimate, atol=1e-12)
        np.testing.assert_allclose(np.exp([step.memory.log_slow, step.memory.log_fast]), [slow, fast])


def test_an_exact_match_has_an_infinite_weight_and_ends_both():
    silent, states = replace(SHEET, sigma_v=0.0, sigma_omega=0.0), anywhere(10, 4, margin=0.5)
    states[:, :2] = [0.75, 0.75]
    moved = states + 0.1 * np.column_stack([0.5 * np.cos(states[:, 2]), 0.5 * np.sin(states[:, 2]), np.full(10, 0.25)])
    scan = listing.detect_obstacles(*moved[3], LINES)
    with pytest.raises(ValueError, match="NaN"):
        listing.pf_localization(
            states.T, np.zeros((1, 10)), 0.0, 0.0, scan, CONTROL, LINES, silent, np.random.default_rng(0)
        )
    exact = method.distances(moved, silent)[3]
    with pytest.raises(ValueError, match="NaN"):
        method.estimator()(started(states), exact, CONTROL, silent, np.random.default_rng(0))


@pytest.mark.parametrize(
    "room, obstacles",
    [
        (maps.ATTIC, ()),
        (maps.box(0.0, 0.0, 5.0, 5.2), ()),
        (maps.box(1.0, 0.0, 5.0, 5.0), ()),
        (maps.ROOM, (((1.0, 1.0), (2.0, 2.0), (1.0, 2.0)),)),
    ],
)
def test_other_maps_are_for_the_array_form(room, obstacles):
    constants = Constants(room=room, obstacles=obstacles)
    with pytest.raises(ValueError, match="half-metre lines"):
        listing.half_metre_lines(constants)
    rng, estimator = np.random.default_rng(5), method.estimator()
    step = estimator(None, None, None, constants, rng)
    step = estimator(step, SCAN, CONTROL, constants, rng)
    assert step.posterior.states.shape == (1000, 3) and np.isfinite(step.memory.estimate).all()


# Its errors, one by one


def test_injects_more_than_half_at_once_and_nothing_when_lost():
    assert stepped(method.Choices(), anywhere(200, 6)).memory.share == pytest.approx(1.0 - 0.3 / 0.7)
    assert stepped(replace(method.Choices(), from_zero=False), anywhere(200, 6)).memory.share == 0.0
    near = np.tile([1.0, 1.0, 0.0], (200, 1))
    scan = method.distances(near[:1], SHEET)[0]
    good = {"log_slow": np.log(20.0), "log_fast": np.log(20.0)}
    lost = -0.5 + 0.0 * scan
    assert stepped(method.Choices(), near, lost, **good).memory.share == 0.0
    assert stepped(replace(method.Choices(), alpha_slow=0.3, alpha_fast=0.7), near, lost, **good).memory.share > 0.3
    found = stepped(method.Choices(), near, scan, log_slow=np.log(0.1), log_fast=np.log(0.1)).memory
    assert found.share > 0.4


def test_injects_headings_on_half_the_circle_and_positions_inside_tables():
    lost = {"log_slow": 50.0, "log_fast": -50.0}
    choices = method.Choices(alpha_slow=0.0, jitter=(0.0, 0.0, 0.0))
    outside = np.tile([-3.0, -3.0, 0.1], (3000, 1))

    def injected(choices):
        states = stepped(choices, outside, **lost).posterior.states
        return states[states[:, 0] > 0.0]

    with np.errstate(divide="ignore"):
        states, mended = injected(choices), injected(replace(choices, headings=(-np.pi, np.pi), free=True))
    # All were to be replaced; drawn with replacement, a share of 1 / e is not.
    assert len(states) / 3000 == pytest.approx(1.0 - np.exp(-1.0), abs=0.03)
    assert states[:, 2].min() > 0.0 and mended[:, 2].min() < -3.0
    in_tables = ~inside(np.ascontiguousarray(states[:, :2]), SHEET.walls)
    # Tables are 10 % of the room.
    assert 0.07 < in_tables.mean() < 0.13
    assert models.free(mended, SHEET).all() and not models.free(states, SHEET).all()


def test_averages_reset_after_an_injection():
    lost = {"log_slow": 10.0, "log_fast": 0.0}
    choices = method.Choices(alpha_slow=0.05, alpha_fast=0.5)
    assert stepped(choices, anywhere(100, 7), **lost).memory.log_slow is not None
    assert stepped(replace(choices, reset=True), anywhere(100, 7), **lost).memory.log_slow is None


def test_old_weights_go_with_new_particles():
    states = np.vstack([np.tile([1.0, 1.0, 0.0], (50, 1)), np.tile([4.7, 3.0, 2.0], (50, 1))])
    scan = method.distances(states[:1], SHEET)[0]
    choices = method.Choices(weight="gaussian", augmented=False)
    weights = stepped(choices, states, scan).posterior.weights
    # All offspring are of the first half, and half of them are drawn as if they had no weight.
    assert (stepped(choices, states, scan).posterior.states[:, 0] < 2.0).all()
    assert weights[50:].sum() < 1e-6
    np.testing.assert_allclose(stepped(replace(choices, paired=True), states, scan).posterior.weights, 0.01)


def test_headings_are_averaged_as_numbers():
    states = np.tile([1.0, 1.0, 3.1], (100, 1))
    states[::2, 2] = -3.1
    scan, choices = method.distances(states[:1], SHEET)[0], method.Choices(weight="norm", augmented=False)
    assert abs(stepped(choices, states, scan).memory.estimate[2]) < 1.5
    assert abs(stepped(replace(choices, circular=True), states, scan).memory.estimate[2]) > 3.0


def test_jitter_is_what_it_says():
    states = np.tile([1.0, 1.0, 0.0], (4000, 1))
    scan = method.distances(states[:1], SHEET)[0]
    spread = stepped(method.Choices(augmented=False), states, scan).posterior.states.std(axis=0)
    np.testing.assert_allclose(spread, 0.2 / np.sqrt(12.0), rtol=0.1)
    tight = replace(method.Choices(augmented=False), jitter=(0.0, 0.0, 0.0))
    assert stepped(tight, states, scan).posterior.states.std(axis=0).max() < 0.01


def test_particles_in_tables_count_in_the_listing_and_not_in_the_text():
    states = np.vstack([np.tile([2.5, 2.7, 0.0], (50, 1)), np.tile([0.7, 0.7, 0.0], (50, 1))])
    scan = method.distances(states[:1], SHEET)[0]
    assert stepped(method.Choices(), states, scan).posterior.weights[:50].sum() > 0.5
    assert stepped(replace(method.Choices(), zero_inside=True), states, scan).posterior.weights[:50].sum() == 0.0


def test_walls_stop_particles_only_when_told():
    states = np.tile([4.84, 2.5, 0.0], (50, 1))
    choices = method.Choices(augmented=False, jitter=(0.0, 0.0, 0.0))
    assert stepped(choices, states).posterior.states[:, 0].max() > 4.86
    assert stepped(replace(choices, collisions=True), states).posterior.states[:, 0].max() < 4.8501


def test_the_weights_rank_as_they_say():
    states = anywhere(300, 8)
    difference = np.linalg.norm(
        np.minimum(method.distances(states, SHEET), SHEET.r_max) - np.minimum(SCAN, SHEET.r_max), axis=1
    )
    order = np.argsort(difference)
    for weight, rising in [("inverse", -1), ("gaussian", -1), ("norm", 1)]:
        log_weights = method._weighed(states, SCAN, method.Choices(weight=weight), SHEET)
        assert (rising * np.diff(log_weights[order]) >= 0.0).all()
    beam = method._weighed(states, SCAN, method.Choices(weight="beam"), SHEET)
    np.testing.assert_array_equal(beam, models.log_likelihood(SCAN, states, SHEET))
    with pytest.raises(ValueError, match="must be one of inverse"):
        method.Choices(weight="cosine")


# What they cost


def test_put_right_it_is_more_accurate():
    # A room without surprises: the report's beams neither miss nor meet anything before the wall.
    plain = Constants(p_short=0.0, p_miss=0.0, p_random=0.0, r_max=8.0, within=1.0)
    run = World(plain, Hidden(steps=150, careless=0.0)).simulate(np.random.default_rng(9))
    error = {}
    for choices in (method.Choices(augmented=False), MENDED):
        steps = list(replay(method.estimator(choices), run, plain, np.random.default_rng(10)))
        judgement = success.judge([step.memory.estimate for step in steps], run.truth, plain.Ts)
        error[choices] = np.median(judgement.position[50:])
        assert isinstance(steps[-1].posterior, Particles)
    assert error[MENDED] < 0.5 * error[method.Choices(augmented=False)]


def test_the_estimate_is_that_of_the_weighted_cloud():
    states = anywhere(100, 11, margin=0.3)
    step = stepped(replace(method.Choices(), circular=True, augmented=False, jitter=(0.0, 0.0, 0.0)), states)
    moved = method._moved(states, CONTROL, method.Choices(), SHEET, np.random.default_rng(0))
    weights = step.posterior.weights
    np.testing.assert_allclose(step.memory.estimate[:2], weights @ moved[:, :2])
    assert step.memory.estimate[2] == pytest.approx(circular_mean(moved[:, 2], weights))
