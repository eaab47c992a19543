import numpy as np
import pytest

from course_lib.vacuum.constants import Constants, Hidden


def test_defaults_are_those_of_2015():
    constants = Constants()
    assert (constants.L, constants.Ts, constants.v_bar, constants.w_bar, constants.s_bar) == (5.0, 0.1, 1.0, 1.0, 0.1)
    hidden = Hidden()
    assert (hidden.steps, hidden.shortest_segment, hidden.longest_segment) == (200, 5, 30)
    assert (hidden.slowest, hidden.fastest, hidden.report_probability) == (1.0, 2.0, 0.2)


def test_sensors_stand_in_the_corners_as_in_the_exercise():
    np.testing.assert_array_equal(Constants(L=3.0).sensors, [[3.0, 0.0], [3.0, 3.0], [0.0, 3.0], [0.0, 0.0]])
    np.testing.assert_array_equal(Constants(L=3.0).room, [3.0, 3.0])


def test_the_room_of_2017_is_twice_as_long():
    constants = Constants(L=2.0, length=2.0)
    np.testing.assert_array_equal(constants.room, [4.0, 2.0])
    np.testing.assert_array_equal(constants.sensors, [[4.0, 0.0], [4.0, 2.0], [0.0, 2.0], [0.0, 0.0]])


@pytest.mark.parametrize(
    "values",
    [
        {"L": 0.0},
        {"L": -1.0},
        {"L": np.inf},
        {"Ts": 0.0},
        {"Ts": np.nan},
        {"v_bar": -0.1},
        {"v_bar": 1.1},
        {"w_bar": 0.0},
        {"s_bar": -0.1},
        {"s_bar": 1.1},
        {"length": 0.0},
        {"v_s_bar": -0.1},
        {"v_s_bar": 1.0},
    ],
)
def test_constants_without_meaning_are_refused_by_name(values):
    name, value = next(iter(values.items()))
    with pytest.raises(ValueError, match=f"^{name} = {value} must be finite and within"):
        Constants(**values)


@pytest.mark.parametrize("values", [{"v_bar": 0.0}, {"v_bar": 1.0}, {"s_bar": 0.0}, {"s_bar": 1.0}, {"v_s_bar": 0.99}])
def test_limits_belong_to_the_range(values):
    Constants(**values)


@pytest.mark.parametrize(
    "values",
    [
        {"steps": 0},
        {"shortest_segment": 0},
        {"shortest_segment": 31},
        {"longest_segment": 4},
        {"slowest": -0.1},
        {"slowest": 2.1},
        {"fastest": 0.9},
        {"fastest": np.inf},
        {"report_probability": -0.1},
        {"report_probability": 1.1},
        {"report_probability": np.nan},
    ],
)
def test_hidden_values_without_meaning_are_refused(values):
    with pytest.raises(ValueError, match="must be finite and within"):
        Hidden(**values)


def test_hidden_limits_belong_to_the_range():
    Hidden(steps=1, shortest_segment=7, longest_segment=7, slowest=0.0, fastest=0.0, report_probability=0.0)
    Hidden(slowest=2.0, report_probability=1.0)


def test_a_range_is_told_so_that_it_explains_the_refusal():
    with pytest.raises(ValueError, match=r"v_s_bar = 1.0 must be finite and within \[0, 0.999999999\]"):
        Constants(v_s_bar=1.0)
