"""Monte Carlo localization as the textbook has it, with its choices: which sensor model, augmented, KLD-sampled.

    Estimator = mcl.localizer(mcl.Choices(alphas=(0.001, 0.1)))

References
----------
S. Thrun, W. Burgard, D. Fox, *Probabilistic Robotics*, MIT Press 2005, tables 8.2 to 8.4.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from course_lib.dr20 import field, models
from course_lib.dr20.constants import ANGLES
from course_lib.filters import Particles, Step, equally_weighted, normalise, resample
from course_lib.filters.adaptive import Averages, averages, inject, kld_resample
from course_lib.filters.modes import heaviest

#: Bins of KLD-sampling and of clusters: metres, metres, radians.
BINS = (0.2, 0.2, np.pi / 12)


@dataclass(frozen=True)
class Choices:
    """Which Monte Carlo localization.

    Attributes
    ----------
    count : int
        Particles; the most of them with KLD-sampling.
    sensor : str
        "beam" or "field", the likelihood field.
    alphas : (float, float) or None
        α_slow and α_fast of augmented MCL; None for plain MCL, which injects nothing.
    epsilon : float or None
        ε of KLD-sampling, in nats; None for as many particles in every step.
    least : int
        Fewest particles with KLD-sampling.
    spread : float
        σ, σ_v and σ_ω of the filter are this many times those told. Few particles find a sharp likelihood rarely, and
        lose it easily; 3 is what the assignment advises.
    """

    count: int = 1000
    sensor: str = "beam"
    alphas: tuple[float, float] | None = None
    epsilon: float | None = None
    least: int = 200
    spread: float = 1.0

    def __post_init__(self):
        if self.sensor not in ("beam", "field"):
            raise ValueError(f'sensor must be "beam" or "field", got {self.sensor!r}')


class Memory(NamedTuple):
    """What a localizer remembers beside its posterior.

    Attributes
    ----------
    running : Averages or None
        Of the mean likelihood, once there is one and if anybody asks for it.
    field : Field or None
        The likelihood field of the map.
    """

    running: Averages | None
    field: field.Field | None


def localizer(choices):
    """An `Estimator`.

    Parameters
    ----------
    choices : Choices

    Returns
    -------
    callable
        `Estimator(previous, observation, control, constants, rng)` -> `Step` of `Particles` with columns x, y, θ and
        `Memory`. The posterior is weighted: it is resampled, and random particles injected, at the start of the next
        step.
    """

    def Estimator(previous, observation, control, constants, rng):
        constants = _spread(constants, choices.spread)
        if previous is None:
            known = field.likelihood_field(constants) if choices.sensor == "field" else None
            return Step(equally_weighted(models.prior(choices.count, constants, rng)), Memory(None, known))
        particles, memory = previous
        particles = _renewed(particles, memory.running, choices, constants, rng)
        states = models.transition(particles.states, control, constants, rng)
        if choices.sensor == "field":
            log_likelihood = field.log_likelihood(observation, states, memory.field, constants)
        else:
            log_likelihood = models.log_likelihood(observation, states, constants)
        # w^n ∝ w^n p(z | x^n);  w_avg = Σ_n w^n p(z | x^n)
        log_weights, log_mean = normalise(particles.log_weights + log_likelihood)
        if choices.alphas is not None:
            # The field's likelihood is of the beams that read something: of their number, too, but for this.
            beams = np.isfinite(observation).sum() if choices.sensor == "field" else 1
            memory = memory._replace(running=averages(memory.running, log_mean / max(beams, 1), *choices.alphas))
        # A scan that no particle can explain is left out.
        return Step(Particles(states, log_weights if log_mean > -np.inf else particles.log_weights), memory)

    return Estimator


def pose(posterior):
    """The pose that a cloud speaks for: the mean of its heaviest cluster.

    Parameters
    ----------
    posterior : Particles

    Returns
    -------
    ndarray, shape (3,)
        x and y in metres, θ in radians.
    """
    return heaviest(posterior, BINS, ANGLES).mean


@lru_cache(maxsize=8)
def _spread(constants, factor):
    # Kept, because its walls are computed once for each record.
    return replace(
        constants,
        sigma=factor * constants.sigma,
        sigma_v=factor * constants.sigma_v,
        sigma_omega=factor * constants.sigma_omega,
    )


def _renewed(particles, running, choices, constants, rng):
    """Resampled, when it is time, with random particles among the copies."""
    if choices.epsilon is not None:
        particles = kld_resample(
            particles, rng, BINS, choices.epsilon, least=choices.least, most=choices.count, angles=ANGLES
        )
    else:
        particles = resample(particles, rng, threshold=0.5)
    if running is None or running.share == 0.0:
        return particles
    particles = resample(particles, rng, threshold=1.0)
    return inject(particles, running.share, lambda n, rng: models.anywhere(n, constants, rng), rng)
