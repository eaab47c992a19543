"""A run of T steps: what a world writes and a replay reads."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Run:
    """One recorded experiment of T steps.

    Attributes
    ----------
    truth : ndarray, shape (T + 1, d)
        True states at times 0, 1, ..., T; the world names columns and units.
    observations : ndarray, shape (T, m)
        `observations[k - 1]` is what the sensors said at time k. A missing reading is `inf`.
    controls : ndarray, shape (T, c)
        `controls[k - 1]` acts from time k - 1 to time k.
    """

    truth: np.ndarray
    observations: np.ndarray
    controls: np.ndarray

    def __post_init__(self):
        steps = len(self.observations)
        if len(self.truth) != steps + 1 or len(self.controls) != steps:
            raise ValueError(
                f"a run of {steps} observations needs {steps + 1} true states and {steps} controls, "
                f"got {len(self.truth)} and {len(self.controls)}"
            )

    @property
    def steps(self):
        """Number of steps T."""
        return len(self.observations)


def replay(estimator, run, constants, rng):
    """Run an estimator over a recorded experiment.

    Parameters
    ----------
    estimator : callable
        `Estimator(previous, observation, control, constants, rng) -> posterior`.
    run : Run
        The recorded experiment.
    constants : dataclass
        What the estimator is told.
    rng : numpy.random.Generator
        The estimator's randomness.

    Yields
    ------
    Particles, ndarray, Gaussian, Step or list
        What the estimator returned at times 0, 1, ..., T.
    """
    posterior = estimator(None, None, None, constants, rng)
    yield posterior
    for observation, control in zip(run.observations, run.controls, strict=True):
        posterior = estimator(posterior, observation, control, constants, rng)
        yield posterior
