"""The extended Kalman filter against exact answers, filterpy's own steps and known-bad variants.

Seeds are fixed; with a fresh seed each statistical assertion would fail with the probability FALSE_ALARM.
"""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, multivariate_normal

from course_lib.angles import wrap
from course_lib.filters import Gaussian
from course_lib.filters.extended_kalman import nis, predict, residual, update

FALSE_ALARM = 1e-6

# A point on the circle that drifts; its direction and height are measured: θ, ω; atan2 and sin.
F = np.array([[1.0, 0.1], [0.0, 1.0]])
Q = np.diag([0.01, 0.02]) ** 2
R = np.diag([0.1, 0.05]) ** 2
PRIOR = Gaussian(np.array([3.0, 0.5]), np.diag([0.2, 0.3]) ** 2)


def expected(state):
    return np.array([state[0], np.sin(state[0])])


def slope(state):
    return np.array([[1.0, 0.0], [np.cos(state[0]), 0.0]])


def random_problem(rng, d=4, m=3):
    root = rng.standard_normal((3, max(d, m), max(d, m)))
    spread = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(max(d, m))
    prior = Gaussian(rng.standard_normal(d), spread[0, :d, :d])
    return prior, rng.standard_normal((d, d)), spread[1, :d, :d], rng.standard_normal((m, d)), spread[2, :m, :m]


def run(rng, steps=40, difference=lambda z, h: residual(z, h, angles=[0]), motion=Q, noise=R):
    """NEES of θ, ω after the last step, NIS of each, and the last Gaussian, for one draw of the truth."""
    truth = PRIOR.mean + np.linalg.cholesky(PRIOR.covariance) @ rng.standard_normal(2)
    gaussian, squares = PRIOR, []
    for _ in range(steps):
        truth = F @ truth + np.linalg.cholesky(Q) @ rng.standard_normal(2)
        z = expected(truth) + np.linalg.cholesky(R) @ rng.standard_normal(2)
        z[0] = wrap(z[0])
        gaussian = predict(gaussian, F @ gaussian.mean, F, motion, angles=[0])
        v, H = difference(z, expected(gaussian.mean)), slope(gaussian.mean)
        squares.append(nis(gaussian, v, H, noise))
        gaussian, _ = update(gaussian, v, H, noise, angles=[0])
    error = residual(truth, gaussian.mean, angles=[0])
    return error @ np.linalg.solve(gaussian.covariance, error), np.sum(squares), gaussian


def consistent(**options):
    """Whether sums of NEES and of NIS over 50 runs lie in their central interval; false alarms as FALSE_ALARM."""
    rng = np.random.default_rng(31)
    errors, innovations, _ = zip(*(run(rng, **options) for _ in range(50)), strict=True)
    tails = FALSE_ALARM / 4 * np.array([1, -1]) + [0, 1]
    sums = (np.sum(errors), np.sum(innovations))
    intervals = (chi2(100).ppf(tails), chi2(50 * 80).ppf(tails))
    return all(low < total < high for total, (low, high) in zip(sums, intervals, strict=True))


