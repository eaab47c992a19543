"""The source's collision check and what it misses; the one by speed misses nothing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from course_lib.beacon.planning import collisions
from course_lib.beacon.planning.obstacles import Scene, distances
from course_lib.beacon.planning.scenes import random_scene
from course_lib.beacon.quadrotor import f, parameters
from tests.benchmarks.planar_edges import AGILE, GENTLE, compare
from tests.course_lib.beacon.planning import twins

#: Where a path comes closer than this to touching, both answers are right (m).
GRAZE = 0.01


def circle(t):
    """A metre's circle around the origin in a second, beginning and ending at (1, 0)."""
    return np.array([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t), 0.0])


def to_post(place):
    """Distance from a post at (-1, 0) of radius 0.2."""
    return max(float(np.hypot(place[0] + 1.0, place[1])) - 0.2, 0.0)


def test_the_source_passes_a_full_circle_through_an_obstacle():
    # The chord is nothing, so that nothing is marched.
    assert not collisions.march_by_chord(circle, 1.0, to_post, 0.1)[0]
    assert collisions.march_by_speed(circle, 1.0, to_post, 0.1, speed=2 * np.pi)[0]


def test_d_min_is_no_radius():
    """The march ends where d leads past the end of the chord: how near the end is to an obstacle, nobody asks."""

    def straight(t):
        return np.array([t, 0.0, 0.0])

    def to_post(place):
        """A post at x = 1.1, 0.1 m past the end."""
        return float(abs(place[0] - 1.1))

    assert not collisions.march_by_chord(straight, 1.0, to_post, 0.25)[0]
    assert collisions.march_by_speed(straight, 1.0, to_post, 0.25, speed=1.0)[0]


def test_edges_of_an_agile_vehicle_are_missed_and_of_a_gentle_one_are_not():
    agile, gentle = (compare(family, 2000, np.random.default_rng(1)) for family in (AGILE, GENTLE))
    # Fixed seeds, few edges; the benchmark has many.
    assert 0.01 < agile.missed_by_chord / agile.colliding < 0.2
    assert gentle.missed_by_chord == 0 and gentle.colliding > 20
    assert agile.missed_by_speed == gentle.missed_by_speed == 0
    assert agile.colliding > 20


def random_edge(seed):
    rng = np.random.default_rng(seed)
    scene = random_scene("clutter", rng)
    state = scene.start_state
    state[3:5] = rng.uniform(-0.3, 0.3, 2)
    state[6:9] = rng.normal(0.0, 3.0, 3)
    state[9:12] = rng.normal(0.0, 1.0, 3)
    middle = rng.uniform(-4.0, 4.0, 2)
    state[0:2] = middle
    return scene, state, scene.mass * scene.g / 4 + rng.uniform(-0.3, 0.3, 4), rng.uniform(0.1, 0.5)


def test_the_kernels_match_their_twins():
    for seed in range(15):
        scene, state, u, duration = random_edge(seed)
        told = (scene.boxes, scene.R, scene.h, parameters(scene))
        assert collisions.edge_by_chord(state, u, duration, scene.radius, *told) == twins.edge_by_chord(
            state, u, duration, scene
        )
        kernel = collisions.edge_by_speed(state, u, duration, scene.radius, collisions.TOLERANCE, *told)
        assert kernel[:2] == twins.edge_by_speed(state, u, duration, scene.radius, scene)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_check_by_speed_agrees_with_a_very_fine_one(seed):
    scene, state, u, duration = random_edge(seed)
    told = (scene.boxes, scene.R, scene.h, parameters(scene))
    collides, _, when = collisions.edge_by_speed(state, u, duration, scene.radius, collisions.TOLERANCE, *told)
    path = [state[:3]]
    for _ in range(100):
        state = f(state, u, duration / 100, scene)
        path.append(state[:3])
    gaps = distances(np.array(path), scene) - scene.radius
    if gaps.min() < -GRAZE:
        assert collides and gaps[: int(100 * when / duration)].min(initial=np.inf) > -GRAZE
    if gaps.min() > GRAZE:
        assert not collides and when == duration


@pytest.mark.parametrize("column", [0, 3, 6, 9])
def test_what_is_not_a_number_collides(column):
    scene = Scene()
    state = scene.start_state
    state[column] = np.nan
    told = (scene.boxes, scene.R, scene.h, parameters(scene))
    # One sampling time is enough for NaN to reach the position.
    assert collisions.edge_by_speed(state, np.full(4, 2.0), 0.5, scene.radius, 0.0, *told)[0]
