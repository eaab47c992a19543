"""Both planners: twins, plans that replay to the last bit, and rooms in which only one of them arrives."""

import numpy as np
import pytest

from course_lib.beacon.planning import checker, problem, rrt, steering
from course_lib.beacon.planning.obstacles import Scene
from course_lib.beacon.planning.scenes import KINDS, random_scene
from course_lib.beacon.quadrotor import f, hover, parameters
from tests.course_lib.beacon.planning import twins

#: A goal so near that thrusts about hovering arrive soon.
NEAR = Scene(start=(-1.0, 0.0, 2.0, 0.3), goal=(0.5, 0.5, 2.0), goal_radius=0.5)
GENTLE = (2.4, 2.5)


def replayed(plan, scene):
    return all(
        np.array_equal(f(plan.states[k], plan.thrusts[k], plan.durations[k], scene), plan.states[k + 1])
        for k in range(len(plan.durations))
    )


def goal_of(scene):
    return np.array([*scene.goal, problem.DEEP * scene.goal_radius])


def test_the_sources_tree_matches_its_twin():
    for seed in range(2):
        scene = random_scene("pillars", np.random.default_rng([1, seed]))
        plan, nodes = rrt.source_rrt(scene, scene.start_state, np.random.default_rng(seed), 40, GENTLE)
        draws = np.random.default_rng(seed).random((40, rrt.DRAWS))
        expected, _, found = twins.source_rrt(scene, draws, *GENTLE)
        assert found is None and plan is None
        np.testing.assert_allclose(nodes, expected, atol=1e-9)


def test_the_source_arrives_where_nothing_is_in_the_way():
    plan, nodes = rrt.source_rrt(NEAR, NEAR.start_state, np.random.default_rng(2), 20_000, GENTLE)
    assert replayed(plan, NEAR)
    assert len(nodes) > len(plan.states)
    assert np.all((plan.durations >= 0.1) & (plan.durations <= 0.5))
    assert np.all((plan.thrusts >= GENTLE[0]) & (plan.thrusts <= GENTLE[1]))
    report = checker.check(plan, NEAR)
    assert report.sound, report


def test_with_all_that_rotors_can_do_the_sources_nodes_are_not_what_the_vehicle_does():
    """It tumbles faster than the model's steps can follow."""
    plan, seed = None, 0
    while plan is None:
        scene, seed = random_scene("open", np.random.default_rng([3, seed])), seed + 1
        plan, _ = rrt.source_rrt(scene, scene.start_state, np.random.default_rng([3, seed]))
    assert replayed(plan, scene)
    assert checker.check(plan, scene).error > checker.FAITHFUL


def test_a_tree_of_flights_matches_its_twin():
    for seed in range(3):
        scene = random_scene("pillars", np.random.default_rng([4, seed]))
        route, tally = problem.search(scene, scene.start_state, np.random.default_rng(seed), 0.1, 15)
        draws = np.random.default_rng(seed).random((15, steering.DRAWS))
        nodes, parents, steps, arrived = twins.grow(scene, draws, problem.BIAS, goal_of(scene), scene.radius + 0.1)
        assert tally[0] == len(nodes)
        assert (route is not None) == arrived
        if arrived:
            way, node = [], len(nodes) - 1
            while node > 0:
                way.append(steps[node])
                node = parents[node]
            np.testing.assert_array_equal(route.steps, way[::-1])


def test_a_flight_matches_its_twin():
    rng = np.random.default_rng(5)
    outcomes = set()
    for seed in range(12):
        scene = random_scene("clutter", np.random.default_rng([6, seed]))
        goal = goal_of(scene)
        target = np.array([*(goal[:3] if seed % 2 else rng.uniform([-4, -4, 0.5], [4, 4, 3.5])), scene.start[3]])
        states, thrusts = np.empty((41, 12)), np.empty((40, 4))
        states[0] = scene.start_state
        room = np.array([scene.R, scene.h, scene.Ts])
        margin = scene.radius + 0.05
        outcome, row = steering.fly(states, thrusts, 0, 40, target, goal, margin, scene.boxes, room, parameters(scene))
        expected, how = twins.fly(scene.start_state, 40, target, goal, margin, scene)
        outcomes.add(outcome)
        assert (outcome, row) == (how, len(expected) - 1)
        np.testing.assert_allclose(states[: row + 1], expected, atol=1e-9)
    assert outcomes >= {steering.FLEW, steering.COLLIDED}


