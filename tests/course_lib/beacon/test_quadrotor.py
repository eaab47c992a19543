"""The quadrotor's dynamics against rotation matrices, a solver of scipy's, and complex steps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from course_lib.beacon import quadrotor
from course_lib.beacon.constants import ATTITUDE, POSITION, RATES, VELOCITY, YAW, Constants
from tests.course_lib.beacon import twins

CONSTANTS = Constants()
# Nothing in it is symmetric.
LOPSIDED = Constants(mass=1.3, arm=0.25, torque_ratio=0.07, inertia=(0.011, 0.017, 0.023), drag=0.4, g=9.7)
AT_REST = np.array([0.0, 0.0, 2.0] + 9 * [0.0])


def anywhere(seed, size=1):
    """States with tilts up to a radian, any yaw, and thrusts up to the largest."""
    rng = np.random.default_rng(seed)
    states = rng.uniform(-1.0, 1.0, (size, 12)) * np.repeat([5.0, 1.0, 3.0, 4.0], 3)
    states[:, YAW] *= np.pi
    return states, rng.uniform(0.0, CONSTANTS.u_max, (size, 4))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.02, 0.05, 0.12]))
def test_many_states_at_once_move_as_newton_and_euler_say(seed, dt):
    states, thrusts = anywhere(seed, 3)
    expected = [twins.f(state, u, dt, LOPSIDED) for state, u in zip(states, thrusts, strict=True)]
    np.testing.assert_allclose(quadrotor.f(states, thrusts, dt, LOPSIDED), expected, rtol=1e-9, atol=1e-9)


def test_one_state_and_one_control_for_all():
    states, thrusts = anywhere(1, 4)
    single = quadrotor.f(states[0], thrusts[0], 0.05, CONSTANTS)
    assert single.shape == (12,)
    np.testing.assert_array_equal(quadrotor.f(states, thrusts[0], 0.05, CONSTANTS)[0], single)


def test_arguments_stay_as_they_are():
    states, thrusts = anywhere(2, 2)
    before = states.copy(), thrusts.copy()
    quadrotor.f(states, thrusts, 0.1, CONSTANTS)
    quadrotor.jacobians(states[0], thrusts[0], 0.1, CONSTANTS)
    np.testing.assert_array_equal(states, before[0])
    np.testing.assert_array_equal(thrusts, before[1])


def test_steps_are_fine_enough_for_a_solver_of_high_order():
    states, thrusts = anywhere(3, 5)
    for state, u in zip(0.3 * states, CONSTANTS.mass * CONSTANTS.g / 4 + 0.02 * thrusts, strict=True):
        exact = solve_ivp(
            lambda t, x, u=u: twins.derivative(x, u, CONSTANTS), (0.0, 0.5), state, "DOP853", rtol=1e-11, atol=1e-11
        ).y[:, -1]
        np.testing.assert_allclose(quadrotor.f(state, u, 0.5, CONSTANTS), exact, atol=2e-5)


def test_hover_holds_a_vehicle_at_rest():
    np.testing.assert_allclose(quadrotor.f(AT_REST, quadrotor.hover(LOPSIDED), 3.0, LOPSIDED), AT_REST, atol=1e-12)


def test_a_vehicle_without_thrust_falls_and_without_drag_by_half_g_t_squared():
    light = replace(CONSTANTS, drag=0.0)
    fallen = quadrotor.f(AT_REST, np.zeros(4), 0.4, light)
    np.testing.assert_allclose(fallen[[2, 8]], [2.0 - 0.5 * light.g * 0.4**2, -light.g * 0.4])


@pytest.mark.parametrize("rotor, signs", [(0, [0, -1, 1]), (1, [1, 0, -1]), (2, [0, 1, 1]), (3, [-1, 0, -1])])
def test_each_rotor_turns_the_body_its_way(rotor, signs):
    thrusts = quadrotor.hover(CONSTANTS)
    thrusts[rotor] += 0.1
    rates = quadrotor.f(AT_REST, thrusts, 0.001, CONSTANTS)[RATES]
    np.testing.assert_array_equal(np.sign(rates.round(6)), signs)


def test_free_rotation_keeps_angular_momentum_and_energy():
    weightless = replace(LOPSIDED, g=0.0 + 1e-9, drag=0.0)
    state = np.array(9 * [0.0] + [0.8, -0.5, 0.6])
    turned = quadrotor.f(state, np.zeros(4), 1.0, weightless)
    inertia = np.array(LOPSIDED.inertia)

    def momentum(x):
        return twins.rotation(*x[ATTITUDE]) @ (inertia * x[RATES])

    np.testing.assert_allclose(momentum(turned), momentum(state), rtol=1e-5)
    np.testing.assert_allclose(inertia @ turned[RATES] ** 2, inertia @ state[RATES] ** 2, rtol=1e-5)
    assert np.abs(turned[RATES] - state[RATES]).max() > 0.01


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.01, 0.05, 0.13]))
def test_jacobians_are_those_of_complex_steps(seed, dt):
    [state], [u] = anywhere(seed)
    F_x, F_u = quadrotor.jacobians(state, u, dt, LOPSIDED)
    by_state = twins.complex_step(lambda x: twins.f(x, u, dt, LOPSIDED), state)
    by_input = twins.complex_step(lambda v: twins.f(state, v, dt, LOPSIDED), u)
    np.testing.assert_allclose(F_x, by_state, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(F_u, by_input, rtol=1e-8, atol=1e-8)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_the_controller_brings_the_vehicle_to_its_target(seed):
    rng = np.random.default_rng(seed)
    state = AT_REST + np.repeat([2.0, 0.2, 0.5, 0.5], 3) * rng.uniform(-1.0, 1.0, 12)
    target = np.array([*rng.uniform(-2.0, 2.0, 2), rng.uniform(1.0, 3.0), rng.uniform(-np.pi, np.pi)])
    for _ in range(400):
        u = quadrotor.fly_to(state, target, CONSTANTS)
        assert (u >= 0.0).all() and (u <= CONSTANTS.u_max).all()
        state = quadrotor.f(state, u, CONSTANTS.Ts, CONSTANTS)
        assert np.abs(state[3:5]).max() < 0.9
    np.testing.assert_allclose(state[POSITION], target[:3], atol=1e-3)
    np.testing.assert_allclose(np.exp(1j * state[YAW]), np.exp(1j * target[3]), atol=1e-2)
    np.testing.assert_allclose(state[VELOCITY], 0.0, atol=1e-2)


def test_at_its_target_the_controller_hovers():
    np.testing.assert_allclose(
        quadrotor.fly_to(AT_REST, [0.0, 0.0, 2.0, 0.0], CONSTANTS), quadrotor.hover(CONSTANTS), atol=1e-12
    )
