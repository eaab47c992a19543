"""Particles that stand for a Gaussian where a metric wants particles."""

import numpy as np
import pytest

from course_lib.filters import Gaussian
from grader.grading.evaluate import GAUSSIAN_DRAWS, as_particles

ROOT = np.random.default_rng(3).normal(size=(4, 4))
COVARIANCE = ROOT @ ROOT.T


def draws(mean=(1.0, -2.0, 3.0, 0.5), covariance=COVARIANCE, angles=(), seed=5):
    particles = as_particles(Gaussian(np.array(mean), np.array(covariance)), angles, 0, np.random.default_rng(seed))
    assert np.allclose(particles.weights, 1.0 / GAUSSIAN_DRAWS)
    return particles.states


def test_draws_have_the_gaussians_mean_and_over_many_its_covariance():
    states = np.concatenate([draws(seed=seed) for seed in range(200)])
    np.testing.assert_allclose(draws().mean(axis=0), [1.0, -2.0, 3.0, 0.5], atol=1e-12)
    # 50 000 independent pairs: each entry's standard deviation is at most 1.5e-2 of the variances; the seeds are fixed.
    scale = np.sqrt(np.outer(np.diag(COVARIANCE), np.diag(COVARIANCE)))
    assert np.all(np.abs(np.cov(states.T) - COVARIANCE) < 0.03 * scale)


def test_angles_are_wrapped_and_the_rest_is_not():
    plain, wrapped = draws(mean=(0.0, 3.0, 9.0, 0.0)), draws(mean=(0.0, 3.0, 9.0, 0.0), angles=(1,))
    assert np.abs(plain[:, 1]).max() > np.pi >= np.abs(wrapped[:, 1]).max() and wrapped[:, 2].max() > np.pi
    np.testing.assert_allclose(np.exp(1j * wrapped[:, 1]), np.exp(1j * plain[:, 1]), atol=1e-12)
    np.testing.assert_array_equal(wrapped[:, [0, 2, 3]], plain[:, [0, 2, 3]])


@pytest.mark.parametrize("covariance", [np.eye(4), COVARIANCE])
def test_gaussians_that_differ_little_are_stood_for_by_draws_that_differ_little(covariance):
    """So that a difference of two filters' scores is theirs, and not that of their draws."""
    rng = np.random.default_rng(9)
    noise = rng.normal(size=(4, 4))
    near = covariance + 1e-4 * (noise @ noise.T)
    assert np.abs(draws(covariance=near) - draws(covariance=covariance)).max() < 1e-2


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("covariance", [np.zeros((4, 4)), np.diag([1.0, 0.0, -1e-12, 2.0]), np.full((4, 4), 1e308)])
def test_no_covariance_that_was_accepted_stops_it(covariance):
    states = draws(covariance=covariance)
    assert states.shape == (GAUSSIAN_DRAWS, 4) and not np.isnan(states[:, 0]).any()
