"""Motion and beams of the DR20: analytic cases, NumPy twins, and the models as densities.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import kstest, norm

from course_lib.angles import wrap
from course_lib.dr20 import maps, models
from course_lib.dr20.constants import Constants
from course_lib.geometry.polygons import clearance
from tests.course_lib.dr20.twins import beam_log_likelihood_numpy, drive_numpy

FALSE_ALARM = 1e-6
DEFAULT = Constants()
EMPTY = Constants(obstacles=())
ORACLES = {
    "default": {},
    "near-sighted": {"r_max": 1.5},
    "no short readings": {"p_short": 0.0},
    "hits only": {"p_short": 0.0, "p_miss": 0.0, "p_random": 0.0},
    "noisy": {"sigma": 0.5, "p_short": 0.3, "rate_short": 4.0, "p_miss": 0.2},
}


def test_the_printed_scan_of_the_source_is_of_one_pose():
    scan = models.distances(np.array([[2.3297, 0.4813, np.radians(0.35)]]), DEFAULT)
    np.testing.assert_allclose(scan[0], [0.4813, 0.6849, 2.6704, 0.9539, 0.5187], atol=1.5e-4)


def test_beams_start_ahead_of_the_axle():
    pose = np.array([[2.0, 2.0, np.pi / 2]])
    moved = pose + [[0.0, 0.1, 0.0]]
    np.testing.assert_array_equal(
        models.distances(pose, replace(EMPTY, mount=0.1)), models.distances(moved, replace(EMPTY, mount=0.0))
    )


@pytest.mark.parametrize("within, near", [(1.0, (3.5, 2.5)), (0.4, (0.3, 0.3)), (100.0, (2.5, 2.5))])
def test_the_prior_is_uniform_over_what_is_free(within, near):
    constants = Constants(near=near, within=within)
    states = models.prior(4000, constants, np.random.default_rng(0))
    assert models.free(states, constants).all()
    assert (np.abs(states[:, :2] - near) <= within).all()
    assert kstest(states[:, 2], "uniform", args=(-np.pi, 2 * np.pi)).pvalue > FALSE_ALARM
    # Rejection from a grid of the same square has the same mean and spread.
    axis = np.linspace(-within, within, 401) if within < 10.0 else np.linspace(-2.5, 2.5, 401)
    grid = np.stack(np.meshgrid(near[0] + axis, near[1] + axis), axis=-1).reshape(-1, 2)
    grid = grid[models.free(grid, constants)]
    error = 5.5 * grid.std(axis=0) / np.sqrt(len(states))
    assert (np.abs(states[:, :2].mean(axis=0) - grid.mean(axis=0)) < error + 0.01 * within).all()


@pytest.mark.parametrize("near, within", [((2.5, 2.75), 0.2), ((50.0, 50.0), 1.0)])
def test_a_start_inside_a_table_or_outside_the_room_is_refused(near, within):
    with pytest.raises(ValueError, match="no free position found between .* mend the map, or near and within"):
        models.prior(1, Constants(near=near, within=within), np.random.default_rng(0))


def test_free_is_a_radius_away_from_all_walls():
    points = np.random.default_rng(1).uniform(-0.5, 5.5, (2000, 2))
    within = ((points > 0.0) & (points < 5.0)).all(axis=1)
    tables = np.array([[*table[0], *table[2]] for table in maps.TABLES])
    on_table = ((points[:, None] > tables[:, :2]) & (points[:, None] < tables[:, 2:])).all(axis=2).any(axis=1)
    expected = within & ~on_table & (clearance(points, DEFAULT.walls) >= DEFAULT.radius)
    np.testing.assert_array_equal(models.free(points, DEFAULT), expected)


def test_a_circle_is_driven_as_a_circle():
    # The assignment's command, without noise: 0.5 m/s at 0.25 rad/s is a circle of radius 2 m.
    constants = Constants(room=maps.box(-9, -9, 9, 9), obstacles=(), sigma_v=0.0, sigma_omega=0.0)
    state = np.array([[2.0, 0.0, np.pi / 2]])
    rng = np.random.default_rng(0)
    for k in range(1, 300):
        state = models.transition(state, (0.5, 0.25), constants, rng)
        turned = 0.25 * k * constants.Ts
        np.testing.assert_allclose(state[0, :2], [2.0 * np.cos(turned), 2.0 * np.sin(turned)], atol=1e-9)
        assert wrap(state[0, 2] - turned - np.pi / 2) == pytest.approx(0.0, abs=1e-9)
    assert -np.pi <= state[0, 2] < np.pi


def test_a_blocked_robot_stays_and_turns():
    constants = replace(EMPTY, sigma_v=0.0, sigma_omega=0.0)
    state = np.array([[4.7, 2.0, 0.0]])
    for _ in range(10):
        state = models.transition(state, (0.5, 0.0), constants, np.random.default_rng(0))
    np.testing.assert_allclose(state, [[5.0 - constants.radius, 2.0, 0.0]], atol=1e-12)
    turned = models.transition(state, (0.5, 0.6), constants, np.random.default_rng(0))
    np.testing.assert_allclose(turned, [[5.0 - constants.radius, 2.0, 0.06]], atol=1e-12)


def test_noise_is_that_of_speed_and_yaw_rate():
    states = models.transition(np.tile([2.5, 0.75, 0.0], (4000, 1)), (0.4, 0.0), DEFAULT, np.random.default_rng(2))
    assert kstest((states[:, 2]) / DEFAULT.Ts, norm(0.0, DEFAULT.sigma_omega).cdf).pvalue > FALSE_ALARM
    speeds = (states[:, 0] - 2.5) / DEFAULT.Ts
    assert kstest(speeds, norm(0.4, DEFAULT.sigma_v).cdf).pvalue > FALSE_ALARM


def test_a_transition_leaves_its_input_alone_and_repeats_by_seed():
    states = models.prior(50, DEFAULT, np.random.default_rng(3))
    kept = states.copy()
    one = models.transition(states, (0.5, 0.2), DEFAULT, np.random.default_rng(4))
    np.testing.assert_array_equal(states, kept)
    np.testing.assert_array_equal(one, models.transition(states, (0.5, 0.2), DEFAULT, np.random.default_rng(4)))


@pytest.mark.parametrize("room, obstacles", [(maps.ROOM, maps.TABLES), (maps.ATTIC, maps.CHIMNEYS)])
def test_driving_is_as_in_numpy(room, obstacles):
    constants = Constants(room=room, obstacles=obstacles)
    rng = np.random.default_rng(5)
    states = models.prior(500, constants, rng)
    speeds, yaw_rates = rng.normal(0.0, 3.0, 500), rng.normal(0.0, 2.0, 500)
    yaw_rates[:3] = 0.0, 1e-9, -1e-7
    expected = drive_numpy(states, speeds, yaw_rates, constants.Ts, constants.walls, constants.radius)
    models.drive(states, speeds, yaw_rates, constants.Ts, constants.walls, constants.radius)
    np.testing.assert_allclose(states[:, :2], expected[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap(states[:, 2] - expected[:, 2]), 0.0, atol=1e-9)
    assert (np.abs(states[:, 2]) <= np.pi).all()


def test_nobody_ever_leaves_the_free_space():
    rng = np.random.default_rng(6)
    states = models.prior(300, DEFAULT, rng)
    for _ in range(60):
        states = models.transition(states, (1.5, 0.7), DEFAULT, rng)
        assert models.free(states, DEFAULT).all()


@pytest.mark.parametrize("setting", ORACLES)
def test_the_beam_model_is_as_in_numpy(setting):
    constants = Constants(**ORACLES[setting])
    rng = np.random.default_rng(7)
    states = models.prior(200, constants, rng)
    expected = models.distances(states, constants)
    for scan in models.read(expected[:5], constants, rng):
        np.testing.assert_allclose(
            models.log_likelihood(scan, states, constants),
            beam_log_likelihood_numpy(scan, expected, constants),
            rtol=1e-9,
            atol=1e-9,
        )


@pytest.mark.parametrize("setting", ORACLES)
@pytest.mark.parametrize("distance", [0.4, 1.45, 3.98, 6.0, np.inf])
def test_the_beam_model_is_a_distribution(setting, distance):
    """Over all readings, and their absence, it sums to one."""
    constants = Constants(**ORACLES[setting])

    def density(z):
        return np.exp(_one_beam(z, distance, constants))

    edges = [-5 * constants.sigma - 1.0, 0.0, min(distance, constants.r_max), constants.r_max]
    edges += [np.clip(distance + k * constants.sigma, edges[0], constants.r_max) for k in (-6, -2, 0, 2, 6)]
    edges = np.unique(np.minimum(edges, constants.r_max))
    total = sum(quad(density, a, b)[0] for a, b in zip(edges[:-1], edges[1:], strict=True))
    assert total + np.exp(_one_beam(np.inf, distance, constants)) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("setting", ORACLES)
def test_readings_are_drawn_as_the_model_weighs_them(setting):
    constants = Constants(**ORACLES[setting])
    for distance in (0.6, 3.5):
        readings = models.read(np.full((4000, 1), distance), constants, np.random.default_rng(8))[:, 0]
        missed = np.exp(_one_beam(np.inf, distance, constants))
        share = np.isinf(readings).mean()
        assert abs(share - missed) < 5.0 * np.sqrt(missed * (1.0 - missed) / 4000) + 1e-12
        grid = np.linspace(-3.0, constants.r_max, 20_001)
        density = np.exp([_one_beam(z, distance, constants) for z in grid])
        cumulative = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(grid))])

        def distribution(z, grid=grid, cumulative=cumulative):
            return np.interp(z, grid, cumulative / cumulative[-1])

        assert kstest(readings[np.isfinite(readings)], distribution).pvalue > FALSE_ALARM


def test_many_beams_do_not_underflow():
    expected, readings = np.full((1, 400), 3.0), np.full(400, 0.5)
    constants = Constants(p_short=0.0, p_miss=0.0, p_random=1e-6)
    value = models.beam_log_likelihood(readings, expected, 0.05, 4.0, 0.0, 1.0, 0.0, 1e-6)
    np.testing.assert_allclose(value, beam_log_likelihood_numpy(readings, expected, constants), rtol=1e-9)
    assert np.isfinite(value).all()


def test_particles_far_from_the_truth_still_differ():
    certain = Constants(**ORACLES["hits only"], sigma=0.01)
    values = models.log_likelihood(np.full(5, 0.3), np.array([[2.5, 0.5, 0.0], [1.0, 1.0, 0.0]]), certain)
    assert np.isfinite(values).all() and values[0] != values[1] and values.max() < -1000.0


def test_what_cannot_be_is_impossible():
    certain = Constants(**ORACLES["hits only"])
    assert models.log_likelihood([np.inf] * 5, np.array([[2.5, 0.5, 0.0]]), replace(certain, r_max=50.0))[0] == -np.inf


def _one_beam(z, distance, constants):
    return models.beam_log_likelihood(
        np.array([z]),
        np.array([[distance]]),
        constants.sigma,
        constants.r_max,
        constants.p_short,
        constants.rate_short,
        constants.p_miss,
        constants.p_random,
    )[0]
