"""The DR20's filters side by side on the three problems: how often they find the robot, when, how well, at what cost.

A practitioner's judgement (`course_lib.dr20.success`): an estimate is near within 0.3 m and 15°. A run without a
kidnapping succeeds when the estimate is near for 90 % of the time once it has been for a second, and at the end; a
kidnapped robot is found when it is near again for a second, begun within 5 s. A filter marked 3σ is told three times
the noise there is: few particles find a sharp likelihood rarely.
"""

import os
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn, track
from rich.table import Table
from scipy.stats import beta

from course_lib.dr20 import mcl, models, reference, success, symmetry
from course_lib.dr20.constants import Constants, Hidden
from course_lib.dr20.report import method
from course_lib.dr20.world import World

#: A kidnapped robot is to be found within this time, in seconds.
SOON = 5.0
#: Half the side of the square the robot is known to start in, in metres.
KNOWN = 1.0

CLEAN = Constants(p_short=0.0, p_miss=0.0, p_random=0.0, r_max=10.0)
#: What an estimator is told, what it is not, and whether the start is known.
PROBLEMS = {
    "local": (Constants(), Hidden(), True),
    "global": (Constants(), Hidden(), False),
    "kidnapped": (Constants(kidnap_rate=1 / 30), Hidden(kidnaps=1), False),
    "global, hits only": (CLEAN, Hidden(), False),
    "kidnapped, hits only": (replace(CLEAN, kidnap_rate=1 / 30), Hidden(kidnaps=1), False),
}
#: These are the assignment's own beams, and take a quarter of the runs; only there is SLOW run.
ITS_OWN = ("global, hits only", "kidnapped, hits only")
SLOW = "MCL, 10 000 particles"
#: Poses whose scans are looked at for what else explains them, and runs that are followed exactly.
LOOKED_AT, FOLLOWED = 200, 20

_GAUSSIAN = method.Choices(weight="gaussian", jitter=(0.01, 0.01, 0.01), circular=True, paired=True, augmented=False)
METHODS = {
    "the source's": method.estimator(method.Choices()),
    "... not augmented": method.estimator(method.Choices(augmented=False)),
    "Gaussian .15, 1 cm": method.estimator(_GAUSSIAN),
    "... + α .05/.5": method.estimator(
        replace(
            _GAUSSIAN,
            augmented=True,
            alpha_slow=0.05,
            alpha_fast=0.5,
            from_zero=False,
            headings=(-np.pi, np.pi),
            free=True,
        )
    ),
    "MCL, beam model": mcl.localizer(mcl.Choices()),
    "MCL, 10 000 particles": mcl.localizer(mcl.Choices(count=10_000)),
    "MCL, 3σ": mcl.localizer(mcl.Choices(spread=3.0)),
    "MCL, field, 3σ": mcl.localizer(mcl.Choices(sensor="field", spread=3.0)),
    "AMCL .001/.1": mcl.localizer(mcl.Choices(alphas=(0.001, 0.1))),
    "AMCL .001/.1, 3σ": mcl.localizer(mcl.Choices(alphas=(0.001, 0.1), spread=3.0)),
    "AMCL .01/.1, 3σ": mcl.localizer(mcl.Choices(alphas=(0.01, 0.1), spread=3.0)),
    "AMCL .01/.1, 3σ, KLD": mcl.localizer(mcl.Choices(10_000, alphas=(0.01, 0.1), epsilon=0.02, least=500, spread=3.0)),
    "reference": reference.Estimator,
}


class Outcome(NamedTuple):
    """What a filter did on one run.

    Attributes
    ----------
    success : bool
    converged : float
        Seconds.
    error, heading : float
        Medians over the steps that are near: metres, degrees.
    recovered : float
        Seconds from the kidnapping; NaN where there was none.
    particles, milliseconds : float
        Per update.
    """

    success: bool
    converged: float
    error: float
    heading: float
    recovered: float
    particles: float
    milliseconds: float


def setting(problem, index):
    """Constants, hidden and run of one problem: the same for every filter."""
    constants, hidden, known = PROBLEMS[problem]
    rng = np.random.default_rng([17, index])
    if known:
        # Each run has a square of its own.
        near = models.anywhere(1, constants, rng)[0, :2]
        constants = replace(constants, near=tuple(near.tolist()), within=KNOWN)
    return constants, hidden, World(constants, hidden).simulate(rng)


def measure(problem, method, index):
    """Run one filter on one run."""
    constants, _, run = setting(problem, index)
    estimator, rng = METHODS[method], np.random.default_rng([18, index])
    previous, spent, counts, estimates = None, 0.0, [], []
    for k in range(run.steps + 1):
        data = (run.observations[k - 1], run.controls[k - 1]) if k else (None, None)
        start = time.process_time()
        previous = estimator(previous, *data, constants, rng)
        spent += (time.process_time() - start) if k else 0.0
        counts.append(len(previous.posterior.states))
        own = isinstance(previous.memory, method.Memory)
        estimates.append(previous.memory.estimate if own else mcl.pose(previous.posterior))
    judged = success.judge(np.array(estimates), run.truth, constants.Ts)
    recovered = success.recoveries(np.array(estimates), run.truth, constants.Ts).recovered
    error, heading = (np.median(e[judged.near]) if judged.near.any() else np.nan for e in judged[:2])
    return Outcome(
        judged.success,
        judged.converged,
        error,
        np.degrees(heading),
        recovered[0] if len(recovered) else np.nan,
        np.mean(counts),
        1e3 * spent / run.steps,
    )


