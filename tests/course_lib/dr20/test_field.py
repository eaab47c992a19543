"""The likelihood field: against scipy's interpolation, distances that are known, and the beam model."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates
from scipy.stats import norm

from course_lib.dr20 import field, maps, models
from course_lib.dr20.constants import Constants
from course_lib.geometry.polygons import clearance

SHEET = Constants()
FIELD = field.likelihood_field(SHEET)
MAPS = {
    "sheet": SHEET,
    "attic": Constants(room=maps.ATTIC, obstacles=maps.CHIMNEYS, mount=0.1),
}


def twin(observation, states, table, constants):
    """`log_likelihood` on arrays, with scipy's look-up."""
    seen = np.isfinite(observation)
    angles = states[:, 2:] + np.asarray(constants.bearings)[seen]
    x = states[:, :1] + constants.mount * np.cos(states[:, 2:]) + observation[seen] * np.cos(angles)
    y = states[:, 1:2] + constants.mount * np.sin(states[:, 2:]) + observation[seen] * np.sin(angles)
    row, column = (y - table.origin[1]) / table.resolution, (x - table.origin[0]) / table.resolution
    d = map_coordinates(table.distances, [row, column], order=1, cval=np.inf)
    p_anywhere = constants.p_short + constants.p_random
    p_hit = 1.0 - constants.p_miss - p_anywhere
    return np.log(p_hit * norm(0.0, constants.sigma).pdf(d) + p_anywhere / constants.r_max).sum(axis=1)


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_the_kernel_matches_its_twin(name):
    constants, rng = MAPS[name], np.random.default_rng(30)
    table = field.likelihood_field(constants)
    states = models.anywhere(400, constants, rng)
    for observation in ([1.0, 0.7, np.inf, 2.0, 0.4], rng.uniform(0.0, 4.0, 5)):
        observation = np.asarray(observation)
        np.testing.assert_allclose(
            field.log_likelihood(observation, states, table, constants),
            twin(observation, states, table, constants),
            rtol=1e-9,
        )


@given(st.sampled_from(sorted(MAPS)), st.floats(0.02, 0.4), st.integers(0, 10**6))
def test_look_up_is_off_by_less_than_it_says(name, resolution, seed):
    constants = MAPS[name]
    table = field.likelihood_field(constants, resolution)
    points = np.random.default_rng(seed).uniform(constants.bounds[:2] - 0.5, constants.bounds[2:] + 0.5, (50, 2))
    exact = clearance(points, constants.walls)
    assert np.abs(field.distance(points, table) - exact).max() <= resolution / np.sqrt(2.0) + 1e-12


def test_between_the_grids_points_it_is_exact_beside_a_long_wall():
    points = np.array([[0.012, 3.033], [0.3271, 2.9], [4.999, 0.7], [-0.21, 1.234]])
    np.testing.assert_allclose(field.distance(points, FIELD), [0.012, 0.3271, 0.001, 0.21], atol=1e-12)


def test_the_grid_covers_the_map_and_its_margin_and_ends_there():
    corners = np.array([[-0.5, -0.5], [5.5, 5.5], [5.0, 5.0]])
    np.testing.assert_allclose(field.distance(corners, FIELD), [np.sqrt(0.5), np.sqrt(0.5), 0.0], atol=1e-12)
    assert np.isinf(field.distance(np.array([[-0.51, 1.0], [1.0, 5.61], [np.nan, 1.0]]), FIELD)).all()


def test_a_reading_that_ends_at_a_wall_is_best_and_one_that_ends_nowhere_is_as_good_as_random():
    state, silent = np.array([[0.5, 4.0, -np.pi]]), np.full(5, np.inf)
    observation = silent.copy()
    observation[2] = 0.5
    peak = 0.91 / (0.05 * np.sqrt(2 * np.pi)) + 0.07 / 4.0
    assert field.log_likelihood(observation, state, FIELD, SHEET) == pytest.approx(np.log(peak))
    observation[2] = 3.0
    assert field.log_likelihood(observation, state, FIELD, SHEET) == pytest.approx(np.log(0.07 / 4.0))
    assert field.log_likelihood(silent, state, FIELD, SHEET) == 0.0


def test_the_mount_moves_the_beams_ahead():
    ahead = replace(SHEET, mount=0.1)
    states = models.anywhere(50, SHEET, np.random.default_rng(31))
    moved = states + 0.1 * np.column_stack([np.cos(states[:, 2]), np.sin(states[:, 2]), np.zeros(50)])
    scan = np.array([1.0, 0.7, 0.6, 2.0, 0.4])
    np.testing.assert_allclose(
        field.log_likelihood(scan, states, FIELD, ahead), field.log_likelihood(scan, moved, FIELD, SHEET)
    )


@pytest.mark.filterwarnings("ignore:divide by zero")
def test_hundreds_of_beams_do_not_underflow():
    many = replace(SHEET, bearings=tuple(np.linspace(-1.2, 1.2, 361)))
    result = field.log_likelihood(np.full(361, 3.9), np.array([[0.3, 0.3, np.pi]]), FIELD, many)
    assert result == pytest.approx(361 * np.log(0.07 / 4.0), rel=0.01)


def test_it_sees_through_walls_and_the_beam_model_does_not():
    # Across the large table: its near side is 0.5 m ahead, its far side 1.5 m.
    state, observation = np.array([[1.5, 3.0, 0.0]]), np.full(5, np.inf)
    field_of, beam_of = [], []
    for reading in (0.5, 1.5):
        observation[2] = reading
        field_of.append(field.log_likelihood(observation, state, FIELD, SHEET)[0])
        beam_of.append(models.log_likelihood(observation, state, SHEET)[0])
    assert field_of[0] == pytest.approx(field_of[1])
    assert beam_of[0] - beam_of[1] > 5.0


def test_where_nothing_is_hidden_it_prefers_the_pose_that_was_scanned():
    room = Constants(obstacles=(), p_short=0.0, p_miss=0.0, p_random=0.01, r_max=8.0)
    table, rng = field.likelihood_field(room), np.random.default_rng(32)
    truth = models.anywhere(20, room, rng)
    for state, scan in zip(truth, models.distances(truth, room), strict=True):
        near = state + rng.normal(0.0, 0.3, (200, 3))
        there = field.log_likelihood(scan, state[None], table, room)[0]
        assert there >= field.log_likelihood(scan, near, table, room).max() - 0.5
