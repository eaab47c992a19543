import numpy as np
import pytest

from course_lib.beacon.constants import Constants, Hidden


def test_beacons_stand_in_the_corners_at_half_height():
    constants = Constants(R=6.0, h=3.0)
    np.testing.assert_array_equal(
        constants.beacons, [[3.0, 3.0, 1.5], [-3.0, 3.0, 1.5], [-3.0, -3.0, 1.5], [3.0, -3.0, 1.5]]
    )


def test_deviations_are_in_the_order_of_an_observation():
    constants = Constants(sigma_rho=1.0, sigma_alpha=2.0, sigma_a=3.0)
    np.testing.assert_array_equal(constants.sigma_z, [1.0] * 4 + [2.0] * 4 + [3.0])


@pytest.mark.parametrize(
    "values",
    [{"R": 0.0}, {"h": -1.0}, {"Ts": np.nan}, {"mass": 0.0}, {"sigma_rho": 0.0}, {"k": -1.0}, {"u_max": np.inf}],
)
def test_constants_without_meaning_are_refused_by_name(values):
    name, value = next(iter(values.items()))
    with pytest.raises(ValueError, match=f"^{name} = {value} must be finite and within"):
        Constants(**values)


@pytest.mark.parametrize("values", [{"inertia": (1.0, 1.0)}, {"start": (0.0, 0.0, np.nan, 0.0)}, {"start_sigma": ()}])
def test_tuples_of_the_wrong_length_or_without_numbers_are_refused(values):
    with pytest.raises(ValueError, match=f"^{next(iter(values))} = .* must be [345] finite numbers"):
        Constants(**values)


@pytest.mark.parametrize(
    "values", [{"steps": 0}, {"reach": 1.1}, {"outage": -0.1}, {"gain": np.nan}, {"interval": 0.0}]
)
def test_hidden_values_without_meaning_are_refused(values):
    with pytest.raises(ValueError, match="must be finite and within"):
        Hidden(**values)