def dr20(console, runs):
    """Print a table for each problem.

    Parameters
    ----------
    console : rich.console.Console
    runs : int
    """
    for problem in PROBLEMS:
        count = max(runs // 4, 2) if problem in ITS_OWN else runs
        outcomes = _all(problem, count)
        kidnapped = PROBLEMS[problem][1].kidnaps > 0
        console.print(_table(problem, count, outcomes, kidnapped))
        for index, outcome in enumerate(outcomes["reference"]):
            if not (outcome.recovered <= SOON if kidnapped else outcome.success):
                console.print(_why(problem, index, kidnapped))
    console.print(_symmetry(console))


def _why(problem, index, kidnapped):
    """What an exact filter makes of a run that the reference failed."""
    constants, _, run = setting(problem, index)
    first = int(success.kidnapped(run.truth)[0]) if kidnapped else 1
    steps = round(SOON / constants.Ts) + 1
    grid = symmetry.pose_grid(constants)
    mass = symmetry.mass_near_truth(run, grid, constants, np.random.default_rng([19, index]), first, steps)
    return (
        f"run {index}, failed by the reference: of the exact posterior {100 * mass[-1]:.0f} % is near the truth after "
        f"{SOON:g} s, {100 * mass[min(10, len(mass) - 1)]:.0f} % after 1 s"
    )


def _symmetry(console):
    """What the map makes impossible."""
    constants, rng = Constants(), np.random.default_rng(20)
    grid = symmetry.pose_grid(constants)
    poses = models.anywhere(LOOKED_AT, constants, rng)
    found = [
        symmetry.ambiguity(pose[None], grid, constants, rng)
        for pose in track(poses, "scans that others explain", console=console)
    ]
    ambiguous, places = np.mean([each.ambiguous for each in found]), np.mean([each.counts for each in found])
    known = np.array(
        [
            symmetry.mass_near_truth(setting("global", i)[2], grid, constants, np.random.default_rng([21, i]), steps=51)
            for i in track(range(FOLLOWED), "exact posteriors", console=console)
        ]
    )
    when = {0: "the first scan", 5: "half a second", 10: "1 s", 20: "2 s", 50: "5 s"}
    shares = ", ".join(f"{100 * (known[:, k] < 0.5).mean():.0f} % after {words}" for k, words in when.items())
    return (
        f"The map: of {LOOKED_AT} random poses {100 * ambiguous:.0f} % have a scan that a pose elsewhere "
        f"explains about as well (3 nats), {places:.1f} places on average. Of {FOLLOWED} global runs, the "
        f"exact posterior has less than half of its mass near the truth in {shares}."
    )


def _all(problem, runs):
    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()]
    methods = [method for method in METHODS if method != SLOW or problem in ITS_OWN]
    with Progress(*columns) as progress, ProcessPoolExecutor(os.cpu_count()) as pool:
        futures = {(m, i): pool.submit(measure, problem, m, i) for m in methods for i in range(runs)}
        bar = progress.add_task(problem, total=len(futures))
        for _ in as_completed(futures.values()):
            progress.advance(bar)
    return {method: [futures[method, i].result() for i in range(runs)] for method in methods}


def _table(problem, runs, outcomes, kidnapped):
    table = Table(title=f"{problem}: {runs} runs of 30 s")
    table.add_column("filter")
    rate = f"found within {SOON:g} s" if kidnapped else "success"
    times = "recovery s 50, 90 %" if kidnapped else "converged s 50, 90 %"
    for name in (f"{rate} (95 %)", times, "error cm", "heading °", "particles", "ms"):
        table.add_column(name, justify="right")
    for name, results in outcomes.items():
        each = Outcome(*np.array(results, dtype=float).T)
        good = each.recovered <= SOON if kidnapped else each.success > 0.0
        low, high = _interval(int(good.sum()), runs)
        when = each.recovered if kidnapped else each.converged
        table.add_row(
            name,
            f"{100 * good.mean():.1f} % ({100 * low:.0f}-{100 * high:.0f})",
            ", ".join(_seconds(np.quantile(when, q, method="higher")) for q in (0.5, 0.9)),
            f"{100 * np.nanmedian(each.error):.1f}",
            f"{np.nanmedian(each.heading):.2f}",
            f"{each.particles.mean():.0f}",
            f"{each.milliseconds.mean():.2f}",
        )
    return table


def _seconds(value):
    return f"{value:.1f}" if np.isfinite(value) else "never"


def _interval(good, runs):
    """Clopper and Pearson's 95 % interval of a share."""
    low = beta.ppf(0.025, good, runs - good + 1) if good else 0.0
    high = beta.ppf(0.975, good + 1, runs - good) if good < runs else 1.0
    return low, high
