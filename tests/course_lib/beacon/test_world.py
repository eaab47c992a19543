"""The simulated flights.

Seeds are fixed; with a fresh one a statistical test would fail with the probability FALSE_ALARM or less.
"""

import numpy as np
import pytest
from scipy.stats import binomtest, kstest

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.constants import ANGLES, RATES, YAW, Constants, Hidden
from course_lib.beacon.world import World

FALSE_ALARM = 1e-6


def simulate(seed=5, constants=None, **hidden):
    return World(constants or Constants(), Hidden(**hidden)).simulate(np.random.default_rng(seed))


def test_shapes_and_limits():
    constants = Constants()
    run = simulate(steps=400)
    assert run.truth.shape == (401, 12) and run.observations.shape == (400, 11) and run.controls.shape == (400, 4)
    assert (np.abs(run.truth[:, :2]) < constants.R / 2).all(), "it stays in the room"
    assert (run.truth[:, 2] > 0.0).all() and (run.truth[:, 2] < constants.h).all()
    assert (run.controls >= 0.0).all() and (run.controls <= constants.u_max).all()
    assert (np.abs(run.truth[:, ANGLES]) <= np.pi).all()


def test_it_flies_about():
    run = simulate(steps=600)
    assert (np.ptp(run.truth[:, :3], axis=0) > [2.0, 2.0, 0.7]).all()
    assert np.ptp(np.unwrap(run.truth[:, YAW])) > 1.0


def test_truth_moves_by_f_and_gusts_of_the_given_strength():
    constants = Constants(k=0.0)
    run = simulate(seed=2, constants=constants, steps=4000)
    expected = np.array(
        [quadrotor.f(x, u, constants.Ts, constants) for x, u in zip(run.truth, run.controls, strict=False)]
    )
    error = run.truth[1:] - expected
    np.testing.assert_allclose(error[:, :3], 0.0, atol=1e-12)
    np.testing.assert_allclose(wrap(error[:, ANGLES]), 0.0, atol=1e-9)
    for column in error[:, RATES].T:
        assert kstest(column / (constants.sigma_w * np.sqrt(constants.Ts)), "norm").pvalue > FALSE_ALARM / 3


def test_sensor_noise_is_normal_independent_and_unbiased():
    constants = Constants()
    run = simulate(seed=3, steps=5000, outage=0.0)
    v = models.innovation(np.zeros(11), -(run.observations[:, :9] - models.observe(run.truth[1:], constants)))
    v /= constants.sigma_z
    for column in v.T:
        assert kstest(column, "norm").pvalue > FALSE_ALARM / 9
    assert np.abs(np.corrcoef(v.T) - np.eye(9)).max() < 6.0 / np.sqrt(5000)


@pytest.mark.parametrize("outage", [0.0, 0.3, 1.0])
def test_ranges_and_bearings_are_missing_as_often_as_told_and_altitude_never(outage):
    run = simulate(steps=2000, outage=outage)
    missing = np.isinf(run.observations[:, :9])
    assert not missing[:, 8].any()
    for column in missing[:, :8].T:
        assert binomtest(int(column.sum()), 2000, outage).pvalue > FALSE_ALARM / 8


def test_a_dead_beacon_is_never_heard_and_the_others_are():
    missing = np.isinf(simulate(dead=(1, 3), outage=0.0).observations[:, :8])
    np.testing.assert_array_equal(missing.all(axis=0), [False, True, False, True] * 2)
    assert not missing[:, [0, 2, 4, 6]].any()


def test_sensors_do_not_touch_the_flight():
    one, other = simulate(), simulate(outage=0.9, bias=(1.0, 0.0, 0.0, 0.0), dead=(2,))
    np.testing.assert_array_equal(one.truth, other.truth)
    ranges = np.array([one.observations[:, 0], other.observations[:, 0]])
    heard = np.isfinite(ranges).all(axis=0)
    np.testing.assert_allclose(ranges[1, heard] - ranges[0, heard], 1.0, atol=1e-12)


def test_a_larger_gain_shakes_the_rotors():
    def roughness(gain):
        run = simulate(gain=gain, steps=1000, constants=Constants(k=0.001, sigma_w=0.0))
        return np.diff(run.truth[:, RATES], axis=0).std()

    assert roughness(9.0) > 1.5 * roughness(1.0)


def test_the_obstacle_sensor_points_at_the_nearest_box_it_can_see():
    constants = Constants(sigma_r=1e-9, sigma_beta=1e-9)
    box, overhead = (2.0, -1.0, 0.0, 3.0, 1.0, 4.0), (-1.0, -1.0, 3.9, 1.0, 1.0, 4.0)
    run = simulate(seed=4, constants=constants, obstacles=(box, overhead), sight=2.5, steps=600, reach=0.3)
    r, beta = run.observations[:, 9:].T
    x, y, yaw = run.truth[1:, [0, 1, YAW]].T
    near_x, near_y = np.clip(x, 2.0, 3.0), np.clip(y, -1.0, 1.0)
    distance = np.hypot(near_x - x, near_y - y)
    seen = np.isfinite(r)
    np.testing.assert_array_equal(seen, distance <= 2.5)
    assert 0.1 < seen.mean() < 0.99
    r, heading = r[seen], (yaw + beta)[seen]
    np.testing.assert_allclose(r, distance[seen], atol=1e-7)
    np.testing.assert_allclose(x[seen] + r * np.cos(heading), near_x[seen], atol=1e-6)
    np.testing.assert_allclose(y[seen] + r * np.sin(heading), near_y[seen], atol=1e-6)
    assert np.isinf(simulate(obstacles=()).observations[:, 9:]).all()


def test_a_seed_is_a_run():
    for part in ("truth", "observations", "controls"):
        np.testing.assert_array_equal(getattr(simulate(7), part), getattr(simulate(7), part))
        assert not np.array_equal(getattr(simulate(7), part), getattr(simulate(8), part))
