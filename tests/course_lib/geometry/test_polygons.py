"""Maps of polygons: against shapely on random rings, and a disc's way against the definition by small steps."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from course_lib.geometry.polygons import clearance, fits, inside, reach, walls

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
HOLE = ((1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0))
ISLAND = ((1.5, 1.5), (2.5, 1.5), (2.0, 2.5))


def star(rng, vertices=9):
    """A ring that does not cross itself, about the origin."""
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, vertices))
    radii = rng.uniform(1.0, 5.0, vertices)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def test_walls_go_around_each_ring():
    np.testing.assert_array_equal(walls([((0, 0), (1, 0), (0, 1))]), [[0, 0, 1, 0], [1, 0, 0, 1], [0, 1, 0, 0]])
    assert walls([SQUARE, HOLE, ISLAND]).shape == (11, 4) and walls([]).shape == (0, 4)


@pytest.mark.parametrize("ring", [((0, 0), (1, 1)), ((0, 0), (1, 0), (0, np.nan)), (1, 2, 3), ((0, 0, 0),) * 3])
def test_a_ring_that_is_none_is_refused(ring):
    with pytest.raises(ValueError, match="ring 1 needs at least three vertices"):
        walls([SQUARE, ring])


def test_a_ring_within_a_ring_is_a_hole_and_one_within_that_is_not():
    points = np.array([[0.5, 0.5], [1.2, 1.2], [2.0, 2.0], [5.0, 2.0]])
    np.testing.assert_array_equal(inside(points, walls([SQUARE, HOLE, ISLAND])), [True, False, True, False])


@pytest.mark.parametrize("seed", range(5))
def test_inside_clearance_and_fits_agree_with_shapely(seed):
    rng = np.random.default_rng(seed)
    ring = star(rng)
    points, segments = rng.uniform(-5.0, 5.0, (400, 2)), walls([ring])
    polygon, shapes = shapely.Polygon(ring), shapely.points(points)
    np.testing.assert_array_equal(inside(points, segments), shapely.contains(polygon, shapes))
    np.testing.assert_allclose(clearance(points, segments), shapely.distance(polygon.exterior, shapes), atol=1e-12)
    expected = shapely.contains(polygon, shapes) & (shapely.distance(polygon.exterior, shapes) >= 0.3)
    np.testing.assert_array_equal(fits(points, segments, 0.3), expected)


def test_a_disc_that_touches_a_wall_fits():
    assert fits(np.array([[0.1 + 0.2, 2.0]]), walls([SQUARE]), 0.3).all()


@pytest.mark.parametrize(
    "start, direction, radius, expected",
    [
        ((1.0, 2.0), (1.0, 0.0), 0.5, 2.5),  # straight at a wall
        ((1.0, 2.0), (1.0, 0.0), 0.0, 3.0),
        ((1.0, 2.0), (0.6, 0.8), 0.5, 1.5 / 0.8),
        ((0.5, 2.0), (-1.0, 0.0), 0.5, 0.0),  # touches it, and goes towards it
        ((0.5, 1.0), (0.0, 1.0), 0.5, 2.5),  # slides along it
        ((0.3, 2.0), (1.0, 0.0), 0.5, 3.2),  # leaves a wall it is too near to
        ((0.3, 2.0), (-1.0, 0.0), 0.5, 0.0),
    ],
)
def test_how_far_a_disc_goes_in_a_square(start, direction, radius, expected):
    assert reach(*start, *direction, 10.0, walls([SQUARE]), radius) == pytest.approx(expected, abs=1e-12)
    assert reach(*start, *direction, 0.5 * expected, walls([SQUARE]), radius) == 0.5 * expected


def test_a_disc_meets_a_corner_by_its_rim():
    # Towards a pillar's corner at (1, 1), half a radius beside it: contact where |p - corner| = r.
    pillar = walls([((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0))])
    went = reach(0.0, 0.75, 1.0, 0.0, 10.0, pillar, 0.5)
    assert went == pytest.approx(1.0 - np.sqrt(0.5**2 - 0.25**2), abs=1e-12)
    assert reach(0.0, 0.49, 1.0, 0.0, 10.0, pillar, 0.5) == 10.0


@given(st.integers(0, 10_000), st.floats(0.0, 0.6), st.floats(-np.pi, np.pi))
def test_all_the_way_is_clear_and_no_farther_is(seed, radius, heading):
    rng = np.random.default_rng(seed)
    segments = walls([star(rng), 0.15 * star(rng) + 1.0])
    candidates = rng.uniform(-4.0, 4.0, (200, 2))
    x, y = candidates[np.argmax(clearance(candidates, segments))]
    if clearance(np.array([[x, y]]), segments)[0] < radius + 1e-6:
        return
    dx, dy = np.cos(heading), np.sin(heading)
    went = reach(x, y, dx, dy, 20.0, segments, radius)
    way = np.linspace(0.0, went, 200)
    assert clearance(np.column_stack([x + way * dx, y + way * dy]), segments).min() >= radius - 1e-9
    if went < 20.0:
        assert clearance(np.array([[x + went * dx, y + went * dy]]), segments)[0] == pytest.approx(radius, abs=1e-7)
