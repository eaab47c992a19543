"""Monte Carlo localization with each of its choices. Seeds are fixed: every test has one outcome."""

import numpy as np
import pytest

from course_lib.dr20 import mcl, models, success
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.world import World
from course_lib.filters import equally_weighted, normalise, resample
from course_lib.recording import replay

LOCAL = Constants(near=(3.5, 2.5), within=0.5)


def follow(choices, constants=LOCAL, hidden=None, seed=0):
    """The run, the steps of a localizer along it, and its estimates."""
    run = World(constants, hidden or Hidden(steps=60)).simulate(np.random.default_rng(seed))
    steps = list(replay(mcl.localizer(choices), run, constants, np.random.default_rng(seed + 100)))
    return run, steps, np.array([mcl.pose(step.posterior) for step in steps])


@pytest.mark.parametrize(
    "choices",
    [
        mcl.Choices(spread=2.0),
        mcl.Choices(sensor="field", spread=2.0),
        mcl.Choices(alphas=(0.001, 0.1), spread=2.0),
        mcl.Choices(5000, epsilon=0.02),
    ],
    ids=["beam", "field", "augmented", "KLD"],
)
def test_a_robot_whose_start_is_known_is_followed(choices):
    near = []
    for seed in range(3):
        run, _, estimates = follow(choices, seed=seed)
        near.append(success.judge(estimates, run.truth, LOCAL.Ts).near[30:])
    assert np.mean(near) > 0.95


def test_plain_mcl_is_the_bootstrap_filter():
    run, steps, _ = follow(mcl.Choices(count=300))
    rng = np.random.default_rng(100)
    expected = equally_weighted(models.prior(300, LOCAL, rng))
    for k, (observation, control) in enumerate(zip(run.observations[:10], run.controls, strict=False), 1):
        if k > 1:
            expected = resample(expected, rng)
        states = models.transition(expected.states, control, LOCAL, rng)
        log_weights, _ = normalise(expected.log_weights + models.log_likelihood(observation, states, LOCAL))
        expected = type(expected)(states, log_weights)
        np.testing.assert_array_equal(steps[k].posterior.states, expected.states)
        np.testing.assert_allclose(steps[k].posterior.log_weights, expected.log_weights)


def test_the_augmented_filter_injects_after_a_kidnapping_and_hardly_before():
    hidden = Hidden(steps=120, kidnaps=1)
    constants = Constants(near=(3.5, 2.5), within=0.5, kidnap_rate=0.1)
    run, steps, _ = follow(mcl.Choices(alphas=(0.01, 0.3), spread=3.0), constants, hidden, seed=2)
    at = int(success.kidnapped(run.truth)[0])
    shares = np.array([step.memory.running.share for step in steps[1:]])
    assert shares[at - 20 : at - 1].mean() < 0.1 and shares[at + 3 : at + 10].max() > 0.4


def test_kld_sampling_needs_fewer_when_it_knows_more():
    _, steps, _ = follow(mcl.Choices(8000, epsilon=0.02), Constants(), seed=1)
    counts = [len(step.posterior.states) for step in steps]
    assert counts[0] == 8000 and counts[-1] < 1000 and min(counts) >= 200


def test_a_sensor_model_nobody_has_is_refused():
    with pytest.raises(ValueError, match='sensor must be "beam" or "field"'):
        mcl.Choices(sensor="laser")


def test_scans_that_nothing_explains_lose_nothing():
    certain = Constants(p_short=0.0, p_miss=0.0, p_random=0.0, r_max=10.0)
    for choices in (mcl.Choices(100), mcl.Choices(100, alphas=(0.01, 0.1)), mcl.Choices(300, epsilon=0.05)):
        estimator, rng = mcl.localizer(choices), np.random.default_rng(9)
        step = estimator(None, None, None, certain, rng)
        for scan in ([np.inf] * 5, [1.0, 2.0, 3.0, 0.1, 3.9], [np.inf] * 5):
            step = estimator(step, np.array(scan), np.array([0.3, 0.1]), certain, rng)
            assert np.isfinite(mcl.pose(step.posterior)).all()
