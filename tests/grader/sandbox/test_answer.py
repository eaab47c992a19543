"""What the parent accepts as a posterior, and in what words it refuses the rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from course_lib.filters import Gaussian, Particles
from grader.sandbox.answer import AnswerError, check_posterior


def test_bare_states_become_equally_weighted():
    checked = check_posterior(np.zeros((4, 2)), 2, 10)
    np.testing.assert_allclose(checked.weights, 0.25)


@settings(deadline=None, derandomize=True, max_examples=40)
@given(arrays(np.float64, st.integers(1, 20), elements=st.floats(-1e3, 1e3)))
def test_weights_are_normalised_whatever_their_scale(log_weights):
    checked = check_posterior(Particles(np.zeros((len(log_weights), 3)), log_weights), 3, 100)
    assert checked.weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(np.diff(checked.log_weights), np.diff(log_weights), atol=1e-9)


def test_some_weights_may_be_zero():
    checked = check_posterior(Particles(np.zeros((2, 1)), np.array([-np.inf, 5.0])), 1, 10)
    np.testing.assert_array_equal(checked.weights, [0.0, 1.0])


def test_each_target_of_a_list_is_checked():
    good = [np.zeros((4, 2)), Gaussian(np.zeros(2), np.eye(2))]
    assert [type(target) for target in check_posterior(good, 2, 10)] == [Particles, Gaussian]
    with pytest.raises(AnswerError, match=r"target 1: expected particles of shape \(N, 2\), got \(4, 3\)"):
        check_posterior([np.zeros((4, 2)), np.zeros((4, 3))], 2, 10)


def spoilt(value, row=1):
    array = np.zeros((4, 2))
    array[row, 0] = value
    return array


def weighted(*log_weights):
    return Particles(np.zeros((4, 2)), np.array(log_weights))


def gaussian(mean=(0.0, 0.0), covariance=((1.0, 0.0), (0.0, 1.0))):
    return Gaussian(np.array(mean), np.array(covariance))


@pytest.mark.parametrize(
    ("posterior", "message"),
    [
        (np.zeros((2, 500)), "expected particles of shape (N, 2), got (2, 500): transpose them"),
        (np.zeros((5, 3)), "expected particles of shape (N, 2), got (5, 3)"),
        (np.zeros(2), "expected particles of shape (N, 2), got (2,)"),
        (np.zeros(()), "expected particles of shape (N, 2), got ()"),
        (np.zeros((0, 2)), "expected between 1 and 10 particles, got 0"),
        (np.zeros((11, 2)), "expected between 1 and 10 particles, got 11"),
        (spoilt(np.nan), "the particles hold 1 NaN or infinite numbers, the first in row 1, column 0"),
        (spoilt(np.inf), "the particles hold 1 NaN or infinite numbers, the first in row 1, column 0"),
        (weighted(0.0, 0.0, 0.0), "expected log-weights of shape (4,), got (3,)"),
        (weighted(0.0, np.nan, 0.0, 0.0), "1 of 4 log-weights are NaN"),
        (weighted(np.nan, np.inf, 0.0, 0.0), "1 of 4 log-weights are NaN"),
        (weighted(0.0, np.inf, 0.0, 0.0), "a log-weight is +inf: log-weights are the logarithms of weights"),
        (weighted(*[-np.inf] * 4), "all log-weights are -inf: no particle has any weight"),
        (gaussian(mean=(0.0,)), "expected a Gaussian's mean of shape (2,), got (1,)"),
        (gaussian(covariance=(1.0, 1.0)), "expected a covariance of shape (2, 2), got (2,)"),
        (gaussian(mean=(0.0, np.nan)), "the mean holds 1 NaN or infinite numbers, the first in entry 1"),
        (gaussian(covariance=((1.0, 0.5), (0.0, 1.0))), "the covariance is not symmetric"),
        (gaussian(covariance=((1.0, 0.0), (0.0, -2.0))), "the covariance has a negative eigenvalue, -2"),
        ([], "expected a posterior for each target, got an empty list"),
    ],
)
def test_a_refusal_says_what_was_expected_and_what_came(posterior, message):
    with pytest.raises(AnswerError) as caught:
        check_posterior(posterior, 2, 10)
    assert str(caught.value) == message


@pytest.mark.filterwarnings("error")
def test_extreme_but_finite_numbers_are_no_reason_to_fail():
    check_posterior(Particles(np.full((2, 1), 1e308), np.array([1e308, -1e308])), 1, 10)
    check_posterior(Gaussian(np.full(1, -1e308), np.full((1, 1), 1e308)), 1, 10)
    check_posterior(Gaussian(np.zeros(2), np.zeros((2, 2))), 2, 10)
