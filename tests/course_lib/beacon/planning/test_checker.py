"""The checker finds what is wrong with plans that were tampered with, and agrees with another integrator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from course_lib.beacon.planning import checker, problem
from course_lib.beacon.planning.obstacles import Scene, distances
from course_lib.beacon.planning.scenes import random_scene
from course_lib.beacon.quadrotor import f, hover
from tests.course_lib.beacon import twins

SCENE = random_scene("windows", np.random.default_rng(1))
PLAN = problem.plan(SCENE, SCENE.start_state, np.random.default_rng(2), 0.1, proposals=500)


def test_a_sound_plan_is_called_sound():
    report = checker.check(PLAN, SCENE)
    assert report.sound and not report.collides and report.arrives
    assert report.clearance == pytest.approx(0.1, abs=0.02)
    assert report.error < checker.FAITHFUL


def test_its_integrator_agrees_with_one_that_controls_its_error():
    """DOP853 on the equations of the twins, over the whole plan in one go: errors of the steps add up to little."""
    state = PLAN.states[0]
    for u, duration in zip(PLAN.thrusts, PLAN.durations, strict=True):
        state = solve_ivp(
            lambda _, x, u=u: twins.derivative(x, u, SCENE), (0, duration), state, "DOP853", rtol=1e-7, atol=1e-7
        ).y[:, -1]
    np.testing.assert_allclose(state[:3], PLAN.states[-1, :3], atol=5e-3)
    _, places, ends = checker._fly(PLAN, SCENE)
    exact = solve_ivp(
        lambda _, x: twins.derivative(x, PLAN.thrusts[0], SCENE),
        (0, PLAN.durations[0]),
        PLAN.states[0],
        "DOP853",
        rtol=1e-12,
        atol=1e-12,
    ).y[:, -1]
    np.testing.assert_allclose(ends[0], exact, atol=1e-9)
    np.testing.assert_allclose(places[50], exact[:3], atol=1e-9)


def test_its_distances_agree_with_the_planners():
    times, places, _ = checker._fly(PLAN, SCENE)
    gaps, name = checker._gaps(places, SCENE)
    np.testing.assert_allclose(gaps, distances(places, SCENE), atol=1e-9)
    assert np.all(np.diff(times) >= 0)
    assert name(int(np.argmin(gaps))) == checker.check(PLAN, SCENE).what


def test_a_box_put_in_the_way_is_found_with_its_number_place_and_time():
    middle = len(PLAN.states) // 2
    x, y, z = PLAN.states[middle, :3]
    thin = (x - 0.005, y - 0.005, z - 0.005, x + 0.005, y + 0.005, z + 0.005)
    report = checker.check(PLAN, replace(SCENE, obstacles=(*SCENE.obstacles, thin)))
    assert report.collides and not report.sound
    assert report.what == f"obstacle {len(SCENE.obstacles) + 1}"
    np.testing.assert_allclose(report.place, [x, y, z], atol=0.1)
    assert report.time == pytest.approx(middle * SCENE.Ts, abs=SCENE.Ts)


def test_a_collision_between_the_knots_is_found():
    """At 8 m/s a step of 50 ms is 0.4 m; the wall is between two of them, and the vehicle is small."""
    scene = Scene(
        start=(-4.0, 0.0, 2.0, 0.0),
        obstacles=((-3.82, -1.0, 0.0, -3.78, 1.0, 4.0),),
        radius=0.02,
        goal=(-3.5, 0.0, 2.0),
    )
    start = scene.start_state
    start[6] = 8.0
    states = np.array([start, f(start, hover(scene), scene.Ts, scene)])
    assert np.all(distances(states[:, :3], scene) > scene.radius)
    report = checker.check(problem.Plan(states, hover(scene)[None], np.array([scene.Ts])), scene, start)
    assert report.collides and report.what == "obstacle 1"
    assert report.arrives and report.error < checker.FAITHFUL


@pytest.mark.parametrize(("column", "by"), [(0, 0.01), (5, 0.01), (8, 0.05), (11, 0.1)])
def test_a_state_that_the_vehicle_does_not_reach_is_found(column, by):
    states = PLAN.states.copy()
    states[10, column] += by
    report = checker.check(PLAN._replace(states=states), SCENE)
    assert not report.sound
    assert report.error >= 0.9 * by


def test_angles_a_turn_apart_are_the_same():
    states = PLAN.states.copy()
    states[10:, 5] += 2 * np.pi
    assert checker.check(PLAN._replace(states=states), SCENE).sound


def test_a_plan_cut_short_does_not_arrive():
    half = len(PLAN.thrusts) // 2
    cut = problem.Plan(PLAN.states[: half + 1], PLAN.thrusts[:half], PLAN.durations[:half])
    assert not checker.check(cut, SCENE).arrives


def test_the_room_has_walls_a_floor_and_a_ceiling():
    for axis, sign, what in ((0, 1, "wall"), (1, -1, "wall"), (2, -1, "floor"), (2, 1, "ceiling")):
        scene = Scene(start=(0.0, 0.0, 2.0, 0.0))
        start = scene.start_state
        start[6 + axis] = sign * 30.0
        states = [start]
        for _ in range(8):
            states.append(f(states[-1], hover(scene), scene.Ts, scene))
        plan = problem.Plan(np.array(states), np.tile(hover(scene), (8, 1)), np.full(8, scene.Ts))
        report = checker.check(plan, scene, start)
        assert report.collides and report.what == what
