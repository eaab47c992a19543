import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course_lib.angles import circular_mean, wrap

angles = st.floats(-1e3, 1e3)


@given(angles)
def test_wrapping_stays_on_the_circle_and_in_the_interval(angle):
    wrapped = wrap(angle)
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)


@given(angles)
def test_wrapping_twice_is_wrapping_once(angle):
    assert wrap(wrap(angle)) == wrap(angle)


def test_wrapping_keeps_the_shape_and_closes_the_interval_on_the_left():
    np.testing.assert_array_equal(wrap([[np.pi, -np.pi], [0.0, 2 * np.pi]]), [[-np.pi, -np.pi], [0.0, 0.0]])


def test_mean_of_headings_either_side_of_the_seam_lies_on_the_seam():
    headings = np.array([np.pi - 0.1, -np.pi + 0.1])
    assert abs(circular_mean(headings, np.array([0.5, 0.5]))) == pytest.approx(np.pi)
    # What an average of numbers makes of it points the other way.
    assert np.mean(headings) == pytest.approx(0.0)


def test_weights_pull_the_mean_and_need_not_be_normalised():
    headings = np.array([0.0, np.pi / 2])
    assert circular_mean(headings, np.array([3.0, 3.0])) == pytest.approx(np.pi / 4)
    assert circular_mean(headings, np.array([1.0, 0.0])) == 0.0
    assert circular_mean(headings, np.array([np.sqrt(3.0), 1.0])) == pytest.approx(np.pi / 6)


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=20), angles)
def test_mean_turns_with_the_headings(spread, turn):
    spread, weights = np.array(spread), np.ones(len(spread))
    turned = circular_mean(wrap(spread + turn), weights)
    assert wrap(turned - turn - circular_mean(spread, weights)) == pytest.approx(0.0, abs=1e-9)


def test_mean_along_either_axis():
    headings = np.array([[np.pi - 0.1, 0.3], [-np.pi + 0.3, 0.5]])
    weights = np.array([0.5, 0.5])
    np.testing.assert_allclose(circular_mean(headings, weights), [-np.pi + 0.1, 0.4])
    np.testing.assert_allclose(circular_mean(headings.T, weights, axis=1), [-np.pi + 0.1, 0.4])
