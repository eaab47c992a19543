"""What is in the pictures: walls, beacons, readings, ellipses, bounds, units, words."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image
from scipy.stats import chi2

from course_lib import plotting
from course_lib.beacon import models, plots
from course_lib.beacon.constants import YAW, Constants, Hidden
from course_lib.beacon.planning.obstacles import Scene
from course_lib.beacon.world import World
from course_lib.filters import Gaussian, Particles

CONSTANTS = Constants()


@pytest.fixture
def run():
    return World(hidden=Hidden(steps=12)).simulate(np.random.default_rng(0))


@pytest.fixture
def axes():
    figure, axes = plotting.subplots()
    yield axes
    plotting.figure(figure, alt="Drawn, so that drawing cannot fail unseen.")


def test_room_from_above_shows_walls_and_four_beacons(axes):
    constants = Constants(R=6.0)
    plots.room(axes, constants)
    (walls,) = axes.patches
    assert walls.get_xy() == (-3.0, -3.0) and walls.get_width() == walls.get_height() == 6.0
    np.testing.assert_array_equal([line.get_xydata()[0] for line in axes.get_lines()], constants.beacons[:, :2])
    assert [text.get_text() for text in axes.texts] == ["1", "2", "3", "4"]
    assert axes.get_xlabel() == "x in m" and axes.get_ylabel() == "y in m"
    # A metre is a metre in both directions.
    assert axes.get_aspect() == 1.0


def test_room_from_the_side_stands_on_its_floor(axes):
    plots.room(axes, CONSTANTS, plots.SIDE)
    (walls,) = axes.patches
    assert walls.get_xy() == (-5.0, 0.0) and walls.get_height() == 4.0
    assert [line.get_xydata()[0].tolist() for line in axes.get_lines()] == [[5.0, 2.0], [-5.0, 2.0]]
    assert axes.get_ylabel() == "z in m"


def test_a_scene_is_drawn_with_its_boxes(axes):
    scene = Scene(obstacles=((1.0, 2.0, 0.5, 2.0, 4.0, 1.0),))
    plots.room(axes, scene, plots.SIDE)
    box = axes.patches[1]
    assert box.get_xy() == (1.0, 0.5) and box.get_width() == 1.0 and box.get_height() == 0.5


def test_beacons_differ_in_colour():
    assert len(set(plots.BEACON_COLOURS)) == 4


@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_readings_without_noise_meet_at_the_vehicle(axes, yaw):
    state = np.zeros(12)
    state[:3], state[YAW] = (1.0, -2.0, 0.7), yaw
    lines = plots.readings(axes, state, models.observe(state[None], CONSTANTS)[0], CONSTANTS)
    for arc, ray, beacon in zip(lines[:4], lines[4:], CONSTANTS.beacons, strict=True):
        points = arc.get_xydata()
        inside = points[np.isfinite(points).all(axis=1)]
        # 240 points on a circle of some metres.
        assert np.linalg.norm(inside - state[:2], axis=1).min() < 0.1
        np.testing.assert_allclose(ray.get_xydata(), [state[:2], beacon[:2]], atol=1e-9)


def test_missing_readings_are_not_drawn(axes):
    lines = plots.readings(axes, np.zeros(12), np.full(11, np.inf), CONSTANTS)
    assert all(np.isnan(line.get_xydata()).any(axis=1)[1:].all() for line in lines)


def test_ellipse_holds_95_percent(axes):
    covariance = np.zeros((12, 12))
    covariance[:3, :3] = [[0.5, 0.2, 0.0], [0.2, 0.3, 0.1], [0.0, 0.1, 0.2]]
    centre = np.arange(12.0)
    for view in (plots.ABOVE, plots.SIDE):
        outline = plots.ellipse(axes, Gaussian(centre, covariance), view).get_xydata() - centre[list(view)]
        part = covariance[np.ix_(view, view)]
        squares = np.einsum("ni,ij,nj->n", outline, np.linalg.inv(part), outline)
        np.testing.assert_allclose(squares, chi2.ppf(0.95, 2))


def test_cloud_shows_particles_by_their_weight(axes):
    states = np.zeros((3, 12))
    states[:, 0] = 1.0, 3.0, 5.0
    particles = Particles(states, np.log(np.array([0.25, 0.75, 1e-12])))
    # `size` is more than there are particles: as many are drawn as there are, in proportion to their weights.
    np.testing.assert_array_equal(plots.cloud(axes, particles, size=100).get_xdata(), [1.0, 3.0, 3.0])


def test_vehicle_points_where_it_looks(axes):
    state = np.zeros(12)
    state[YAW] = np.pi / 2
    outline = plots.vehicle(axes, state, size=0.5).get_xydata()
    np.testing.assert_allclose(outline[np.argmax(np.linalg.norm(outline, axis=1))], [0.0, 0.5], atol=1e-12)


def test_vehicle_leans_towards_where_it_accelerates(axes):
    state = np.zeros(12)
    state[4] = 0.3
    line = plots.vehicle(axes, state, plots.SIDE).get_xydata()
    # Pitched by 0.3 its thrust points ahead, and its disc slopes down towards there.
    np.testing.assert_allclose(np.arctan2(*np.flip(line[1] - line[0])), -0.3)


def test_bounds_are_those_of_the_average():
    low, high = plots.bounds(12, 50)
    averages = np.random.default_rng(0).chisquare(12, (4000, 50)).mean(axis=1)
    # 4000 draws: 95 % with a standard deviation of 0.34 %; the seed is fixed.
    assert abs(np.mean((low < averages) & (averages < high)) - 0.95) < 0.02


def test_consistency_shows_its_bounds_over_seconds(axes):
    plots.consistency(axes, {"mine": np.full(10, 12.0), "yours": np.full(10, 90.0)}, 12, 8, Ts=0.2)
    mine, yours = axes.get_lines()
    np.testing.assert_allclose(mine.get_xdata()[[0, -1]], [0.2, 2.0])
    assert mine.get_linestyle() != yours.get_linestyle()
    assert axes.get_xlabel() == "time in s" and axes.get_yscale() == "log"
    assert axes.get_legend().get_texts()[0].get_text() == "where 95 % should be"


def test_tree_draws_each_edge(axes):
    plots.tree(axes, [np.zeros((2, 12)), np.ones((5, 3))])
    (edges,) = axes.collections
    assert [len(path.vertices) for path in edges.get_paths()] == [2, 5]


def test_animations_have_frames_and_words(run):
    gaussians = [Gaussian(state, 0.01 * np.eye(12)) for state in run.truth]
    clouds = [Particles(np.tile(state, (20, 1)), np.full(20, -np.log(20))) for state in run.truth]
    for output in (
        plots.animate_run(run, CONSTANTS, alt="It flies.", every=4),
        plots.animate_run(run, CONSTANTS, alt="It flies.", posteriors=gaussians, every=4),
        plots.animate_run(run, CONSTANTS, alt="It flies.", posteriors=clouds, every=4),
        plots.animate_flight(Scene(), run.truth, (4.0, 0.0, 2.0), 0.3, alt="It flies.", beliefs=gaussians, every=4),
    ):
        gif = re.search(r'"data:image/gif;base64,([^"]+)"', output.data)[1]
        assert Image.open(io.BytesIO(base64.b64decode(gif))).n_frames == 4
        assert 'alt="It flies."' in output.data
