"""Whether a busy machine falsifies the grade for time: the reference, and its work done three times, as a student's.

Both are timed by the grader's own `measure_speed`, against a limit half way between them, with nothing else running and
under four processes that compute without end and push everything out of the caches.
"""

import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from course_lib.vacuum import reference
from grader.assignment import PUBLIC_SECRET, Speed
from grader.assignments import assignments
from grader.grading.evaluate import recorded_run
from grader.grading.timing import measure_speed
from grader.sandbox import isolation
from grader.sandbox.server import Server

#: All points up to twice the reference's time, none from 2.1 times: what passes has them all, what fails has none.
PASS_OR_FAIL = Speed("default", steps=30, points=10.0, full=2.0, none=2.1)
HOGS = 4
HOG = "import numpy as np; x = np.ones(1 << 21)\nwhile True: x = np.sqrt(x * x + 1e-9)"

SAME = "from course_lib.vacuum.reference import Estimator\n"
THRICE = """
from course_lib.vacuum.reference import Estimator as _once

def Estimator(previous, observation, control, constants, rng):
    for _ in range(3):
        step = _once(previous, observation, control, constants, rng)
    return step
"""


def timing(console: Console, runs):
    """Verdicts on both programs, and how much their times vary."""
    assignment = replace(assignments()["vacuum"].under(PUBLIC_SECRET), speed=PASS_OR_FAIL)
    verdicts = Table("", "the reference passes", "three times its work fails", "its ratio", title="Verdicts on time")
    spreads = Table(
        "sd / mean, largest / smallest", "wall time", "CPU time", "CPU ratio of a pair", "CPU ratio of the grade",
        title=f"How much {PASS_OR_FAIL.steps} updates of the reference vary",
    )  # fmt: skip
    # Its modules are withheld from students. Here they are handed in, and loaded beforehand like the reference's own.
    with (
        Server(preload=("course_lib.vacuum.reference",)) as server,
        Server(trusted=assignment.reference) as reference_server,
    ):
        # Without hogs only to compare: fewer will do.
        for title, hogs, count in (("nothing else runs", 0, max(runs // 4, 2)), (f"{HOGS} hogs", HOGS, runs)):
            with _hogs(hogs):
                walls, same, thrice = [], [], []
                for _ in track(range(count), title):
                    walls.append(_wall_seconds(assignment))
                    for source, results in ((SAME, same), (THRICE, thrice)):
                        results.append(measure_speed(server, reference_server, assignment, PUBLIC_SECRET, source))
            if failed := [result.message for result in same + thrice if result.status != "ok"]:
                raise RuntimeError(f"a program could not be timed: {failed[0]}")
            verdicts.add_row(
                title,
                f"{sum(result.points == 10.0 for result in same)} of {count}",
                f"{sum(result.points == 0.0 for result in thrice)} of {count}",
                f"{np.median([result.ratio for result in thrice]):.2f}",
            )
            pairs = [ratio for result in same for ratio in result.ratios]
            measured = (walls, [result.milliseconds for result in same], pairs, [result.ratio for result in same])
            spreads.add_row(title, *map(_spread, measured))
    console.print(verdicts)
    console.print(
        f"Limit: {PASS_OR_FAIL.full:g} times the reference's CPU time. {isolation.describe(server.tier)}. "
        f"The reference against itself: {np.median(pairs):.3f} under {HOGS} hogs.\n"
    )
    console.print(spreads)
    console.print()


@contextmanager
def _hogs(number):
    processes = [subprocess.Popen([sys.executable, "-c", HOG]) for _ in range(number)]
    try:
        # Until they have imported numpy.
        time.sleep(2.0 if number else 0.0)
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _wall_seconds(assignment):
    """Wall time of the same updates in this process."""
    variant = assignment.variant(PASS_OR_FAIL.variant)
    run = recorded_run(assignment, variant, 0, PUBLIC_SECRET)
    rng = np.random.default_rng(0)
    step = reference.Estimator(None, None, None, variant.constants, rng)
    start = time.perf_counter()
    for observation, control in zip(run.observations[: PASS_OR_FAIL.steps], run.controls, strict=False):
        step = reference.Estimator(step, observation, control, variant.constants, rng)
    return time.perf_counter() - start


def _spread(values):
    values = np.asarray(values)
    return f"{values.std(ddof=1) / values.mean():.1%}, {values.max() / values.min():.2f}"
