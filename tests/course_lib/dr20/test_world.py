"""The DR20's world, and what its records refuse. Seeds are fixed: every test has one outcome."""

from dataclasses import replace

import numpy as np
import pytest

from course_lib.angles import wrap
from course_lib.dr20 import maps, models
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.world import CARRIED, World

FLAT = Constants(room=maps.FLAT, obstacles=maps.PARTITIONS)


def simulate(seed=0, constants=None, **hidden):
    constants = constants or Constants()
    return World(constants, Hidden(**hidden)).simulate(np.random.default_rng(seed))


def test_shapes_and_commands():
    run = simulate(steps=120)
    assert run.truth.shape == (121, 3) and run.observations.shape == (120, 5) and run.controls.shape == (120, 2)
    assert (run.controls[:, 0] <= 0.6).all() and (np.abs(run.controls[:, 1]) <= 1.0).all()
    assert not np.isnan(run.observations).any() and (run.observations[np.isfinite(run.observations)] <= 4.0).all()


@pytest.mark.parametrize("constants", [Constants(), FLAT, Constants(room=maps.ATTIC, obstacles=maps.CHIMNEYS)])
def test_the_robot_is_where_it_fits(constants):
    for seed in range(3):
        run = simulate(seed, constants, kidnaps=2)
        assert models.free(run.truth, constants).all()


def test_the_truth_moves_as_the_command_says_but_for_noise():
    run = simulate(1, replace(Constants(), obstacles=()), careless=0.0)
    moved, turned = np.diff(run.truth[:, :2], axis=0), wrap(np.diff(run.truth[:, 2]))
    np.testing.assert_allclose(turned, 0.1 * run.controls[:, 1], atol=0.1 * 5.5 * np.radians(3.0))
    forward = (moved * np.column_stack([np.cos(run.truth[:-1, 2]), np.sin(run.truth[:-1, 2])])).sum(axis=1)
    np.testing.assert_allclose(forward, 0.1 * run.controls[:, 0], atol=0.1 * 5.5 * 0.03 + 0.004)


def test_a_careless_driver_pushes_against_walls_and_a_careful_one_does_not():
    pushed = {}
    for careless in (0.0, 1.0):
        share = []
        for seed in range(4):
            run = simulate(seed, careless=careless)
            still = np.hypot(*np.diff(run.truth[:, :2], axis=0).T) < 1e-6
            share.append((still & (run.controls[:, 0] > 0.1)).mean())
        pushed[careless] = np.mean(share)
    assert pushed[0.0] < 0.01 and pushed[1.0] > 0.2


@pytest.mark.parametrize("kidnaps", [0, 1, 3])
def test_a_kidnapped_robot_is_carried_away_as_often_as_told(kidnaps):
    for seed in range(4):
        run = simulate(seed, kidnaps=kidnaps)
        jumps = np.flatnonzero(np.hypot(*np.diff(run.truth[:, :2], axis=0).T) > CARRIED - 0.2)
        assert len(jumps) == kidnaps
        # In the middle half of each part.
        np.testing.assert_array_equal(jumps // (300 // max(kidnaps, 1)), np.arange(kidnaps))


def test_kidnapping_leaves_readings_and_the_way_until_then_as_they_are():
    one, other = simulate(3), simulate(3, kidnaps=1)
    first = np.argmax(np.any(one.truth != other.truth, axis=1))
    assert first > 70
    np.testing.assert_array_equal(one.observations[: first - 1], other.observations[: first - 1])


def test_dead_beams_read_nothing():
    run = simulate(4, dead=(0, 3))
    assert np.isinf(run.observations[:, [0, 3]]).all() and np.isfinite(run.observations[:, [1, 2, 4]]).mean() > 0.8


def test_slip_is_noise_that_nobody_was_told_of():
    quiet, slipping = (simulate(5, replace(Constants(), obstacles=()), slip=s, careless=0.0) for s in (0.0, 4.0))
    for run, spread in ((quiet, 0.0), (slipping, 4.0 * np.radians(3.0))):
        noise = wrap(np.diff(run.truth[:, 2]) - 0.1 * run.controls[:, 1]) / 0.1
        assert noise.std() == pytest.approx(spread, rel=0.2, abs=1e-9)


def test_a_seed_is_a_run():
    for part in ("truth", "observations", "controls"):
        np.testing.assert_array_equal(getattr(simulate(7), part), getattr(simulate(7), part))
        assert not np.array_equal(getattr(simulate(7), part), getattr(simulate(8), part))


def test_a_room_too_small_to_be_carried_away_in():
    small = Constants(room=maps.box(0, 0, 1.5, 1.5), obstacles=())
    with pytest.raises(ValueError, match="no free position is 2 m away from"):
        simulate(0, small, kidnaps=1)


@pytest.mark.parametrize(
    "field, value",
    [("sigma", 0.0), ("Ts", -1.0), ("p_miss", 1.1), ("p_random", 0.95), ("mount", 0.2), ("r_max", np.inf)],
)
def test_constants_out_of_range_are_refused_by_name(field, value):
    with pytest.raises(ValueError, match=field):
        Constants(**{field: value})


@pytest.mark.parametrize("field, value", [("steps", 0), ("careless", 2.0), ("kidnaps", 100), ("slowest", 1.0)])
def test_hidden_out_of_range_is_refused_by_name(field, value):
    with pytest.raises(ValueError, match=field):
        Hidden(**{field: value})


def test_maps_are_rings_that_do_not_cross():
    shapely = pytest.importorskip("shapely")
    for room, obstacles in (
        (maps.ROOM, maps.TABLES),
        (maps.FLAT, maps.PARTITIONS),
        (maps.ATTIC, maps.CHIMNEYS),
        (maps.TWIN, maps.TWIN_PILLARS),
    ):
        outline = shapely.Polygon(room)
        shapes = [shapely.Polygon(ring) for ring in obstacles]
        assert outline.is_valid and all(shape.is_valid and outline.covers(shape) for shape in shapes)
        for i, shape in enumerate(shapes):
            assert not any(shape.overlaps(other) for other in shapes[:i])
    assert Constants().walls.shape == (24, 4), "the sheet's map has 24 segments"


def test_half_a_turn_of_the_twin_room_is_the_same_room():
    constants = Constants(room=maps.TWIN, obstacles=maps.TWIN_PILLARS)
    states = models.prior(100, constants, np.random.default_rng(9))
    turned = np.column_stack([6.0 - states[:, 0], 4.0 - states[:, 1], states[:, 2] + np.pi])
    np.testing.assert_allclose(models.distances(turned, constants), models.distances(states, constants), atol=1e-9)
