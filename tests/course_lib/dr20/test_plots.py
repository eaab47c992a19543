"""What is in the pictures: walls, robots, rays, particles, units, words."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from course_lib import plotting
from course_lib.dr20 import maps, models, plots
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.world import World
from course_lib.filters import Particles, equally_weighted


@pytest.fixture
def axes():
    figure, axes = plotting.subplots()
    yield axes
    plotting.figure(figure, alt="Drawn, so that drawing cannot fail unseen.")


def drawn(line):
    """The strokes of a line that NaN separates."""
    points = line.get_xydata()
    return [part[~np.isnan(part[:, 0])] for part in np.split(points, np.flatnonzero(np.isnan(points[:, 0])))]


def test_room_shows_outline_obstacles_and_units(axes):
    constants = Constants(room=maps.ATTIC, obstacles=maps.CHIMNEYS)
    plots.room(axes, constants)
    rings = [patch.get_xy()[:-1] for patch in axes.patches]
    assert [ring.tolist() for ring in rings] == [np.array(r).tolist() for r in (maps.ATTIC, *maps.CHIMNEYS)]
    assert axes.get_xlabel() == "x in m" and axes.get_ylabel() == "y in m"
    # A metre is a metre in both directions, and nothing is cut off.
    assert axes.get_aspect() == 1.0
    assert axes.get_xlim()[0] < constants.bounds[0] and axes.get_ylim()[1] > constants.bounds[3]


def test_a_ring_within_an_obstacle_is_free_again(axes):
    court = (maps.box(2.2, 2.2, 2.8, 3.2), maps.box(2.0, 2.0, 3.0, 3.5))
    plots.room(axes, Constants(obstacles=court))
    outline, obstacle, hole = axes.patches
    assert outline.get_facecolor() == hole.get_facecolor() != obstacle.get_facecolor()
    assert obstacle.get_hatch() and not hole.get_hatch()
    # The smaller one was named first, and is drawn last.
    assert hole.get_xy()[0].tolist() == [2.2, 2.2]


def test_the_robot_has_its_size_and_points_ahead(axes):
    constants = Constants()
    line = plots.robot(axes, (1.0, 3.0, np.pi / 2), constants)
    *disc, centre, ahead = line.get_xydata()
    np.testing.assert_allclose(np.hypot(*(np.array(disc) - [1.0, 3.0]).T), constants.radius)
    np.testing.assert_allclose(centre, [1.0, 3.0])
    assert ahead[0] == pytest.approx(1.0) and ahead[1] > 3.0 + constants.radius


@pytest.mark.parametrize("mount", [0.0, 0.1])
def test_rays_of_a_perfect_scan_end_on_walls(axes, mount):
    constants = Constants(mount=mount)
    pose = np.array([3.6, 2.4, 2.0])
    readings = models.distances(pose[None], constants)[0]
    readings[1] = np.inf
    strokes = [part for part in drawn(plots.scan(axes, pose, readings, constants)) if len(part)]
    assert len(strokes) == 4
    walls = constants.walls
    for start, end in strokes:
        assert np.hypot(*(start - pose[:2])) == pytest.approx(mount)
        on_wall = [
            abs((b - a)[0] * (end - a)[1] - (b - a)[1] * (end - a)[0]) < 1e-9
            and -1e-9 < (end - a) @ (b - a) / ((b - a) @ (b - a)) < 1 + 1e-9
            for a, b in zip(walls[:, :2], walls[:, 2:], strict=True)
        ]
        assert any(on_wall)


def test_the_cloud_shows_particles_by_their_weight_and_heading(axes):
    states = np.array([[1.0, 1.0, 0.0], [3.0, 3.0, np.pi / 2], [5.0, 5.0, 0.0]])
    particles = Particles(states, np.log(np.array([0.25, 0.75, 1e-12])))
    strokes = [part for part in drawn(plots.cloud(axes, particles, size=100)) if len(part)]
    # `size` is more than there are particles: as many are drawn as there are, in proportion to their weights.
    assert [start[0] for start, _ in strokes] == [1.0, 3.0, 3.0]
    np.testing.assert_allclose(
        [end - start for start, end in strokes], plots.TICK * np.array([[1, 0], [0, 1], [0, 1]]), atol=1e-12
    )


def test_ways_are_broken_where_the_robot_is_carried(axes):
    poses = np.array([[1.0, 1.0, 0.0], [1.1, 1.0, 0.0], [4.0, 4.0, 0.0], [4.1, 4.0, 0.0]])
    assert [len(part) for part in drawn(plots.way(axes, poses))] == [2, 2]


def test_headings_are_broken_at_the_seam(axes):
    plots.headings(axes, {"true": np.radians([170.0, 179.0, -179.0, -170.0]), "flat": np.zeros(4)}, Ts=0.5)
    true, flat = axes.get_lines()
    assert [len(part) for part in drawn(true)] == [2, 2]
    assert true.get_xdata()[-1] == 2.0 and true.get_ydata()[-1] == pytest.approx(-170.0)
    assert true.get_linestyle() != flat.get_linestyle()
    assert axes.get_ylabel() == "heading in °"


def test_numbers_are_drawn_over_seconds(axes):
    plots.over_time(axes, {"mine": np.ones(10), "yours": np.full(10, 2.0)}, Ts=0.2, ylabel="error in m")
    mine, yours = axes.get_lines()
    assert mine.get_xdata()[-1] == 2.0
    assert mine.get_linestyle() != yours.get_linestyle()
    assert axes.get_xlabel() == "time in s" and axes.get_ylim()[0] == 0.0


def test_animations_have_frames_and_words():
    constants = Constants()
    run = World(constants, Hidden(steps=12)).simulate(np.random.default_rng(0))
    posteriors = [equally_weighted(np.tile(truth, (20, 1))) for truth in run.truth]
    traces = np.ones(12), np.ones(12), np.zeros(12)
    for output in (
        plots.animate_run(run, constants, alt="A robot drives.", every=4),
        plots.animate_run(run, constants, "A cloud follows.", posteriors, run.truth, traces, every=4),
    ):
        gif = re.search(r'"data:image/gif;base64,([^"]+)"', output.data)[1]
        assert Image.open(io.BytesIO(base64.b64decode(gif))).n_frames == 4
        assert re.search('alt="A [a-z ]+."', output.data)
