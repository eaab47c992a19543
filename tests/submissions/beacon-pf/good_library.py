"""The course's predict and update, a kernel at resampling from the Cholesky root, and 4000 particles."""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon.quadrotor import f
from course_lib.filters import (
    Particles,
    covariance,
    effective_sample_size,
    equally_weighted,
    mean,
    predict,
    residual,
    update,
)

N = 4000
TURNS = (3, 4, 5)


def ParticleEstimator(previous, observation, control, constants, rng):
    if previous is None:
        return equally_weighted(first_states(constants, rng))
    particles = smooth(previous, rng)
    particles = predict(particles, lambda states, rng: fly(states, control, constants, rng), rng)
    particles, _ = update(particles, agreement(particles.states, observation[:9], constants))
    return particles


def first_states(c, rng):
    states = rng.standard_normal((N, 12)) * np.repeat(c.start_sigma, (3, 2, 1, 3, 3))
    states[:, [0, 1, 2, 5]] += c.start
    return states


def fly(states, control, c, rng):
    thrusts = rng.normal(control, np.sqrt(c.k * np.abs(control)), (N, 4))
    states = f(states, thrusts, c.Ts, c)
    gusts = np.sqrt(c.Ts) * np.repeat([c.sigma_v, c.sigma_w], 3)
    states[:, 6:] += gusts * rng.standard_normal((N, 6))
    return states


def agreement(states, readings, c):
    """log p(readings | state) but for a constant."""
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    corners = np.column_stack([signs * c.R / 2, np.full(4, c.h / 2)])
    apart = corners[None] - states[:, None, :3]
    expected = np.concatenate(
        [
            np.linalg.norm(apart, axis=2),
            np.arctan2(apart[..., 1], apart[..., 0]) - states[:, [5]],
            states[:, [2]],
        ],
        axis=1,
    )
    missing = ~np.isfinite(readings)
    errors = np.where(missing, 0.0, readings) - expected
    errors[:, 4:8] = wrap(errors[:, 4:8])
    errors[:, missing] = 0.0
    sigmas = np.array(4 * [c.sigma_rho] + 4 * [c.sigma_alpha] + [c.sigma_a])
    return -0.5 * ((errors / sigmas) ** 2).sum(axis=1)


def smooth(particles, rng):
    """Liu and West's kernel, where fewer than half of the particles count."""
    if effective_sample_size(particles) >= N / 2:
        return particles
    centre, spread = mean(particles, TURNS), covariance(particles, TURNS)
    offsets = particles.states - centre
    offsets[:, 3:6] = wrap(offsets[:, 3:6])
    width = (4 / (14 * N)) ** (1 / 16)
    offsets = np.sqrt(1 - width**2) * offsets[residual(particles.weights, rng)]
    noise = rng.multivariate_normal(np.zeros(12), width**2 * spread, N, method="cholesky", check_valid="ignore")
    return Particles(centre + offsets + noise, np.full(N, -np.log(N)))
