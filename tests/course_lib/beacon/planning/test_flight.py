"""Flights in gusts: the model's noise, every way to end, and the reference planner that arrives."""

import inspect

import numpy as np
import pytest

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.planning import flight, pilot, problem
from course_lib.beacon.planning.obstacles import Scene
from course_lib.beacon.planning.scenes import KINDS, random_scene
from course_lib.filters import Step

CALM = {"k": 0.0, "sigma_v": 0.0, "sigma_w": 0.0}
#: Heavy gusts and poor rotors.
ROUGH = {"k": 0.001, "sigma_v": 0.5, "sigma_w": 0.1}


def hover(previous, belief, state, constants, rng):
    """Stay where the flight began."""
    return quadrotor.fly_to(state, constants.start, constants)


def straight(previous, belief, state, constants, rng):
    """Fly to the goal and look at nothing."""
    return quadrotor.fly_to(state, [*constants.goal, state[5]], constants)


def flown(planner, scene, seed=0):
    return flight.fly(planner, scene, np.random.default_rng([1, seed]), np.random.default_rng([2, seed]))


def test_the_noise_is_that_of_the_motion_model():
    scene = Scene(**ROUGH)
    world, rng = flight.Flight(scene, np.random.default_rng(3)), np.random.default_rng(3)
    state = scene.start_state
    for step in range(20):
        thrusts = quadrotor.hover(scene) + 0.01 * step
        state = models.transition(state[None], thrusts, scene, rng)[0]
        world.act(thrusts)
        np.testing.assert_allclose(world.state, state, atol=1e-12)
    assert not world.over


def test_gusts_are_the_same_however_it_is_flown():
    scene = Scene(**ROUGH)
    rngs = np.random.default_rng(4), np.random.default_rng(4)
    worlds = [flight.Flight(scene, rng) for rng in rngs]
    for _ in range(5):
        worlds[0].act(quadrotor.hover(scene))
        worlds[1].act(np.array([0.0, 6.0, 9.0, -4.0]))
    assert rngs[0].bit_generator.state == rngs[1].bit_generator.state


def test_thrusts_are_cut_to_what_the_rotors_can_do():
    scene = Scene(**CALM)
    worlds = [flight.Flight(scene, np.random.default_rng(5)) for _ in range(2)]
    worlds[0].act(np.array([1e300, -1e300, 7.0, 0.0]))
    worlds[1].act(np.array([6.0, 0.0, 6.0, 0.0]))
    np.testing.assert_array_equal(worlds[0].state, worlds[1].state)
    assert worlds[0].metrics() == worlds[1].metrics()


def test_the_state_it_gives_away_is_a_copy():
    world = flight.Flight(Scene(), np.random.default_rng(6))
    belief, state = world.inputs()
    state[:] = 0.0
    assert belief is None
    np.testing.assert_array_equal(world.inputs()[1], Scene().start_state)


def test_time_runs_out_with_a_line_that_says_so():
    scene = Scene(limit=1.0, **CALM)
    world, track = flown(hover, scene)
    assert (world.over, world.status) == (True, "not arrived")
    assert world.message == "step 20 (1.00 s): time is up, 2.00 m from the goal"
    assert track.shape == (21, 12)


def test_flying_straight_ends_at_the_wall_and_says_which_where_and_when():
    scene = random_scene("window", np.random.default_rng(7))
    world, _ = flown(straight, scene)
    assert world.status == "collided"
    assert world.message.startswith(f"step {world.steps} (")
    assert "flew into obstacle " in world.message
    x, y, _ = world.state[:3]
    assert f"at ({x:.2f}, {y:.2f}, " in world.message
    np.testing.assert_array_equal(world.position(), world.state[:2])


def test_a_thin_wall_between_two_control_instants_is_not_flown_through():
    """At 8 m/s a step is 0.4 m long; the wall is 1 cm thin and the vehicle 4 cm."""
    wall = ((-3.8, -1.0, 0.0, -3.79, 1.0, 4.0),)
    scene = Scene(start=(-4.0, 0.0, 2.0, 0.0), obstacles=wall, radius=0.02, goal=(-3.5, 0.0, 2.0), **CALM)
    world = flight.Flight(scene, np.random.default_rng(8))
    world.state[6] = 8.0
    world.act(quadrotor.hover(scene))
    assert world.status == "collided"
    assert "flew into obstacle 1" in world.message
    assert world.state[0] == pytest.approx(-3.82, abs=2 * flight.TOUCH)
    # 0.18 m at 8 m/s
    assert world.message.startswith("step 1 (0.02 s): ")


