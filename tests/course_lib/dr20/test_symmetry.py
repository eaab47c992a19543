"""Which poses a scan cannot tell apart: symmetric maps, brute force, and a filter against a grid.

Random seeds are fixed, so that every test here has one outcome.
"""

from dataclasses import replace

import numpy as np
import pytest

from course_lib.angles import wrap
from course_lib.dr20 import maps, models, success, symmetry
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.world import World

SHEET = Constants()
TWIN = Constants(room=maps.TWIN, obstacles=maps.TWIN_PILLARS, r_max=8.0)
SQUARE = Constants(room=maps.box(0.0, 0.0, 4.0, 4.0), obstacles=(), r_max=8.0)
#: Beams enough that a scan says it all.
MANY = Constants(room=maps.ATTIC, obstacles=maps.CHIMNEYS, bearings=tuple(np.linspace(-2.0, 2.0, 25)), r_max=10.0)


def coarse(constants):
    return symmetry.pose_grid(constants, spacing=0.1, headings=90)


def turned(pose, centre, turn):
    c, s = np.cos(turn), np.sin(turn)
    x, y = pose[:2] - centre
    return np.array([*(centre + [c * x - s * y, s * x + c * y]), wrap(pose[2] + turn)])


def test_mismatch_matches_its_twin():
    rng = np.random.default_rng(40)
    scan, ranges = rng.uniform(0.0, 4.0, 5), rng.uniform(0.0, 4.0, (200, 5))
    expected = np.minimum((ranges - scan) ** 2 / (2 * 0.3**2), 4.0).sum(axis=1)
    np.testing.assert_allclose(symmetry.mismatch(scan, ranges, 0.3, 4.0), expected)


def test_a_grids_cells_cover_what_is_free():
    grid = coarse(SHEET)
    np.testing.assert_allclose(grid.ranges[::997], np.minimum(models.distances(grid.poses[::997], SHEET), SHEET.r_max))
    cells = {tuple(cell) for cell in np.floor(grid.poses[:, :2] / 0.1 + 1e-9).astype(int)}
    free = models.anywhere(20_000, SHEET, np.random.default_rng(41))
    assert {tuple(cell) for cell in np.floor(free[:, :2] / 0.1).astype(int)} <= cells
    # Free positions make up 17.3 m² of the 25; cells that hold a few of them, a little more.
    assert len(cells) * 0.01 < 20.0 and len(grid.poses) == 90 * len(cells)
    np.testing.assert_allclose(np.diff(grid.poses[:90, 2]), 2 * np.pi / 90)


@pytest.mark.parametrize(
    "constants, centre, turns", [(TWIN, (3.0, 2.0), [np.pi]), (SQUARE, (2.0, 2.0), [-np.pi / 2, np.pi / 2, np.pi])]
)
def test_a_symmetric_map_has_its_partners(constants, centre, turns):
    rng, grid = np.random.default_rng(42), coarse(constants)
    for pose in models.anywhere(6, constants, rng):
        found = symmetry.explanations(pose, grid, constants, rng)
        assert found.count > len(turns)
        np.testing.assert_array_equal(found.poses[0], pose)
        for turn in turns:
            partner = turned(pose, np.array(centre), turn)
            close = success.near(*success.errors(found.poses, partner))
            # The search ends within a fraction of σ of what explains the scan to the last digit.
            assert close.any() and found.log_ratios[close].max() > -0.3


def test_many_beams_in_a_room_without_symmetry_leave_one_place():
    rng, grid = np.random.default_rng(43), coarse(MANY)
    for pose in models.anywhere(5, MANY, rng):
        found = symmetry.explanations(pose, grid, MANY, rng)
        assert found.count == 1 and not len(found.elsewhere)


