"""When a run counts as localized: cases that can be judged by hand."""

import numpy as np
import pytest

from course_lib.dr20 import success
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.world import World

TS = 0.1
TRUTH = np.column_stack([np.linspace(0.0, 3.0, 101), np.ones(101), np.full(101, 3.1)])


def off(*rows, by=(1.0, 0.0, 0.0)):
    """The truth as the estimate, but for these rows."""
    estimates = TRUTH.copy()
    estimates[np.r_[rows]] += by
    return estimates


def test_the_truth_converges_at_once():
    judgement = success.judge(TRUTH, TRUTH, TS)
    assert judgement.converged == 0.0 and judgement.kept == 1.0 and judgement.success
    assert judgement.position.max() == 0.0 and judgement.heading.max() == 0.0


def test_errors_are_distances_and_angles_on_the_circle():
    position, heading = success.errors([[3.0, 5.0, 3.1], [0.0, 0.0, 9.0]], [[0.0, 1.0, -3.1], [0.0, 0.0, -3.0]])
    np.testing.assert_allclose(position, [5.0, 0.0])
    assert heading == pytest.approx([2 * np.pi - 6.2, 4 * np.pi - 12.0])


@pytest.mark.parametrize(
    "by, is_near",
    [
        ((0.299, 0.0, 0.0), True),
        ((0.22, 0.22, 0.0), False),
        ((0.0, 0.0, np.radians(14.9)), True),
        ((0.0, 0.0, -np.radians(15.1)), False),
        ((0.0, 0.0, 2 * np.pi), True),
        ((np.nan, 0.0, 0.0), False),
        ((0.0, 0.0, np.inf), False),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_near_is_near_in_position_and_in_heading(by, is_near):
    assert success.judge(TRUTH + by, TRUTH, TS).near.all() == is_near


def test_convergence_is_followed_by_a_second():
    assert success.judge(off(*range(30)), TRUTH, TS).converged == pytest.approx(3.0)
    # Near in rows 20 to 29 is nine tenths of a second; in rows 20 to 30 it is one.
    assert success.judge(off(*range(20), *range(30, 40)), TRUTH, TS).converged == pytest.approx(4.0)
    assert success.judge(off(*range(20), *range(31, 40)), TRUTH, TS).converged == pytest.approx(2.0)


def test_what_comes_too_late_to_be_seen_has_not_converged():
    assert success.judge(off(*range(90)), TRUTH, TS).success
    judgement = success.judge(off(*range(91)), TRUTH, TS)
    assert judgement.converged == np.inf and judgement.kept == 0.0 and not judgement.success
    assert success.judge(TRUTH[:5], TRUTH[:5], TS).converged == np.inf


def test_success_is_near_at_the_end_and_for_nine_tenths_of_the_time():
    assert success.judge(off(*range(50, 60)), TRUTH, TS).success
    judgement = success.judge(off(*range(50, 61)), TRUTH, TS)
    assert judgement.kept == pytest.approx(90 / 101) and judgement.converged == 0.0 and not judgement.success
    assert not success.judge(off(100), TRUTH, TS).success


def test_sampling_time_is_that_of_the_run():
    assert success.judge(off(*range(30)), TRUTH, 0.5).converged == pytest.approx(15.0)
    # A second is two steps of half a second.
    assert success.judge(off(*range(98)), TRUTH, 0.5).converged == pytest.approx(49.0)
    assert success.judge(off(*range(99)), TRUTH, 0.5).converged == np.inf


def test_recoveries_by_hand():
    truth = TRUTH.copy()
    truth[20:, 1] += 3.0
    truth[60:, 1] -= 2.5
    truth[95:, 1] += 2.0
    estimates = truth.copy()
    estimates[20:35, 1] -= 3.0
    estimates[60:95, 0] += 1.0
    found = success.recoveries(estimates, truth, TS)
    np.testing.assert_array_equal(success.kidnapped(truth), [20, 60, 95])
    np.testing.assert_allclose(found.at, [1.9, 5.9, 9.4])
    # Found in the 16th pose after it was carried away; never; too near to the end to tell.
    np.testing.assert_allclose(found.recovered, [1.6, np.inf, np.inf])
    np.testing.assert_allclose(found.watched, [4.0, 3.5, 0.6])


def test_a_run_without_kidnappings_has_no_recoveries():
    found = success.recoveries(TRUTH, TRUTH, TS)
    assert all(len(part) == 0 for part in found)


def test_the_worlds_kidnappings_are_found():
    for seed in range(5):
        hidden = Hidden(steps=120, kidnaps=3)
        run = World(Constants(), hidden).simulate(np.random.default_rng(seed))
        found = success.recoveries(run.truth, run.truth, Constants().Ts)
        assert len(found.at) == 3
        np.testing.assert_allclose(found.recovered, 0.1)


def test_poses_that_do_not_match_are_refused():
    with pytest.raises(ValueError, match="a pose .* for each true one"):
        success.judge(TRUTH[1:], TRUTH, TS)
