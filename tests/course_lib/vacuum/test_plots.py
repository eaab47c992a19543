"""What is in the pictures: walls, sensors, robots, units, words."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from course_lib import plotting
from course_lib.filters import Particles, equally_weighted
from course_lib.vacuum import plots
from course_lib.vacuum.constants import Constants, Hidden
from course_lib.vacuum.world import World


@pytest.fixture
def run():
    return World(hidden=Hidden(steps=12)).simulate(np.random.default_rng(0))


@pytest.fixture
def axes():
    figure, axes = plotting.subplots()
    yield axes
    plotting.figure(figure, alt="Drawn, so that drawing cannot fail unseen.")


@pytest.mark.parametrize("length", [1.0, 2.0])
def test_room_shows_walls_sensors_and_units(axes, length):
    constants = Constants(L=4.0, length=length)
    plots.room(axes, constants)
    walls, *sensors = axes.get_lines()
    assert walls.get_xdata().max() == 4.0 * length and walls.get_ydata().max() == 4.0
    np.testing.assert_array_equal([line.get_xydata()[0] for line in sensors], constants.sensors)
    assert [text.get_text() for text in axes.texts] == ["S1 (A)", "S2 (A)", "S3 (B)", "S4 (B)"]
    assert axes.get_xlabel() == "x in m" and axes.get_ylabel() == "y in m"
    # A metre is a metre in both directions.
    assert axes.get_aspect() == 1.0


def test_trajectories_follow_both_robots(axes, run):
    plots.trajectories(axes, run.truth, Constants())
    lines = axes.get_lines()[5:]
    np.testing.assert_array_equal(lines[0].get_xydata(), run.truth[:, :2])
    np.testing.assert_array_equal(lines[2].get_xydata(), run.truth[:, 3:5])


def test_clouds_show_particles_by_their_weight(axes):
    states = np.array([[1.0, 1.0, 0.0, 2.0, 2.0, 0.0], [3.0, 3.0, 0.0, 4.0, 4.0, 0.0], [5.0] * 6])
    particles = Particles(states, np.log(np.array([0.25, 0.75, 1e-12])))
    truth = np.array([0.5, 0.6, 0.0, 4.5, 4.6, 0.0])
    cloud_a, robot_a, cloud_b, robot_b = plots.clouds(axes, particles, truth, Constants(), size=100)
    # `size` is more than there are particles: as many are drawn as there are, in proportion to their weights.
    np.testing.assert_array_equal(np.sort(cloud_a.get_xdata()), [1.0, 3.0, 3.0])
    np.testing.assert_array_equal(np.sort(cloud_b.get_xdata()), [2.0, 4.0, 4.0])
    assert robot_a.get_xydata().tolist() == [[0.5, 0.6]] and robot_b.get_xydata().tolist() == [[4.5, 4.6]]


def test_robots_differ_in_more_than_colour(axes):
    particles = equally_weighted(np.ones((10, 6)))
    cloud_a, _, cloud_b, _ = plots.clouds(axes, particles, np.zeros(6), Constants())
    assert cloud_a.get_marker() != cloud_b.get_marker()


def test_errors_are_drawn_over_seconds(axes):
    plots.errors(axes, {"mine": np.ones(11), "yours": np.zeros(11)}, Ts=0.2)
    mine, yours = axes.get_lines()
    assert mine.get_xdata()[-1] == 2.0
    assert mine.get_linestyle() != yours.get_linestyle()
    assert axes.get_xlabel() == "time in s" and axes.get_ylabel() == "error in m"


def test_animations_have_frames_and_words(run):
    posteriors = [equally_weighted(np.tile(truth, (20, 1))) for truth in run.truth]
    for output in (
        plots.animate_run(run, Constants(), alt="Two robots drive.", every=4),
        plots.animate_clouds(run, posteriors, Constants(), alt="Two clouds follow.", every=4),
    ):
        gif = re.search(r'"data:image/gif;base64,([^"]+)"', output.data)[1]
        assert Image.open(io.BytesIO(base64.b64decode(gif))).n_frames == 4
        assert re.search('alt="Two [a-z ]+."', output.data)
