"""Question 1: positions against the sensors' model, Jacobians against complex steps, and what noise does to both.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, norm

from course_lib.angles import wrap
from course_lib.beacon import geometry, models
from course_lib.beacon.constants import BEARINGS, RANGES, YAW, Constants

FALSE_ALARM = 1e-6
CONSTANTS = Constants(R=8.0, h=5.0)
CORNERS = np.arange(4)

inside = st.tuples(
    st.floats(-3.5, 3.5), st.floats(-3.5, 3.5), st.floats(0.2, 4.8), st.floats(-np.pi, np.pi, exclude_max=True)
)


def state_of(x, y, z, yaw):
    state = np.zeros(12)
    state[[0, 1, 2, YAW]] = x, y, z, yaw
    return state


def readings(x, y, z, yaw):
    """Noiseless ρ (4,), α (4,)."""
    observed = models.observe(state_of(x, y, z, yaw)[None], CONSTANTS)[0]
    return observed[RANGES], observed[BEARINGS]


def position_twin(corner, rho, alpha, a, yaw):
    """The source's equations, number by number; takes complex ones."""
    reach = np.sqrt(rho * rho - (CONSTANTS.h / 2 - a) ** 2)
    sign_x, sign_y = ((1, 1), (-1, 1), (-1, -1), (1, -1))[corner]
    x = sign_x * CONSTANTS.R / 2 - reach * np.cos(yaw + alpha)
    y = sign_y * CONSTANTS.R / 2 - reach * np.sin(yaw + alpha)
    return np.array([x, y, a + 0j * x])


def obstacle_twin(x, y, z, yaw, r, beta):
    return np.array([x + r * np.cos(yaw + beta), y + r * np.sin(yaw + beta), z + 0j * r])


def complex_step(function, arguments, step=1e-30):
    """Jacobian of an analytic function, exact to rounding."""
    columns = []
    for i in range(len(arguments)):
        shifted = np.array(arguments, dtype=complex)
        shifted[i] += 1j * step
        columns.append(function(*shifted).imag / step)
    return np.array(columns).T


@given(inside)
def test_every_corner_leads_back_to_where_the_readings_were_taken(pose):
    rho, alpha = readings(*pose)
    positions = geometry.position(CORNERS, rho, alpha, pose[2], pose[3], CONSTANTS)
    np.testing.assert_allclose(positions, np.tile(pose[:3], (4, 1)), atol=1e-9)


@given(inside, st.integers(0, 3))
def test_position_and_its_jacobian(pose, corner):
    rho, alpha = (column[corner] for column in readings(*pose))
    arguments = (rho, alpha, pose[2], pose[3])
    np.testing.assert_allclose(
        geometry.position(corner, *arguments, CONSTANTS), position_twin(corner, *arguments).real, atol=1e-12
    )
    expected = complex_step(lambda *each: position_twin(corner, *each), arguments)
    np.testing.assert_allclose(
        geometry.position_jacobian(corner, *arguments, CONSTANTS), expected, rtol=1e-8, atol=1e-8
    )


@given(inside, st.floats(0.1, 5.0), st.floats(-np.pi, np.pi))
def test_obstacle_and_its_jacobian(pose, r, beta):
    arguments = (*pose, r, beta)
    np.testing.assert_allclose(geometry.obstacle(pose, r, beta), obstacle_twin(*arguments).real, atol=1e-12)
    expected = complex_step(obstacle_twin, arguments)
    np.testing.assert_allclose(geometry.obstacle_jacobian(pose, r, beta), expected, rtol=1e-8, atol=1e-8)


@given(inside)
def test_horizontal_range_and_its_jacobian(pose):
    rho, _ = readings(*pose)
    beacons = CONSTANTS.beacons[:, :2]
    np.testing.assert_allclose(
        geometry.horizontal_range(rho, pose[2], CONSTANTS.h), np.linalg.norm(beacons - pose[:2], axis=1), rtol=1e-9
    )
    for each in rho:
        expected = complex_step(lambda rho, a: np.sqrt([rho**2 - (2.5 - a) ** 2]), (each, pose[2]))[0]
        np.testing.assert_allclose(
            geometry.horizontal_range_jacobian(each, pose[2], CONSTANTS.h), expected, rtol=1e-8, atol=1e-8
        )


