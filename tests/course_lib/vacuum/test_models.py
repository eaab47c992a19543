"""Prior, noises and likelihood.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare, kstest, triang

from course_lib.vacuum.constants import Constants
from course_lib.vacuum.models import (
    bounce_noise,
    distances,
    drive,
    log_likelihood,
    prior,
    triangular_density,
    triangular_noise,
)

FALSE_ALARM = 1e-6


# noises


@pytest.mark.parametrize("v_bar", [1.0, 0.2])
def test_bounce_noise_inverts_its_distribution_function(v_bar):
    p = np.linspace(0.0, 1.0, 101)
    v = bounce_noise(p, v_bar)
    np.testing.assert_allclose((v**3 + v_bar**3) / (2 * v_bar**3), p, atol=1e-12)
    np.testing.assert_allclose(v[[0, 50, 100]], [-v_bar, 0.0, v_bar], atol=1e-12)
    np.testing.assert_allclose(v, -v[::-1], atol=1e-12)


def test_bounce_noise_is_quadratic():
    v = bounce_noise(np.random.default_rng(51).random(20_000), 0.8)
    assert kstest(v, lambda v: (v**3 + 0.8**3) / (2 * 0.8**3)).pvalue > FALSE_ALARM


def test_without_bounce_noise_there_is_none():
    np.testing.assert_array_equal(bounce_noise([0.0, 0.3, 1.0], 0.0), 0.0)


def test_triangular_noise_inverts_its_distribution_function():
    p = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose(triangular_noise(p, 0.7), triang(0.5, -0.7, 1.4).ppf(p), atol=1e-12)


def test_triangular_noise_and_density_agree():
    w = triangular_noise(np.random.default_rng(52).random(20_000), 0.7)
    assert kstest(w, triang(0.5, -0.7, 1.4).cdf).pvalue > FALSE_ALARM
    values = np.linspace(-1.0, 1.0, 201)
    np.testing.assert_allclose(triangular_density(values, 0.7), triang(0.5, -0.7, 1.4).pdf(values), atol=1e-12)
    assert triangular_density(0.0, 0.7) == pytest.approx(1.0 / 0.7)


# prior


def test_each_combination_of_corners_is_equally_likely():
    constants = Constants(L=3.0, length=2.0)
    states = prior(20_000, constants, np.random.default_rng(53))
    corner = [
        np.array([(states[:, 3 * robot : 3 * robot + 2] == sensor).all(axis=1) for sensor in constants.sensors])
        for robot in (0, 1)
    ]
    assert corner[0][:2].any(axis=0).all(), "A starts at S1 or S2"
    assert corner[1][2:].any(axis=0).all(), "B starts at S3 or S4"
    counts = [(corner[0][a] & corner[1][b]).sum() for a in (0, 1) for b in (2, 3)]
    assert chisquare(counts).pvalue > FALSE_ALARM


def test_headings_are_uniform_over_the_quarter_that_leads_into_the_room():
    constants = Constants()
    states = prior(20_000, constants, np.random.default_rng(54))
    # As the exercise says of S1: uniform on [π/2, π].
    quarters = {0: np.pi / 2, 1: -np.pi, 2: -np.pi / 2, 3: 0.0}
    for sensor, first in quarters.items():
        robot = sensor // 2
        here = (states[:, 3 * robot : 3 * robot + 2] == constants.sensors[sensor]).all(axis=1)
        heading = states[here, 3 * robot + 2]
        assert kstest(heading, "uniform", args=(first, np.pi / 2)).pvalue > FALSE_ALARM / 4
    assert abs(np.corrcoef(states[:, 2], states[:, 5])[0, 1]) < 5.0 / np.sqrt(20_000)


def test_from_the_prior_robots_drive_off_without_a_bounce():
    constants = Constants(L=4.0, length=1.5)
    states = prior(1000, constants, np.random.default_rng(55))
    for column in (0, 3):
        after = states.copy()
        drive(after, column, np.full(1000, 0.1), *constants.room, 1.0, np.random.default_rng(56))
        heading = states[:, column + 2]
        expected = states[:, column : column + 2] + 0.1 * np.column_stack([np.cos(heading), np.sin(heading)])
        np.testing.assert_allclose(after[:, column : column + 2], expected, atol=1e-12)


# likelihood


def brute_force(observation, states, constants):
    """log f(z | p), one state and one sensor at a time, in the words of the exercise."""
    sensors = [(constants.length * constants.L, 0.0), (constants.length * constants.L, constants.L)]
    sensors += [(0.0, constants.L), (0.0, 0.0)]
    result = []
    for x_a, y_a, _, x_b, y_b, _ in states:
        log = 0.0
        for i, (x, y) in enumerate(sensors):
            if observation[i] == np.inf:
                continue
            to_a = ((x_a - x) ** 2 + (y_a - y) ** 2) ** 0.5
            to_b = ((x_b - x) ** 2 + (y_b - y) ** 2) ** 0.5
            density = 0.0
            for s in (1, 0):
                right = i < 2 if s else i >= 2
                w = observation[i] - (to_a if right else to_b)
                f_w = (constants.w_bar - abs(w)) / constants.w_bar**2 if abs(w) < constants.w_bar else 0.0
                density += f_w * ((1.0 - constants.s_bar) if s else constants.s_bar)
            log += np.log(density) if density > 0.0 else -np.inf
        result.append(log)
    return np.array(result)


def random_states(n, constants, rng):
    return rng.random((n, 6)) * [*constants.room, 1.0, *constants.room, 1.0]


@given(
    st.sampled_from([0.0, 0.1, 0.5, 1.0]),
    st.floats(0.2, 8.0),
    st.floats(0.5, 2.0),
    st.lists(st.booleans(), min_size=4, max_size=4),
    st.integers(0, 2**32 - 1),
)
def test_likelihood_is_the_exercises_equation(s_bar, w_bar, length, reports, seed):
    constants = Constants(s_bar=s_bar, w_bar=w_bar, length=length)
    rng = np.random.default_rng(seed)
    states = random_states(20, constants, rng)
    observation = np.where(reports, rng.uniform(0.0, 6.0, 4), np.inf)
    np.testing.assert_allclose(
        log_likelihood(observation, states, constants), brute_force(observation, states, constants), atol=1e-9
    )


@pytest.mark.parametrize("sensor", range(4))
@pytest.mark.parametrize("s_bar", [0.0, 0.3, 1.0])
def test_likelihood_of_a_sensor_integrates_to_one(sensor, s_bar):
    constants = Constants(s_bar=s_bar, w_bar=0.8)
    state = np.array([[1.0, 2.0, 0.0, 4.0, 0.5, 0.0]])
    # The density is linear between these readings, so that the trapezium rule is exact.
    kinks = np.sort((distances(state, constants)[0, :, sensor, None] + [-0.8, 0.0, 0.8]).ravel())
    observations = np.full((len(kinks), 4), np.inf)
    observations[:, sensor] = kinks
    density = [np.exp(log_likelihood(observation, state, constants)[0]) for observation in observations]
    assert np.trapezoid(density, kinks) == pytest.approx(1.0)


def test_silent_sensors_say_nothing():
    constants = Constants()
    states = random_states(10, constants, np.random.default_rng(57))
    np.testing.assert_array_equal(log_likelihood(np.full(4, np.inf), states, constants), 0.0)
    alone = [np.where(np.arange(4) == i, 3.0, np.inf) for i in range(4)]
    together = log_likelihood(np.full(4, 3.0), states, constants)
    np.testing.assert_allclose(sum(log_likelihood(z, states, constants) for z in alone), together)


def test_when_no_sensor_errs_each_listens_to_its_own_robot():
    constants = Constants(s_bar=0.0, w_bar=6.0)
    rng = np.random.default_rng(58)
    states = random_states(50, constants, rng)
    other_b, other_a = states.copy(), states.copy()
    other_b[:, 3:], other_a[:, :3] = rng.random((2, 50, 3))
    from_a, from_b = np.array([2.0, 3.0, np.inf, np.inf]), np.array([np.inf, np.inf, 2.0, 3.0])
    for observation, irrelevant, relevant in ((from_a, other_b, other_a), (from_b, other_a, other_b)):
        likelihood = log_likelihood(observation, states, constants)
        np.testing.assert_array_equal(log_likelihood(observation, irrelevant, constants), likelihood)
        assert (log_likelihood(observation, relevant, constants) != likelihood).all()


def test_when_all_sensors_err_the_robots_change_places():
    rng = np.random.default_rng(59)
    states = random_states(50, Constants(), rng)
    observation = np.array([2.0, 3.0, 1.0, 4.0])
    np.testing.assert_array_equal(
        log_likelihood(observation, states, Constants(s_bar=1.0, w_bar=5.0)),
        log_likelihood(observation, states[:, [3, 4, 5, 0, 1, 2]], Constants(s_bar=0.0, w_bar=5.0)),
    )


@pytest.mark.filterwarnings("error")
def test_an_impossible_reading_has_no_likelihood():
    states = np.array([[1.0, 1.0, 0.0, 1.0, 1.0, 0.0]])
    assert log_likelihood([50.0, np.inf, np.inf, np.inf], states, Constants()) == -np.inf
    assert log_likelihood([50.0, 4.0, np.inf, 1.0], states, Constants()) == -np.inf


def test_the_heading_says_nothing():
    states = random_states(10, Constants(), np.random.default_rng(60))
    turned = states + [0.0, 0.0, 1.0, 0.0, 0.0, -1.0]
    observation = np.array([3.0, np.inf, 2.0, 3.0])
    np.testing.assert_array_equal(
        log_likelihood(observation, turned, Constants()), log_likelihood(observation, states, Constants())
    )


def test_distances_by_hand():
    state = np.array([[5.0, 3.0, 9.9, 3.0, 4.0, 9.9]])
    expected = [[3.0, 2.0, np.hypot(5, 2), np.hypot(5, 3)], [np.hypot(2, 4), np.hypot(2, 1), np.hypot(3, 1), 5.0]]
    np.testing.assert_allclose(distances(state, Constants())[0], expected)