@pytest.mark.parametrize(("way", "what"), [(0, "the floor"), (1, "the ceiling")])
def test_rotors_off_or_at_full_thrust_end_at_the_floor_or_ceiling(way, what):
    world, _ = flown(lambda previous, belief, state, constants, rng: np.full(4, 6.0 * way), Scene(**CALM))
    assert world.status == "collided"
    assert f"flew into {what} at " in world.message


def test_a_vehicle_spun_until_its_numbers_overflow_is_said_to_be_out_of_control():
    world = flight.Flight(
        Scene(R=1e9, h=1e9, start=(0.0, 0.0, 5e8, 0.0), goal=(1e6, 0.0, 5e8)), np.random.default_rng(9)
    )
    with np.errstate(all="ignore"):
        world.state[9:12] = 1e200
        world.act(np.array([6.0, 0.0, 0.0, 6.0]))
    assert world.over and world.status in ("lost control", "collided")
    assert world.message.startswith("step 1 (0.05 s): ") or world.message.startswith("step 1 (0.00 s): ")


def test_arriving_is_ok_and_costs_time_and_effort():
    scene = Scene(**CALM)
    world, track = flown(straight, scene)
    assert (world.over, world.status, world.message) == (True, "ok", "")
    assert world.distance() <= scene.goal_radius
    assert world.metrics()["time"] == pytest.approx((len(track) - 1) * scene.Ts)
    hovering = world.metrics()["time"] * float(quadrotor.hover(scene) @ quadrotor.hover(scene))
    assert 0.9 * hovering < world.metrics()["effort"] < 2 * hovering


def test_the_reference_has_the_contracts_parameters():
    assert list(inspect.signature(pilot.Planner).parameters) == ["previous", "belief", "state", "constants", "rng"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_reference_arrives(kind):
    """Fixed seeds, ordinary gusts, heavy ones, and a larger vehicle."""
    for seed, changes in enumerate(({}, ROUGH, {"radius": 0.4})):
        scene = random_scene(kind, np.random.default_rng([10, seed]), Scene(**changes))
        world, _ = flown(pilot.Planner, scene, seed)
        assert world.status == "ok", world.message


def test_in_still_air_the_reference_flies_its_plan_to_rounding():
    scene = random_scene("pillars", np.random.default_rng(11), Scene(R=8.0, sigma_v=1e-3))
    step = pilot.Planner(None, None, scene.start_state, scene, np.random.default_rng(12))
    assert isinstance(step, Step)
    plan, state = step.memory.plan, scene.start_state
    for k in range(len(plan.thrusts)):
        np.testing.assert_allclose(state, plan.states[k], atol=1e-9)
        state = quadrotor.f(state, step.posterior, scene.Ts, scene)
        step = pilot.Planner(step, None, state, scene, np.random.default_rng(12))


def test_the_margin_is_as_many_deviations_of_a_hovering_vehicle_as_it_says():
    """Fixed seeds: 400 vehicles, 4 s: the estimate of a deviation is good to about 4 %; the rest is not linear."""
    scene = Scene()
    n, rng = 400, np.random.default_rng(13)
    still = problem.Plan(np.tile(scene.start_state, (81, 1)), np.tile(quadrotor.hover(scene), (80, 1)), np.ones(80))
    gains = pilot.regulator(still, scene)[0]
    states = np.tile(scene.start_state, (n, 1))
    for _ in range(80):
        error = states - scene.start_state
        error[:, 3:6] = wrap(error[:, 3:6])
        thrusts = quadrotor.hover(scene) - error @ gains.T
        states = np.array([models.transition(x[None], u, scene, rng)[0] for x, u in zip(states, thrusts, strict=True)])
    deviation = states[:, :2].std()
    assert pilot.margin_for(scene) / pilot.SIGMAS == pytest.approx(deviation, rel=0.12)


def test_blown_off_its_way_the_reference_plans_anew():
    scene = random_scene("pillars", np.random.default_rng(14))
    rng = np.random.default_rng(15)
    first = pilot.Planner(None, None, scene.start_state, scene, rng)
    moved = scene.start_state
    moved[:3] += [0.0, 0.0, 0.3]
    second = pilot.Planner(first, None, moved, scene, rng)
    assert second.memory.plan is not first.memory.plan
    np.testing.assert_array_equal(second.memory.plan.states[0], moved)


def test_where_there_is_no_way_the_reference_hovers(monkeypatch):
    monkeypatch.setattr(pilot, "SHARES", (0.0,))
    scene = Scene(
        obstacles=((-0.1, -5.0, 0.0, 0.1, 5.0, 4.0),), start=(-3.0, 0.0, 2.0, 0.0), goal=(3.0, 0.0, 2.0), limit=2.0
    )
    world, track = flown(pilot.Planner, scene)
    assert world.status == "not arrived"
    assert np.linalg.norm(track[-1, :3] - track[0, :3]) < 0.5
