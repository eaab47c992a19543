"""Distances against shapely and plain loops; scenes, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from course_lib.beacon.planning.obstacles import Scene, distances, nearest
from course_lib.beacon.planning.scenes import KINDS, random_scene, solvable
from tests.course_lib.beacon.planning import twins

CLUTTER = random_scene("clutter", np.random.default_rng(1))


def points_in(scene, count, rng):
    return rng.uniform([-scene.R / 2, -scene.R / 2, 0.0], [scene.R / 2, scene.R / 2, scene.h], (count, 3))


@pytest.mark.parametrize("kind", KINDS)
def test_distances_match_a_plain_loop(kind):
    scene = random_scene(kind, np.random.default_rng(2))
    points = points_in(scene, 200, np.random.default_rng(3))
    np.testing.assert_allclose(distances(points, scene), [twins.distance(p, scene) for p in points], atol=1e-12)


@pytest.mark.parametrize("kind", ["pillars", "corridor"])
def test_between_walls_and_pillars_distances_are_those_of_the_plan(kind):
    # Everything stands from floor to ceiling, and these points are farther from both than from a wall or pillar can be.
    scene = replace(random_scene(kind, np.random.default_rng(4)), h=40.0)
    scene = replace(scene, obstacles=tuple((*box[:5], 40.0) for box in scene.obstacles))
    plan = shapely.union_all([shapely.box(x0, y0, x1, y1) for x0, y0, _, x1, y1, _ in scene.obstacles])
    walls = shapely.box(-scene.R / 2, -scene.R / 2, scene.R / 2, scene.R / 2).exterior
    points = points_in(scene, 500, np.random.default_rng(5))
    points[:, 2] = 20.0
    expected = shapely.distance(shapely.union(plan, walls), shapely.points(points[:, :2]))
    np.testing.assert_allclose(distances(points, scene), expected, atol=1e-12)


def test_inside_a_box_the_distance_is_zero_and_outside_the_room_negative():
    scene = Scene(obstacles=((1.0, 1.0, 1.0, 2.0, 2.0, 2.0),))
    np.testing.assert_allclose(
        distances([[1.5, 1.5, 1.5], [5.2, 0.0, 2.0], [0.0, 0.0, -1.0]], scene), [0.0, -0.2, -1.0]
    )


@given(st.integers(0, 2**32 - 1))
def test_a_step_changes_the_distance_by_no_more_than_its_length(seed):
    rng = np.random.default_rng(seed)
    a = points_in(CLUTTER, 20, rng)
    b = a + rng.normal(0.0, 0.5, a.shape)
    change = np.abs(distances(a, CLUTTER) - distances(b, CLUTTER))
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-12)


def test_the_nearest_has_a_name():
    scene = Scene(obstacles=((1.0, 1.0, 1.0, 2.0, 2.0, 2.0), (-2.0, -2.0, 0.0, -1.0, -1.0, 4.0)))
    assert nearest([1.5, 1.5, 2.1], scene) == "obstacle 1"
    assert nearest([-2.1, -1.5, 2.0], scene) == "obstacle 2"
    assert nearest([4.9, 0.0, 2.0], scene) == "a wall"
    assert nearest([0.0, 0.0, 0.1], scene) == "the floor"
    assert nearest([0.0, 0.0, 3.9], scene) == "the ceiling"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"obstacles": ((1.0, 0.0, 0.0, 1.0, 2.0, 2.0),)}, "obstacle 1 = .* must be x0, y0, z0, x1, y1, z1"),
        ({"obstacles": ((0.0, 0.0, 0.0, 1.0, 2.0),)}, "obstacle 1"),
        ({"obstacles": ((-0.5, -0.5, 0.0, 0.5, 0.5, 4.0),)}, "start = .* farther than 0.25 m"),
        ({"goal": (4.9, 0.0, 2.0)}, "goal = .* farther than 0.25 m"),
        ({"goal": (4.0, 0.0)}, "goal = .* three numbers"),
        ({"goal": (float("nan"), 0.0, 2.0)}, "goal = "),
        ({"radius": 0.0}, "radius = 0.0 must be finite and within"),
        ({"R": -1.0}, "R = -1.0 must be"),
    ],
)
def test_a_scene_that_makes_no_sense_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        Scene(**changes)


@pytest.mark.parametrize("kind", KINDS)
def test_scenes_are_drawn_by_their_generator_alone(kind):
    first, second = (random_scene(kind, np.random.default_rng(6)) for _ in range(2))
    assert first == second
    assert first != random_scene(kind, np.random.default_rng(7))


@pytest.mark.parametrize("kind", KINDS)
def test_scenes_keep_what_they_are_given_and_their_ends_free(kind):
    wide = Scene(radius=0.4, sigma_v=0.5)
    for seed in range(10):
        scene = random_scene(kind, np.random.default_rng([8, seed]), wide)
        assert (scene.radius, scene.sigma_v) == (0.4, 0.5)
        assert np.all(distances([scene.start[:3], scene.goal], scene) > 0.4 + 0.3)
        assert np.linalg.norm(np.subtract(scene.start[:3], scene.goal)) > 0.6 * scene.R
        assert all(isinstance(number, float) for box in scene.obstacles for number in box)


def test_a_kind_that_is_not_there_and_a_vehicle_too_large_are_refused():
    with pytest.raises(ValueError, match="no scene of kind 'cave': choose from open, pillars"):
        random_scene("cave", np.random.default_rng(0))
    with pytest.raises(ValueError, match="none can be flown by a vehicle of radius 0.9 m"):
        random_scene(
            "clutter", np.random.default_rng(0), Scene(R=6.0, start=(0.0, 0.0, 2.0, 0.0), goal=(0, 0, 2), radius=0.9)
        )


def wall(gap):
    """A wall across the room with a gap of that width in the middle."""
    walls = ((-0.1, -5.0, 0.0, 0.1, -gap / 2, 4.0), (-0.1, gap / 2, 0.0, 0.1, 5.0, 4.0))
    return Scene(obstacles=walls, start=(-3.0, 0.0, 2.0, 0.0), goal=(3.0, 0.0, 2.0))


def test_solvable_is_sure_when_it_says_yes_and_misses_narrow_gaps_only():
    radius, room = 0.25, 0.2
    for gap in np.arange(0.3, 1.6, 0.05):
        fits = gap > 2 * (radius + room)
        roomy = gap > 2 * (radius + room + 0.1)
        answer = solvable(wall(gap), room)
        assert answer <= fits
        assert answer >= roomy


def test_a_room_without_a_door_is_not_solvable():
    scene = replace(wall(1.0), obstacles=((-0.1, -5.0, 0.0, 0.1, 5.0, 4.0),))
    assert not solvable(scene, 0.0)