def test_the_kalman_filter_on_a_linear_problem():
    rng = np.random.default_rng(32)
    gaussian, F, Q, H, R = random_problem(rng)
    kf = KalmanFilter(dim_x=4, dim_z=3)
    kf.x, kf.P, kf.F, kf.Q, kf.H, kf.R = gaussian.mean, gaussian.covariance, F, Q, H, R
    for z in rng.standard_normal((6, 3)):
        kf.predict()
        kf.update(z)
        gaussian = predict(gaussian, F @ gaussian.mean, F, Q)
        gaussian, log_evidence = update(gaussian, z - H @ gaussian.mean, H, R)
        np.testing.assert_allclose(gaussian.mean, kf.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(gaussian.covariance, kf.P, rtol=1e-8, atol=1e-8)
        assert log_evidence == pytest.approx(kf.log_likelihood)


def test_the_mean_of_a_prediction_is_the_models():
    gaussian = predict(PRIOR, np.array([3.5, -1.0]), F, Q, angles=[0])
    np.testing.assert_allclose(gaussian.mean, [3.5 - 2 * np.pi, -1.0])
    np.testing.assert_allclose(gaussian.covariance, F @ PRIOR.covariance @ F.T + Q)


def test_filterpys_own_update_with_functions():
    z = np.array([-3.1, 0.3])
    kf = ExtendedKalmanFilter(2, 2)
    kf.x, kf.P = PRIOR
    kf.update(z, slope, expected, R, residual=lambda z, h: residual(z, h, angles=[0]))
    v = residual(z, expected(PRIOR.mean), angles=[0])
    gaussian, log_evidence = update(PRIOR, v, slope(PRIOR.mean), R)
    np.testing.assert_allclose(gaussian.mean, kf.x, rtol=1e-12)
    np.testing.assert_allclose(gaussian.covariance, kf.P, rtol=1e-12)
    assert log_evidence == pytest.approx(kf.log_likelihood)
    assert nis(PRIOR, v, slope(PRIOR.mean), R) == pytest.approx(kf.mahalanobis**2)


def test_filterpys_predict_update_in_one():
    rng = np.random.default_rng(33)
    gaussian, F, Q, H, R = random_problem(rng)
    z = rng.standard_normal(3)
    kf = ExtendedKalmanFilter(4, 3)
    kf.x, kf.P = gaussian
    kf.F, kf.Q, kf.R = F, Q, R
    kf.predict_update(z, lambda x: H, lambda x: H @ x)
    gaussian = predict(gaussian, F @ gaussian.mean, F, Q)
    gaussian, _ = update(gaussian, z - H @ gaussian.mean, H, R)
    np.testing.assert_allclose(gaussian.mean, kf.x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(gaussian.covariance, kf.P, rtol=1e-9, atol=1e-12)


@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(1, 5))
def test_evidence_is_the_density_of_the_innovation_and_bayes_rule_holds(seed, d, m):
    gaussian, _, _, H, R = random_problem(np.random.default_rng(seed), d, m)
    v = np.random.default_rng(seed + 1).standard_normal(m)
    S = H @ gaussian.covariance @ H.T + R
    posterior, log_evidence = update(gaussian, v, H, R)
    assert log_evidence == pytest.approx(multivariate_normal(cov=S).logpdf(v))
    # p(z) = p(x) p(z | x) / p(x | z) at every x: here at the prior's mean.
    x = gaussian.mean
    joint = multivariate_normal(cov=gaussian.covariance).logpdf(0 * x) + multivariate_normal(cov=R).logpdf(v)
    assert log_evidence == pytest.approx(joint - multivariate_normal(*posterior).logpdf(x), rel=1e-6, abs=1e-6)
    assert nis(gaussian, v, H, R) == pytest.approx(v @ np.linalg.inv(S) @ v)


@given(st.integers(0, 10**6))
def test_order_of_readings_does_not_matter(seed):
    gaussian, _, _, H, R = random_problem(np.random.default_rng(seed))
    R, z = np.diag(np.diag(R)), np.random.default_rng(seed + 1).standard_normal(3)
    whole, log_evidence = update(gaussian, z - H @ gaussian.mean, H, R)
    parts, total = gaussian, 0.0
    for i in (2, 0, 1):
        parts, part = update(parts, z[[i]] - H[[i]] @ parts.mean, H[[i]], R[[i]][:, [i]])
        total += part
    np.testing.assert_allclose(parts.mean, whole.mean, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(parts.covariance, whole.covariance, rtol=1e-6, atol=1e-7)
    assert total == pytest.approx(log_evidence)


def test_covariance_stays_symmetric_and_positive():
    # Variances span fourteen decades.
    gaussian = Gaussian(np.zeros(3), 1e7 * (np.eye(3) + 0.5))
    H, R = np.array([[1.0, 1.0, 0.3], [1.0, -0.5, 0.2]]), 1e-7 * np.eye(2)
    for _ in range(100):
        gaussian, _ = update(gaussian, np.zeros(2), H, R)
        np.testing.assert_array_equal(gaussian.covariance, gaussian.covariance.T)
        assert np.linalg.eigvalsh(gaussian.covariance).min() > 0.0
        gaussian = predict(gaussian, gaussian.mean, np.eye(3), 1e-7 * np.eye(3))


def test_residual_wraps_angles_and_nothing_else():
    np.testing.assert_allclose(residual([3.1, 9.0], [-3.1, 1.0], angles=[0]), [6.2 - 2 * np.pi, 8.0], rtol=1e-12)
    np.testing.assert_allclose(residual([3.1, 9.0], [-3.1, 1.0]), [6.2, 8.0])


def test_mean_is_wrapped_where_it_is_an_angle():
    gaussian = Gaussian(np.array([3.1, 3.1]), np.eye(2))
    posterior, _ = update(gaussian, np.array([0.4, 0.4]), np.eye(2), np.eye(2), angles=[0])
    np.testing.assert_allclose(posterior.mean, [3.3 - 2 * np.pi, 3.3])


def test_no_reading_changes_nothing():
    assert update(PRIOR, np.empty(0), np.empty((0, 2)), np.empty((0, 0))) == (PRIOR, 0.0)
    assert nis(PRIOR, np.empty(0), np.empty((0, 2)), np.empty((0, 0))) == 0.0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_missing_reading_is_the_callers(value):
    with pytest.raises(ValueError, match="leave out the rows"):
        update(PRIOR, np.array([0.1, value]), np.eye(2), R)


@pytest.mark.parametrize("shapes", [((2,), (1, 2), (2, 2)), ((2,), (2, 2), (2,)), ((2, 1), (2, 2), (2, 2))])
def test_shapes_are_checked(shapes):
    with pytest.raises(ValueError, match="the same rows"):
        update(PRIOR, *(np.ones(shape) for shape in shapes))


def test_nothing_is_mutated():
    arrays = [*PRIOR, F, Q, R, slope(PRIOR.mean), np.array([0.1, 0.2])]
    copies = [array.copy() for array in arrays]
    update(predict(PRIOR, PRIOR.mean, F, Q, [0]), arrays[-1], arrays[-2], R, [0])
    for array, copy in zip(arrays, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_filter_is_consistent():
    assert consistent()


@pytest.mark.parametrize(
    "wrong",
    [
        {"difference": np.subtract},
        {"noise": Q, "motion": R},
        {"noise": np.sqrt(R)},
        {"motion": np.sqrt(Q)},
        {"difference": lambda z, h: -residual(z, h, angles=[0])},
        {"motion": np.zeros((2, 2))},
    ],
    ids=["bearing not wrapped", "R and Q swapped", "σ for σ² in R", "σ for σ² in Q", "predicted - observed", "no Q"],
)
def test_the_same_check_rejects_a_wrong_filter(wrong):
    assert not consistent(**wrong)