def test_where_beams_see_nothing_one_place_is_wide():
    blind = replace(SQUARE, r_max=0.5)
    rng, grid = np.random.default_rng(44), symmetry.pose_grid(blind, spacing=0.2, headings=36)
    found = symmetry.explanations([2.0, 2.0, 0.0], grid, blind, rng)
    assert found.count == 1 and len(found.elsewhere) > 100


def test_brute_force_finds_nothing_more():
    rng, grid = np.random.default_rng(45), coarse(SHEET)
    candidates = models.anywhere(300_000, SHEET, rng)
    expected = models.distances(candidates, SHEET)
    accepted = missed = 0
    for pose in models.anywhere(6, SHEET, rng):
        found = symmetry.explanations(pose, grid, SHEET, rng)
        assert found.log_ratios.min() >= -3.0
        exact = models.distances(pose[None], SHEET)[0]
        scan = np.where(exact > SHEET.r_max, np.inf, exact)
        log_likelihood = models.beam_log_likelihood(
            scan,
            expected,
            SHEET.sigma,
            SHEET.r_max,
            SHEET.p_short,
            SHEET.rate_short,
            SHEET.p_miss,
            SHEET.p_random,
        )
        own = models.log_likelihood(scan, pose[None], SHEET)[0]
        for other in candidates[log_likelihood >= own - 3.0]:
            difference = found.poses - other
            difference[:, 2] = wrap(difference[:, 2])
            accepted += 1
            missed += not (np.abs(difference) <= symmetry.APART).all(axis=1).any()
    assert accepted > 20 and missed <= 0.02 * accepted


def test_ambiguity_is_that_of_each_pose():
    rng, grid = np.random.default_rng(46), coarse(TWIN)
    poses = models.anywhere(5, TWIN, rng)
    found = symmetry.ambiguity(poses, grid, TWIN, rng)
    assert found.ambiguous.all() and (found.counts >= 2).all() and found.elsewhere.shape == (5, 3)
    clear = symmetry.ambiguity(models.anywhere(3, MANY, rng), coarse(MANY), MANY, rng)
    assert not clear.ambiguous.any() and (clear.counts == 1).all()


# The filter that is called exact


def test_after_one_scan_it_is_the_grids_posterior():
    # Wide noise, so that a grid is fine enough to be summed.
    constants = replace(SHEET, sigma=0.2)
    grid = symmetry.pose_grid(constants, spacing=0.1, headings=72)
    for seed in range(2):
        run = World(constants, Hidden(steps=4)).simulate(np.random.default_rng(seed))
        log_likelihood = models.log_likelihood(run.observations[0], grid.poses, constants)
        # Cells at a wall count as much as their free part does.
        jittered = grid.poses + grid.spacings * (np.random.default_rng(seed).random((8, len(grid.poses), 3)) - 0.5)
        part = np.mean([models.free(poses, constants) for poses in jittered], axis=0)
        weights = np.exp(log_likelihood - log_likelihood.max()) * part
        weights /= weights.sum()
        expected = weights @ success.near(*success.errors(grid.poses, run.truth[1]))
        mass = symmetry.mass_near_truth(run, grid, constants, np.random.default_rng(seed), steps=1, count=5000)
        assert mass == pytest.approx([expected], abs=0.03)


def test_two_ends_of_a_symmetric_room_share_the_posterior_and_another_room_is_clear():
    grid = symmetry.pose_grid(TWIN)
    for seed in range(2):
        run = World(TWIN, Hidden(steps=20)).simulate(np.random.default_rng(seed))
        mass = symmetry.mass_near_truth(run, grid, TWIN, np.random.default_rng(4), steps=20, count=40_000)
        assert len(mass) == 20 and 0.35 < mass[-1] < 0.65
    run = World(SHEET, Hidden(steps=30, kidnaps=1)).simulate(np.random.default_rng(5))
    (row,) = success.kidnapped(run.truth)
    mass = symmetry.mass_near_truth(run, coarse(SHEET), SHEET, np.random.default_rng(6), row, steps=11, count=20_000)
    assert mass[-1] >= 0.9
