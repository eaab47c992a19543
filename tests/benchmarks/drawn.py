"""What the course's secret may draw: whether the reference and a good filter are at home everywhere in the ranges."""

import runpy
from functools import lru_cache
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from course_lib.filters import Step, equally_weighted
from course_lib.vacuum import reference
from grader.assignments import assignments
from tests.benchmarks.accuracy import LOST
from tests.benchmarks.runs import columns_of, measure_all

CLASS = Path(__file__).parents[1] / "submissions/vacuum"


def plain(*arguments):
    """The sample class's good filter."""
    return _step("good_plain", *arguments)


def hard_coded(*arguments):
    """The sample class's filter that knows one room only."""
    with np.errstate(all="ignore"):
        return _step("hard_coded_room", *arguments)


def _step(name, previous, *arguments):
    """A step of a filter that returns arrays."""
    states = _program(name)(None if previous is None else previous.memory, *arguments)
    return Step(equally_weighted(states), states)


@lru_cache
def _program(name):
    return runpy.run_path(str(CLASS / f"{name}.py"))["Estimator"]


def drawn(console: Console, runs):
    """One run under each of many secrets."""
    assignment = assignments()["vacuum"]
    under = [assignment.under(f"secret number {i} of the benchmark".encode()) for i in range(runs)]
    names = [variant.name for variant in assignment.variants if variant.ranges]
    estimators = (reference.Estimator, plain, hard_coded)
    tasks = [
        (estimator, variant.constants, variant.hidden, i)
        for name in names
        for estimator in estimators
        for i, variant in enumerate(each.variant(name) for each in under)
    ]
    measured = iter(measure_all(tasks, "reference, good and hard-coded filter"))
    table = Table(
        "variant",
        "reference / m",
        "max",
        "in 90 %",
        "lost",
        "good filter's share",
        "least",
        "hard-coded",
        title=f"Drawn variants under {runs} secrets: best half, and shares of the points",
    )
    for name in names:
        best, good, hard = (columns_of([next(measured) for _ in range(runs)]) for _ in estimators)
        variant = assignment.variant(name)
        right, wrong = _shares(variant, good, best), _shares(variant, hard, best)
        table.add_row(
            name,
            f"{best.best_half.mean():.3f}",
            f"{best.best_half.max():.3f}",
            f"{best.coverage.mean():.3f}",
            f"{np.sum(best.second_half > LOST * np.median(best.second_half))} of {runs}",
            f"{right.mean():.3f}",
            f"{right.min():.2f}",
            f"{wrong.mean():.3f}",
        )
    console.print(table)
    console.print()


def _shares(variant, rows, best):
    accuracy, proper = variant.criteria
    earned = [
        accuracy.points * accuracy.score(half, ours) + proper.points * proper.score(energy, least)
        for half, ours, energy, least in zip(rows.best_half, best.best_half, rows.energy, best.energy, strict=True)
    ]
    return np.array(earned) / variant.points
