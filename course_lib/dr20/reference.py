"""The reference `Estimator` of the DR20's three assignments: which problem it is, the constants say.

Monte Carlo localization by the beam model. A kidnapping is part of the model: with the probability told, a robot is
anywhere in the next step. What explains a scan best among all poses is looked up in a catalogue (`candidates`) whenever
the cloud does not explain it as well as it used to, and competes with the cloud by weight: no averages have to be
watched, and no share of particles is given up while all is well.
"""

from typing import NamedTuple

import numpy as np

from course_lib.angles import wrap
from course_lib.dr20 import candidates, models
from course_lib.dr20.constants import ANGLES, HEADING
from course_lib.filters import Particles, Step, effective_sample_size, equally_weighted, normalise, systematic
from course_lib.filters.adaptive import kld_resample

#: Candidates drawn when the cloud does not explain a scan.
CANDIDATES = 20_000
#: Particles while nothing is known, and the fewest afterwards.
MOST, FEWEST = 8000, 1500
#: A scan is a surprise when its log-evidence is this far below the usual.
SURPRISE = 6.0
#: The usual follows the log-evidence by this share of the difference.
FOLLOW = 0.02
#: Copies of candidates are parted by noise of this size, in metres, metres, radians: often a few weigh most, and the
#: motion parts copies by millimetres.
PARTED = (0.02, 0.02, 0.02)
#: Probability per step that the cloud has lost the robot, where nobody kidnaps it.
DOUBT = 1e-5
#: Share of the candidates in the posterior of the first scan; the rest is for the cloud drawn before it.
FIRST = 0.95
#: Bins of KLD-sampling (metres, metres, radians), and the Kullback-Leibler distance to be kept within them.
BINS, EPSILON = (0.1, 0.1, np.pi / 18), 0.01


class Memory(NamedTuple):
    """What the reference remembers.

    Attributes
    ----------
    particles : Particles
    usual : float
        Log-evidence of scans, on average.
    start, map : Catalogue
        Poses at the start, and all.
    jumped : bool
        Whether most of the posterior is candidates.
    steps : int
    """

    particles: Particles
    usual: float
    start: candidates.Catalogue
    map: candidates.Catalogue
    jumped: bool
    steps: int


def Estimator(previous, observation, control, constants, rng):
    """One step of Monte Carlo localization.

    Parameters
    ----------
    previous : Step or None
        What the last call returned; None at time 0.
    observation : array_like, shape (B,), or None
        Ranges in metres, `inf` where a beam saw nothing.
    control : array_like, shape (2,), or None
        Commanded v in m/s and ω in rad/s.
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    Step
        Particles with columns x, y, θ, and the `Memory`.
    """
    if previous is None:
        memory = _begin(constants, rng)
        return Step(memory.particles, memory)
    memory = previous.memory
    particles = _resampled(memory.particles, rng)
    if memory.jumped:
        particles = _parted(particles, constants, rng)
    moved = Particles(models.transition(particles.states, control, constants, rng), particles.log_weights)
    states = moved.states
    log_weights = moved.log_weights + models.log_likelihood(observation, states, constants)
    log_evidence = normalise(log_weights)[1]
    first = memory.steps == 0
    if first or not log_evidence > memory.usual - SURPRISE:
        carried = FIRST if first else max(1.0 - np.exp(-constants.kidnap_rate * constants.Ts), DOUBT)
        elsewhere, log_others = candidates.draw(
            CANDIDATES, observation, memory.start if first else memory.map, constants, rng
        )
        states = np.vstack([states, elsewhere])
        log_weights = np.concatenate([log_weights + np.log1p(-carried), log_others + np.log(carried)])
    log_weights, total = normalise(log_weights)
    # A scan that nothing explains, where the model has no place for outliers, is left out.
    particles = Particles(states, log_weights) if np.isfinite(total) else moved
    usual = memory.usual + FOLLOW * (max(log_evidence, memory.usual - 5.0 * SURPRISE) - memory.usual)
    jumped = bool(np.exp(particles.log_weights[len(moved.states) :]).sum() > 0.5)
    return Step(particles, memory._replace(particles=particles, usual=usual, jumped=jumped, steps=memory.steps + 1))


def _begin(constants, rng):
    states = models.prior(MOST, constants, rng)
    everywhere = candidates.catalogue(constants)
    near = np.asarray(constants.near)
    low, high = near - constants.within, near + constants.within
    whole = np.all(low <= constants.bounds[:2]) and np.all(high >= constants.bounds[2:])
    start = everywhere if whole else candidates.catalogue(constants, low, high)
    # What a scan's log-likelihood is where the robot is.
    scans = models.read(models.distances(states[:200], constants), constants, rng)
    usual = np.mean([models.log_likelihood(scan, states[i : i + 1], constants)[0] for i, scan in enumerate(scans)])
    return Memory(equally_weighted(states), float(usual), start, everywhere, False, 0)


def _resampled(particles, rng):
    if effective_sample_size(particles) >= 0.5 * len(particles.states):
        return particles
    drawn = kld_resample(particles, rng, BINS, epsilon=EPSILON, least=FEWEST, most=MOST, angles=ANGLES)
    # So many, but not these: systematic resampling adds less noise.
    return equally_weighted(particles.states[systematic(particles.weights, rng, len(drawn.states))])


def _parted(particles, constants, rng):
    states = particles.states + PARTED * rng.standard_normal(particles.states.shape)
    states[:, HEADING] = wrap(states[:, HEADING])
    blocked = ~models.free(states, constants)
    states[blocked] = particles.states[blocked]
    return Particles(states, particles.log_weights)
