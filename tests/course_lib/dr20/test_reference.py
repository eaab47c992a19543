"""The reference and its candidates: against plain importance sampling, and over runs of each problem.

Seeds are fixed: every test has one outcome.
"""

from dataclasses import replace

import numpy as np
import pytest

from course_lib.angles import wrap
from course_lib.dr20 import candidates, maps, models, success
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.mcl import pose
from course_lib.dr20.reference import Estimator
from course_lib.dr20.world import World
from course_lib.filters import normalise
from course_lib.recording import replay

BLUNT = Constants(sigma=0.3, p_short=0.1)


def mass(states, weights, truth):
    """How much of a cloud is near the truth."""
    position, heading = success.errors(states, truth)
    return weights[success.near(position, heading)].sum()


@pytest.fixture(scope="module")
def everywhere():
    return candidates.catalogue(BLUNT)


def test_a_catalogue_holds_every_free_pose(everywhere):
    poses, distances = everywhere
    assert distances.shape == (len(poses), 5)
    cells = {tuple(cell) for cell in np.floor(poses[:, :2] / candidates.SPACING).astype(int)}
    for state in models.anywhere(500, BLUNT, np.random.default_rng(0)):
        assert tuple(np.floor(state[:2] / candidates.SPACING).astype(int)) in cells


def test_a_catalogue_of_a_part_holds_no_more(everywhere):
    part = candidates.catalogue(BLUNT, (0.0, 0.0), (1.0, 1.0))
    assert 0 < len(part.poses) < len(everywhere.poses) and part.poses[:, :2].max() < 1.0


@pytest.mark.parametrize("seed", range(3))
def test_candidates_are_a_weighted_sample_of_the_posterior(everywhere, seed):
    """Evidence, and the mass near the truth, as by a million uniform poses."""
    rng = np.random.default_rng(seed)
    truth = models.anywhere(1, BLUNT, rng)
    scan = models.read(models.distances(truth, BLUNT), BLUNT, rng)[0]
    states, log_weights = candidates.draw(40_000, scan, everywhere, BLUNT, rng)
    log_weights, log_evidence = normalise(log_weights)
    assert models.free(states[np.isfinite(log_weights)], BLUNT).all()
    uniform = models.anywhere(1_000_000, BLUNT, rng)
    posterior, expected = normalise(models.log_likelihood(scan, uniform, BLUNT) - np.log(len(uniform)))
    # The catalogue's cells reach a little into the walls, so that its p(x) is 1 / (area of cells), not of what is free.
    share = models.free(
        everywhere.poses + candidates.SPACING * rng.uniform(-0.5, 0.5, everywhere.poses.shape), BLUNT
    ).mean()
    assert log_evidence - np.log(share) == pytest.approx(expected, abs=0.1)
    near = mass(states, np.exp(log_weights), truth[0])
    assert near == pytest.approx(mass(uniform, np.exp(posterior), truth[0]), abs=0.03)


SETTINGS = {
    "local": (Constants(near=(3.5, 2.5), within=1.0), Hidden(steps=60)),
    "global": (Constants(), Hidden(steps=60)),
    "kidnapped": (Constants(kidnap_rate=0.05), Hidden(steps=100, kidnaps=1)),
    "attic": (Constants(room=maps.ATTIC, obstacles=maps.CHIMNEYS, mount=0.1), Hidden(steps=60)),
    "a dead beam": (Constants(kidnap_rate=0.05), Hidden(steps=100, kidnaps=1, dead=(1,))),
    "noisy": (Constants(sigma=0.2, p_short=0.2), Hidden(steps=80)),
}


@pytest.mark.parametrize("setting", SETTINGS)
def test_the_reference_finds_the_robot_and_keeps_it(setting):
    constants, hidden = SETTINGS[setting]
    for seed in range(2):
        run = World(constants, hidden).simulate(np.random.default_rng(seed))
        steps = list(replay(Estimator, run, constants, np.random.default_rng(100 + seed)))
        estimates = np.array([pose(step.posterior) for step in steps])
        recovered = success.recoveries(estimates, run.truth, constants.Ts).recovered
        last = success.judge(estimates[-15:], run.truth[-15:], constants.Ts)
        assert (recovered < 3.0).all() and last.near.all() and np.median(last.position) < 0.1
        assert all(np.isfinite(step.posterior.states).all() for step in steps)


def test_a_twin_room_leaves_two_places():
    """Nothing tells them apart: the posterior must hold both, and about as much of each."""
    constants = Constants(room=maps.TWIN, obstacles=maps.TWIN_PILLARS)
    run = World(constants, Hidden(steps=40)).simulate(np.random.default_rng(3))
    *_, last = replay(Estimator, run, constants, np.random.default_rng(4))
    x, y, heading = run.truth[-1]
    states, weights = last.posterior.states, last.posterior.weights
    here = mass(states, weights, run.truth[-1])
    there = mass(states, weights, np.array([6.0 - x, 4.0 - y, wrap(heading + np.pi)]))
    assert here + there > 0.98 and 0.25 < here < 0.75


def test_it_repeats_by_seed_and_leaves_what_it_is_given():
    constants = Constants(kidnap_rate=0.05)
    run = World(constants, Hidden(steps=30, kidnaps=1)).simulate(np.random.default_rng(5))
    one, two = (
        [step.posterior.states for step in replay(Estimator, run, constants, np.random.default_rng(6))] for _ in "ab"
    )
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)


def test_scans_that_nothing_explains_lose_nothing():
    """Without an outlier's floor in the model every weight may be zero; the cloud then waits."""
    certain = replace(Constants(), p_short=0.0, p_miss=0.0, p_random=0.0)
    step = Estimator(None, None, None, certain, np.random.default_rng(7))
    for scan in ([0.0] * 5, [np.inf] * 5, [1.0, 2.0, np.inf, 0.1, 3.9]):
        step = Estimator(step, np.array(scan), np.array([0.3, 0.1]), certain, np.random.default_rng(8))
        assert np.isfinite(step.posterior.log_weights.max()) and np.isfinite(step.posterior.states).all()
