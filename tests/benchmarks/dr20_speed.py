"""What an update of Monte Carlo localization costs, part by part, and how many times the source's own way that is."""

import time

import numpy as np
from rich.table import Table

from course_lib.dr20 import mcl, models, reference
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.report import listing
from course_lib.dr20.world import World
from course_lib.filters import Particles, equally_weighted, normalise, resample

#: The source's: it reports 0.07 s for an update of so many.
COUNT = 1000
#: What it is to cost, in ms.
TARGET = 0.5


def dr20_speed(console, runs):
    """Print CPU times per update, on one core.

    Parameters
    ----------
    console : rich.console.Console
    runs : int
        Repetitions, of which the fastest counts: a busy machine only ever adds.
    """
    constants = Constants()
    run = World(constants, Hidden()).simulate(np.random.default_rng(1))
    table = Table(title=f"DR20: an update of {COUNT} particles, 5 beams, {len(constants.walls)} walls")
    for name in ("", "CPU ms", "times ours"):
        table.add_column(name, justify="left" if not name else "right")
    ours = _fastest(lambda: _follow(run, constants), runs) / run.steps
    rows = {"MCL: motion, beams, weights, resampling in every step": ours}
    rows |= {f"   {name}": _fastest(part, runs) / 100 for name, part in _parts(run, constants).items()}
    for name, estimator in (
        ("MCL, as run in the benchmarks", mcl.localizer(mcl.Choices())),
        ("reference", reference.Estimator),
    ):
        rows[name] = _fastest(lambda estimator=estimator: _replay(estimator, run, constants), runs) / run.steps
    rows["the source's listing, in plain Python"] = _fastest(lambda: _listing(run, constants), runs) / LISTED
    for name, value in rows.items():
        table.add_row(name, f"{value:.3f}" if value < 10 else f"{value:.1f}", f"{value / ours:.1f}")
    console.print(table)
    ratio = rows["the source's listing, in plain Python"] / ours
    console.print(
        f"{ours:.3f} ms an update (target {TARGET} ms), {ratio:.0f} times less than the source's own way (100)"
    )


#: Updates of the listing that are timed.
LISTED = 3


def _fastest(work, runs):
    """CPU time in ms of the fastest of some calls."""
    times = []
    for _ in range(runs + 1):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def _follow(run, constants):
    """The bootstrap filter with nothing beside it, resampling in every step."""
    rng = np.random.default_rng(2)
    particles = equally_weighted(models.prior(COUNT, constants, rng))
    for observation, control in zip(run.observations, run.controls, strict=True):
        states = models.transition(particles.states, control, constants, rng)
        log_likelihood = models.log_likelihood(observation, states, constants)
        particles = Particles(states, normalise(particles.log_weights + log_likelihood)[0])
        particles = resample(particles, rng, threshold=1.0)


def _parts(run, constants):
    """A hundred times each part of an update of a cloud about the truth."""
    rng = np.random.default_rng(3)
    states = run.truth[1] + rng.normal(0.0, 0.05, (COUNT, 3))
    scan, control = run.observations[0], run.controls[0]
    distances, log_likelihood = models.distances(states, constants), models.log_likelihood(scan, states, constants)
    particles = equally_weighted(states)
    weighed = Particles(states, normalise(log_likelihood)[0])
    c = constants
    beam = (c.sigma, c.r_max, c.p_short, c.rate_short, c.p_miss, c.p_random)

    def hundred(part):
        def repeat():
            for _ in range(100):
                part()

        return repeat

    return {
        "motion, with collisions": hundred(lambda: models.transition(states, control, constants, rng)),
        "ray casting": hundred(lambda: models.distances(states, constants)),
        "beam model": hundred(lambda: models.beam_log_likelihood(scan, distances, *beam)),
        "normalising": hundred(lambda: normalise(particles.log_weights + log_likelihood)),
        "resampling": hundred(lambda: resample(weighed, rng, threshold=1.0)),
    }


def _replay(estimator, run, constants):
    rng, previous = np.random.default_rng(4), None
    previous = estimator(None, None, None, constants, rng)
    for observation, control in zip(run.observations, run.controls, strict=True):
        previous = estimator(previous, observation, control, constants, rng)


def _listing(run, constants):
    rng = np.random.default_rng(5)
    lines = listing.half_metre_lines(constants)
    px, pw = models.prior(COUNT, constants, rng).T, np.full((1, COUNT), 1.0 / COUNT)
    slow = fast = 0.0
    for k in range(LISTED):
        scan = np.minimum(run.observations[k], constants.r_max)
        _, px, pw, slow, fast = listing.pf_localization(
            px, pw, slow, fast, scan, run.controls[k], lines, constants, rng
        )
