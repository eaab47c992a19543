"""Models of the robot on the ground: where it goes, what it reads, and their derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from course_lib.beacon.planar.robot import (
    BIAS,
    Constants,
    log_likelihood,
    motion_jacobians,
    move,
    observation_jacobian,
    observe,
    transition,
)

CONSTANTS = Constants(
    np.array([[3.0, 1.0], [-2.0, 4.0], [0.5, -3.0]]),
    v_scale=0.95,
    omega_scale=0.9,
    omega_offset=-0.002,
    range_scale=1.02,
    range_offset=0.05,
    bearing_offset=0.01,
)
AS_TOLD = Constants(CONSTANTS.landmarks)
STEP = 1e-30


def moved_complex(state, control, noise, constants):
    """`move` of one state in functions that take complex numbers."""
    v, omega, dt = control
    v = constants.v_scale * v + noise[0]
    half = 0.5 * dt * (constants.omega_scale * omega + constants.omega_offset + noise[1])
    sinc = np.sin(half) / half if abs(half) > 0.1 else sum((-1) ** k * half ** (2 * k) / f for k, f in SERIES)
    direction = state[2] + half
    return np.array(
        [
            state[0] + v * dt * sinc * np.cos(direction),
            state[1] + v * dt * sinc * np.sin(direction),
            direction + half,
            state[3],
        ]
    )


#: (2k + 1)! in the series of sin(x)/x.
SERIES = ((0, 1), (1, 6), (2, 120), (3, 5040), (4, 362880), (5, 39916800))


def observed_complex(state, landmark, constants):
    """`observe` of one state and landmark in functions that take complex numbers; the bearing up to a constant."""
    dx, dy = landmark - state[:2]
    distance = np.sqrt(dx * dx + dy * dy)
    if constants.depth:
        distance = dx * np.cos(state[2]) + dy * np.sin(state[2])
    # Away from the axis on which it jumps, the arctangent has the derivative of the direction.
    direction = np.arctan(dy / dx) if abs(dx) > abs(dy) else -np.arctan(dx / dy)
    return np.array(
        [
            constants.range_scale * distance + constants.range_offset + state[3],
            direction - state[2] + constants.bearing_offset,
        ]
    )


def complex_step(function, point):
    """Derivative of a function by the complex step: exact but for rounding."""
    columns = []
    for i in range(len(point)):
        shifted = np.array(point, dtype=complex)
        shifted[i] += STEP * 1j
        columns.append(function(shifted).imag / STEP)
    return np.column_stack(columns)


angles = st.floats(-7.0, 7.0)
rates = st.one_of(st.floats(-3.0, 3.0), st.floats(-1e-6, 1e-6))
positions = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), angles, st.floats(-0.5, 0.5))
controls = st.tuples(st.floats(-1.0, 1.0), rates, st.floats(1e-3, 1.0))


@given(positions, controls)
def test_derivatives_of_the_motion(state, control):
    F_x, F_u = motion_jacobians(np.array(state), control, CONSTANTS)
    by_state = complex_step(lambda state: moved_complex(state, control, (0.0, 0.0), CONSTANTS), state)
    by_noise = complex_step(lambda noise: moved_complex(np.array(state), control, noise, CONSTANTS), (0.0, 0.0))
    np.testing.assert_allclose(F_x, by_state, atol=1e-8)
    np.testing.assert_allclose(F_u, by_noise, atol=1e-8)
    twin = moved_complex(np.array(state), control, (0.0, 0.0), CONSTANTS)
    np.testing.assert_allclose(move(np.array([state]), control, CONSTANTS)[0], twin, atol=1e-12)


@pytest.mark.parametrize("depth", [False, True])
@given(state=positions, row=st.integers(0, 2))
def test_derivatives_of_the_readings(depth, state, row):
    constants = replace(CONSTANTS, depth=depth)
    # At the landmark itself there are none.
    if np.hypot(*(constants.landmarks[row] - state[:2])) < 0.1:
        return
    by_state = complex_step(lambda state: observed_complex(state, constants.landmarks[row], constants), state)
    np.testing.assert_allclose(observation_jacobian(np.array(state), row, constants), by_state, atol=1e-8)
    ranges, _ = observe(np.array([state]), [row], constants)
    assert ranges[0, 0] == pytest.approx(observed_complex(np.array(state), constants.landmarks[row], constants)[0])


def test_a_whole_circle_ends_where_it_began_and_half_a_circle_across():
    start = np.array([[1.0, 2.0, 0.3, 0.0]])
    np.testing.assert_allclose(
        move(start, (0.5, 2.0 * np.pi, 1.0), AS_TOLD), start + [0, 0, 2.0 * np.pi, 0], atol=1e-12
    )
    across = move(np.array([[0.0, 0.0, 0.0, 0.0]]), (1.0, 1.0, np.pi), AS_TOLD)
    np.testing.assert_allclose(across[0, :2], [0.0, 2.0], atol=1e-12)


@given(controls, st.floats(0.01, 0.99))
def test_two_parts_of_a_step_are_the_step(control, share):
    v, omega, dt = control
    start = np.array([[0.2, -0.1, 0.4, 0.1]])
    parts = move(move(start, (v, omega, share * dt), CONSTANTS), (v, omega, (1.0 - share) * dt), CONSTANTS)
    np.testing.assert_allclose(parts, move(start, control, CONSTANTS), atol=1e-12)


def test_noise_of_the_motion_is_white():
    """Ten steps of 0.1 s spread as one of 1 s does. Fixed seed; bounds of five standard deviations of the estimate."""
    constants = replace(AS_TOLD, sigma_v=0.1, sigma_omega=0.2, bias_walk=0.3)
    rng = np.random.default_rng(3)
    states = np.zeros((20_000, 4))
    for _ in range(10):
        states = transition(states, (0.0, 0.0, 0.1), constants, rng)
    spread = states[:, [2, BIAS]].std(axis=0)
    # The estimate of a deviation from n draws has a relative error of 1/√(2n) = 0.005.
    np.testing.assert_allclose(spread, [0.2, 0.3], rtol=0.025)
    # Standing still, the noise of the velocity is a random walk along whatever the heading is.
    assert np.hypot(states[:, 0], states[:, 1]).std() > 0.0
    assert (states[:, :2] ** 2).sum(axis=1).mean() == pytest.approx(0.01, rel=0.06)


def test_what_is_read_where_the_answer_is_plain():
    constants = Constants(np.array([[3.0, 4.0], [0.0, 2.0]]))
    ranges, bearings = observe(np.array([[0.0, 0.0, np.pi / 2.0, 0.1]]), [0, 1], constants)
    np.testing.assert_allclose(ranges, [[5.1, 2.1]])
    np.testing.assert_allclose(bearings, [[np.arctan2(4.0, 3.0) - np.pi / 2.0, 0.0]])
    depths, _ = observe(np.array([[0.0, 0.0, np.pi / 2.0, 0.0]]), [0, 1], replace(constants, depth=True))
    np.testing.assert_allclose(depths, [[4.0, 2.0]])


def reading(constants, rows, ranges, bearings=()):
    count = len(constants.landmarks)
    observation = np.full(2 * count, np.inf)
    observation[rows] = ranges
    observation[count + np.array(rows)[: len(bearings)]] = bearings
    return observation


def test_the_likelihood_is_a_mixture_of_normal_and_uniform():
    states = np.array([[0.0, 0.0, 0.1, 0.0], [0.5, -0.5, 3.0, 0.2]])
    observation = reading(CONSTANTS, [0, 2], [3.0, 3.1], [0.2, -1.2])
    ranges, bearings = observe(states, [0, 2], CONSTANTS)
    normal = norm.pdf([3.0, 3.1], ranges, CONSTANTS.sigma_rho)
    for turns in (-1, 1):
        bearings = np.where(np.abs([0.2, -1.2] - bearings) > np.pi, bearings + turns * 2.0 * np.pi, bearings)
    normal *= norm.pdf([0.2, -1.2], bearings, CONSTANTS.sigma_alpha)
    uniform = 1.0 / (CONSTANTS.range_span * CONSTANTS.bearing_span)
    mixture = (1.0 - CONSTANTS.outliers) * normal + CONSTANTS.outliers * uniform
    np.testing.assert_allclose(log_likelihood(observation, states, CONSTANTS), np.log(mixture).sum(axis=1))


def test_ranges_alone_are_enough_for_a_likelihood():
    states = np.array([[0.0, 0.0, 0.1, 0.0]])
    observation = reading(CONSTANTS, [1], [4.5])
    normal = norm.pdf(4.5, observe(states, [1], CONSTANTS)[0][0, 0], CONSTANTS.sigma_rho)
    mixture = (1.0 - CONSTANTS.outliers) * normal + CONSTANTS.outliers / CONSTANTS.range_span
    np.testing.assert_allclose(log_likelihood(observation, states, CONSTANTS), [np.log(mixture)])


@given(st.floats(-np.pi, np.pi), st.integers(-3, 3))
def test_turns_of_the_heading_change_no_likelihood(heading, turns):
    observation = reading(CONSTANTS, [0, 1], [3.0, 4.0], [3.1, -3.1])
    states = np.array([[0.1, 0.2, heading, 0.0], [0.1, 0.2, heading + 2.0 * np.pi * turns, 0.0]])
    once, again = log_likelihood(observation, states, CONSTANTS)
    assert once == pytest.approx(again, abs=1e-6)


def test_nothing_seen_says_nothing():
    states = np.zeros((5, 4))
    np.testing.assert_array_equal(log_likelihood(np.full(6, np.inf), states, CONSTANTS), np.zeros(5))


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"sigma_rho": 0.0}, "sigma_rho = 0.0"),
        ({"outliers": 1.0}, "outliers = 1.0"),
        ({"delay": -0.1}, "delay = -0.1"),
        ({"v_scale": np.nan}, "v_scale = nan"),
        ({"landmarks": np.zeros(3)}, r"landmarks must have shape \(L, 2\), got \(3,\)"),
    ],
)
def test_constants_that_make_no_sense_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        replace(CONSTANTS, **wrong)