@pytest.mark.parametrize("kind", KINDS)
def test_every_plan_arrives_replays_and_passes_the_independent_checker(kind):
    """Forty-two rooms, fixed seeds: all are solved, none is flown into anything, in any of them the margin is kept."""
    for seed in range(7):
        scene = random_scene(kind, np.random.default_rng([7, seed]))
        plan = problem.plan(scene, scene.start_state, np.random.default_rng([8, seed]), 0.15, proposals=200)
        assert replayed(plan, scene)
        assert np.all(plan.durations == scene.Ts)
        report = checker.check(plan, scene)
        assert report.sound, report
        assert report.clearance > 0.149


def test_where_the_source_fails_with_any_inputs_the_planner_arrives():
    """Fixed seeds; as many edges for the source as take it longer than the planner needs."""
    for kind in ("windows", "corridor"):
        for seed in range(2):
            scene = random_scene(kind, np.random.default_rng([9, seed]))
            rng = np.random.default_rng([10, seed])
            for inputs in (None, (2.2, 2.7), GENTLE):
                assert rrt.source_rrt(scene, scene.start_state, rng, 10_000, inputs)[0] is None
            assert problem.plan(scene, scene.start_state, rng, proposals=0) is not None


def test_shortening_never_makes_a_plan_longer_and_mostly_much_shorter():
    ratios = []
    for seed in range(3):
        scene = random_scene("clutter", np.random.default_rng([11, seed]))
        start, rng = scene.start_state, np.random.default_rng([12, seed])
        route, _ = problem.search(scene, start, rng, 0.1, 20_000)
        plans = [
            problem.shortened(route, scene, start, np.random.default_rng(13), 0.1, count) for count in (0, 100, 600)
        ]
        durations = [plan.duration for plan in plans]
        assert durations == sorted(durations, reverse=True)
        assert durations[0] == pytest.approx(route.steps.sum() * scene.Ts)
        assert all(checker.check(plan, scene).sound for plan in plans)
        ratios.append(durations[-1] / durations[0])
    assert np.mean(ratios) < 0.6


def test_without_obstacles_the_plan_is_little_slower_than_the_controllers_own_limit():
    """From rest, at the largest acceleration along x and y that the controller asks for: |Δ| = a t² / 2."""
    scene = Scene(start=(-4.0, 0.0, 2.0, 0.0), goal=(4.0, 0.0, 2.0))
    plan = problem.plan(scene, scene.start_state, np.random.default_rng(14), 0.1)
    fastest = np.sqrt(2 * (8.0 - scene.goal_radius) / 3.0)
    assert fastest < plan.duration < 1.4 * fastest


def test_plans_are_drawn_by_their_generator_alone():
    scene = random_scene("window", np.random.default_rng(15))
    first, second = (problem.plan(scene, scene.start_state, np.random.default_rng(16)) for _ in range(2))
    np.testing.assert_array_equal(first.states, second.states)


def test_where_there_is_no_way_there_is_no_plan():
    scene = Scene(obstacles=((-0.1, -5.0, 0.0, 0.1, 5.0, 4.0),), start=(-3.0, 0.0, 2.0, 0.0), goal=(3.0, 0.0, 2.0))
    assert problem.plan(scene, scene.start_state, np.random.default_rng(17), edges=500) is None
    assert rrt.source_rrt(scene, scene.start_state, np.random.default_rng(17), 500, GENTLE)[0] is None


def test_a_plan_from_a_moving_vehicle_begins_there():
    scene = random_scene("pillars", np.random.default_rng(18))
    state = scene.start_state
    state[6:9] = [0.3, -0.2, 0.1]
    plan = problem.plan(scene, state, np.random.default_rng(19), 0.05)
    np.testing.assert_array_equal(plan.states[0], state)
    assert checker.check(plan, scene, state).sound
    assert not checker.check(plan, scene).arrives


def test_hovering_thrusts_are_what_a_plan_at_rest_uses():
    """The first thrusts of any plan sum to no more than the controller may ask for."""
    scene = random_scene("open", np.random.default_rng(20))
    plan = problem.plan(scene, scene.start_state, np.random.default_rng(21))
    assert np.all((plan.thrusts >= 0) & (plan.thrusts <= scene.u_max))
    assert np.abs(plan.thrusts.sum(axis=1) / hover(scene).sum() - 1).max() < 0.5