def test_everything_broadcasts():
    rng = np.random.default_rng(41)
    poses = rng.uniform(-3.0, 3.0, (7, 4)) + [0.0, 0.0, 3.0, 0.0]
    rho = rng.uniform(4.0, 6.0, (7, 4))
    a, yaw = poses[:, 2, None], poses[:, 3, None]
    alpha = rng.uniform(-3.0, 3.0, (7, 4))
    together = geometry.position(CORNERS, rho, alpha, a, yaw, CONSTANTS)
    slopes = geometry.position_jacobian(CORNERS, rho, alpha, a, yaw, CONSTANTS)
    points, by_all = geometry.obstacle(poses, 2.0, alpha[:, 0]), geometry.obstacle_jacobian(poses, 2.0, alpha[:, 0])
    assert together.shape == (7, 4, 3) and slopes.shape == (7, 4, 3, 4)
    assert points.shape == (7, 3) and by_all.shape == (7, 3, 6)
    for n in range(7):
        one = (2, rho[n, 2], alpha[n, 2], a[n, 0], yaw[n, 0], CONSTANTS)
        np.testing.assert_allclose(together[n, 2], geometry.position(*one))
        np.testing.assert_allclose(slopes[n, 2], geometry.position_jacobian(*one))
        np.testing.assert_allclose(points[n], geometry.obstacle(poses[n], 2.0, alpha[n, 0]))
        np.testing.assert_allclose(by_all[n], geometry.obstacle_jacobian(poses[n], 2.0, alpha[n, 0]))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("rho", "alpha"), [(np.inf, 0.3), (4.0, np.inf), (np.inf, np.inf), (0.9, 0.3), (1.0, 0.3)])
def test_what_has_no_answer_is_missing(rho, alpha):
    # The vehicle is 1 m below the beacon: a range of 0.9 m cannot be.
    np.testing.assert_array_equal(geometry.position(0, rho, alpha, 1.5, 0.2, CONSTANTS), np.inf)
    assert np.isnan(geometry.position_jacobian(0, rho, alpha, 1.5, 0.2, CONSTANTS)).all()
    assert np.isinf(geometry.horizontal_range([0.9, 1.0, np.inf], 1.5, 5.0)).all()
    assert geometry.horizontal_range(1.25, 1.5, 5.0) == pytest.approx(0.75)


@pytest.mark.filterwarnings("error")
def test_no_obstacle_in_sight():
    np.testing.assert_array_equal(geometry.obstacle(np.zeros(4), np.inf, np.inf), np.inf)
    assert np.isnan(geometry.obstacle_jacobian(np.zeros(4), np.inf, np.inf)).all()


# What is wrong with the source's inversion


@pytest.mark.parametrize(("distance", "share"), [(1.0, 0.003), (0.5, 0.23), (0.2, 0.45)])
def test_how_often_the_root_is_of_a_negative_number(distance, share):
    # 1.5 m above the vehicle, σ_ρ = 0.1 m, σ_a = 0.05 m: the root fails when ρ + n_ρ < 1.5 + n_a.
    rng, n = np.random.default_rng(42), 100_000
    rho = np.hypot(distance, 1.5) + 0.1 * rng.standard_normal(n)
    a = 1.0 + 0.05 * rng.standard_normal(n)
    failed = np.isinf(geometry.horizontal_range(rho, a, 5.0)).sum()
    exact = norm.cdf((1.5 - np.hypot(distance, 1.5)) / np.hypot(0.1, 0.05))
    assert exact == pytest.approx(share, rel=0.15)
    assert binomtest(int(failed), n, exact).pvalue > FALSE_ALARM / 3


@pytest.mark.parametrize(("degrees", "centimetres"), [(2.0, 0.6), (5.0, 3.8), (10.0, 15.0)])
def test_converted_readings_are_biased(degrees, centimetres):
    # E cos(α + n) = cos(α) exp(-σ²/2): at 10 m the mean lies this much nearer to the beacon.
    sigma, n = np.radians(degrees), 400_000
    far = Constants(R=20.0)
    alpha = sigma * np.random.default_rng(43).standard_normal(n)
    x = geometry.position(0, 10.0, alpha, far.h / 2, 0.0, far)[:, 0]
    bias = 10.0 * (1.0 - np.exp(-(sigma**2) / 2))
    assert 100 * bias == pytest.approx(centimetres, rel=0.05)
    # The truth is x = 0, and the mean of n draws has this standard error.
    error = x.std() / np.sqrt(n)
    assert abs(x.mean() - bias) < norm.isf(FALSE_ALARM / 6) * error
    assert bias > 10 * error


def test_the_sign_matters_for_the_far_corners():
    pose = (1.0, -0.5, 2.0, 0.4)
    rho, alpha = readings(*pose)
    wrong = geometry.position(0, rho[1:], alpha[1:], pose[2], pose[3], CONSTANTS)
    assert np.all(np.linalg.norm(wrong - pose[:3], axis=1) > 7.9)


def test_an_obstacle_is_mapped_with_the_covariance_of_its_linearisation():
    # σ of 0.5 % and less: the second order is below a per cent of the first.
    rng, n = np.random.default_rng(44), 200_000
    pose, r, beta = np.array([1.0, -1.0, 2.0, 0.7]), 2.5, -1.1
    sigma = np.array([0.01, 0.01, 0.02, 0.005, 0.01, 0.005])
    noise = sigma * rng.standard_normal((n, 6))
    points = geometry.obstacle(pose + noise[:, :4], r + noise[:, 4], wrap(beta + noise[:, 5]))
    J = geometry.obstacle_jacobian(pose, r, beta)
    expected = (J * sigma**2) @ J.T
    # A sampled covariance scatters by at most √(2 / n) of the variances: 5.5 of these for 6 numbers at FALSE_ALARM.
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(np.cov(points.T) / scale - expected / scale).max() < 5.5 * np.sqrt(2 / n) + 1e-3
