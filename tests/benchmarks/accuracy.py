"""How good the reference is: at the defaults, on the variants, and beside a filter of 200 000 particles."""

import numpy as np
from rich.console import Console
from rich.table import Table

from course_lib.angles import wrap
from course_lib.filters import ZeroLikelihoodError, equally_weighted, predict, resample, roughen, update
from course_lib.vacuum import models, reference
from course_lib.vacuum.constants import Constants, Hidden
from tests.benchmarks.runs import columns_of, measure_all

#: Particles of the filter that stands for the optimum, and its roughening constant K.
MANY = 200_000
ROUGHENING = 0.01

#: A run is lost when its error over the second half exceeds this many times the variant's median.
LOST = 3.0

VARIANTS = {
    "default": (Constants(), Hidden()),
    "v̄ = 0: ideal reflections": (Constants(v_bar=0.0), Hidden()),
    "v̄ = 0.1": (Constants(v_bar=0.1), Hidden()),
    "v̄ = 0.5": (Constants(v_bar=0.5), Hidden()),
    "w̄ = 0.2 m": (Constants(w_bar=0.2), Hidden()),
    "w̄ = 0.5 m": (Constants(w_bar=0.5), Hidden()),
    "w̄ = 2 m": (Constants(w_bar=2.0), Hidden()),
    "s̄ = 0": (Constants(s_bar=0.0), Hidden()),
    "s̄ = 0.5": (Constants(s_bar=0.5), Hidden()),
    "every sensor reports": (Constants(), Hidden(report_probability=1.0)),
    "every sensor reports, w̄ = 0.2 m": (Constants(w_bar=0.2), Hidden(report_probability=1.0)),
    "one report in 20": (Constants(), Hidden(report_probability=0.05)),
    "2 to 4 m/s": (Constants(), Hidden(slowest=2.0, fastest=4.0)),
    "constant speeds": (Constants(), Hidden(shortest_segment=200, longest_segment=200)),
    "L = 10 m": (Constants(L=10.0), Hidden()),
    "L = 2.5 m": (Constants(L=2.5), Hidden()),
    "T_s = 0.5 s": (Constants(Ts=0.5), Hidden()),
    "2017: room 2L × L, v̄_s = 0.1": (Constants(length=2.0, v_s_bar=0.1), Hidden()),
}


def crowd(previous, observation, control, constants, rng):
    """The textbook's bootstrap filter with 200 000 particles, from `course_lib.filters` and the models alone."""
    if previous is None:
        return equally_weighted(models.prior(MANY, constants, rng))
    particles = resample(previous, rng)
    if particles is not previous:
        extent = np.array([*constants.room, 2.0 * np.pi] * 2)
        states = roughen(particles.states, rng, ROUGHENING, extent)
        positions = [0, 1, 3, 4]
        states[:, positions] = np.clip(states[:, positions], 0.0, extent[positions])
        states[:, [2, 5]] = wrap(states[:, [2, 5]])
        particles = equally_weighted(states)
    particles = predict(particles, lambda states, rng: models.transition(states, control, constants, rng), rng)
    if not np.isfinite(observation).any():
        return particles
    try:
        return update(particles, models.log_likelihood(observation, particles.states, constants))[0]
    except ZeroLikelihoodError:
        return particles


def defaults(console: Console, runs):
    """The exercise as it is."""
    measured = columns_of(
        measure_all([(reference.Estimator, Constants(), Hidden(), i) for i in range(runs)], "reference, defaults")
    )
    table = Table("", "mean", "sd", "max", title=f"The reference at the defaults, {runs} runs of 200 steps")
    for name, values in [
        ("best-half error / m", measured.best_half),
        ("all-particles error / m", measured.all_particles),
        ("energy score / m", measured.energy),
        ("truth in the 90 % region", measured.coverage),
        ("CPU per update / ms", measured.cpu),
    ]:
        table.add_row(name, *(f"{value:.4f}" for value in (values.mean(), np.std(values, ddof=1), values.max())))
    console.print(table)
    console.print("ETH's own filter on its own simulator: 0.40 ± 0.15 m over 200 runs.\n")


def variants(console: Console, runs):
    """Other constants and hidden constants."""
    tasks = [(reference.Estimator, *world, i) for world in VARIANTS.values() for i in range(runs)]
    measured = measure_all(tasks, "reference, variants")
    table = Table(
        "variant",
        "best half / m",
        "sd",
        "max",
        "energy / m",
        "in 90 %",
        "CPU / ms",
        "lost",
        title=f"The reference on {runs} runs of each variant",
    )
    lost_runs = 0
    for j, name in enumerate(VARIANTS):
        rows = columns_of(measured[j * runs : (j + 1) * runs])
        lost = int(np.sum(rows.second_half > LOST * np.median(rows.second_half)))
        lost_runs += lost
        table.add_row(
            name,
            f"{rows.best_half.mean():.3f}",
            f"{np.std(rows.best_half, ddof=1):.3f}",
            f"{rows.best_half.max():.3f}",
            f"{rows.energy.mean():.3f}",
            f"{rows.coverage.mean():.3f}",
            f"{rows.cpu.mean():.2f}",
            f"{lost} of {runs}",
        )
    console.print(table)
    console.print(
        f"Lost: the best-half error over steps 100 to 200 is more than {LOST:g} times the variant's median. "
        f"{lost_runs} of {len(tasks)} runs.\n"
    )


def optimality(console: Console, runs):
    """How close the reference comes to a filter with many more particles, on the same runs."""
    names = {"reference": reference.Estimator, f"bootstrap filter, {MANY} particles": crowd}
    tasks = [(estimator, Constants(), Hidden(), i) for estimator in names.values() for i in range(runs)]
    measured = measure_all(tasks, "reference and 200 000 particles")
    table = Table(
        "", "best half / m", "sd", "max", "energy / m", "CPU / ms", title=f"Optimality: {runs} runs at the defaults"
    )
    rows = [columns_of(measured[:runs]), columns_of(measured[runs:])]
    for name, row in zip(names, rows, strict=True):
        table.add_row(
            name,
            f"{row.best_half.mean():.4f}",
            f"{np.std(row.best_half, ddof=1):.4f}",
            f"{row.best_half.max():.3f}",
            f"{row.energy.mean():.4f}",
            f"{row.cpu.mean():.1f}",
        )
    own, many = rows
    table.add_row(
        "ratio of means",
        f"{own.best_half.mean() / many.best_half.mean():.3f}",
        "",
        "",
        f"{own.energy.mean() / many.energy.mean():.3f}",
        f"{own.cpu.mean() / many.cpu.mean():.4f}",
    )
    console.print(table)
    difference = own.best_half - many.best_half
    console.print(
        f"Best half, reference less 200 000 particles, run by run: {1e3 * difference.mean():+.1f} "
        f"± {1e3 * np.std(difference, ddof=1) / np.sqrt(runs):.1f} mm (mean and its standard error).\n"
    )
