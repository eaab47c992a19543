"""What grading a submission costs beside the CPU time of the submission itself, here and with two other autograders.

CPU time, not wall time, and of all processes: the grader, its fork servers and every worker they fork. Starting the
fork servers is a class's cost, not a submission's, and not counted.
"""

import gc
import os
import time
from contextlib import nullcontext
from functools import partial
from itertools import islice
from pathlib import Path
from unittest import mock

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from course_lib.recording import Run, replay
from course_lib.vacuum.constants import Constants
from grader.assignment import PUBLIC_SECRET, Criterion, EstimatorAssignment, Speed, Variant
from grader.assignments import assignments
from grader.grading.evaluate import Outcome, limits, program, recorded_run
from grader.grading.grade import grade, most_episodes, plan, reference_outcome
from grader.intake.submission import Submission
from grader.sandbox import isolation
from grader.sandbox.server import Server
from tests.benchmarks import peers

ROOT = Path(__file__).parents[2]
VACUUM_SOURCE = (ROOT / "tests/submissions/vacuum/good_plain.py").read_text(encoding="utf-8")
STEPS = 10
BATCHES = 5
SMALL_SOURCE = """
import numpy as np

def Estimator(previous, observation, control, constants, rng):
    return observation + rng.normal(size=(100, 2)) if previous is not None else rng.normal(size=(100, 2))
"""


def overhead(console: Console, runs):
    """CPU time per submission above its own, at each tier; and where it goes."""
    if not Path("/proc/self/stat").exists():
        console.print("overhead: CPU time of all processes is counted on Linux only\n")
        return
    # As in the processes that grade a class.
    gc.collect()
    gc.freeze()
    tiers = [tier.number for tier in isolation.probe() if tier.available]
    table = Table("", "submissions", "in all", "its own", "the grader's", title="CPU time per submission")
    parts = Table("", "a worker", "its first call", "another call", "all else", title="Five points: the grader's part")
    for tier in tiers:
        total, own, shares = _five_points(tier, runs)
        table.add_row(f"five points, tier {tier}", f"{runs}", *map(_milliseconds, (total, own, total - own)))
        parts.add_row(f"tier {tier}", *map(_milliseconds, shares))
    few = max(1, runs // 50)
    for tier, (total, own) in _vacuum(tiers, few):
        row = map(_milliseconds, (total, own, total - own))
        table.add_row(f"the vacuum robots, tier {tier}", f"{few}", *row)
    for name, seconds in peers.measured(console):
        table.add_row(f"five points, {name}", f"{peers.SUBMISSIONS}", _milliseconds(seconds), "", "")
    console.print(table)
    console.print(
        f"Five points: five episodes of {STEPS} updates in a world where nothing moves, not timed; elsewhere five "
        "assertions about one function. The vacuum robots: all of it, and for time the reference's runs, too.\n"
    )
    console.print(parts)
    console.print("Five workers, five first calls and 50 more make a submission.\n")


def _milliseconds(seconds):
    return f"{1e3 * seconds:.1f} ms"


# Five points


def _simulate(variant, rng):
    truth = np.zeros((STEPS + 1, 2))
    return Run(truth=truth, observations=rng.normal(size=(STEPS, 2)), controls=np.zeros((STEPS, 1)))


def _measure(particles, truth, rng):
    return {"error": float(np.abs(particles.states - truth).mean())}


FIVE = EstimatorAssignment(
    name="five",
    title="A point that stands still",
    entry_point="Estimator",
    reference="none: its outcomes are made up",
    simulate=_simulate,
    measure=_measure,
    dimension=2,
    angles=(),
    picture=lambda variant: {},
    positions=((0, 1),),
    variants=(Variant("still", "as it is", Constants(), None, 5, (Criterion("error", 5.0, 1.5, 3.0),)),),
    speed=Speed("still", steps=STEPS, points=0.0, full=2.0, none=4.0),
    withheld=(),
    deadline=5.0,
)


def _five_points(tier, runs):
    """CPU seconds of a submission in all and its own, and of a worker, its first call, another call, and all else."""
    (variant,) = FIVE.variants
    references = {variant.name: [Outcome("ok", "", {"error": np.ones(STEPS + 1)})] * variant.episodes}
    submission = Submission("ana", "ana.py", SMALL_SOURCE)

    with Server(preload=("course_lib.vacuum.constants",), tier=tier) as server:

        def judge():
            # An interval is never as narrow as nothing: all five episodes are run.
            words = (submission, FIVE, server, None, references, PUBLIC_SECRET, nullcontext())
            result = grade(*words, width=1e-3)
            assert result.points == 5.0 and len(result.to_json()) > 0, result.message

        def steps(number):
            task = program(FIVE, variant, 0, PUBLIC_SECRET, SMALL_SOURCE)
            with server.start(task, limits(FIVE), dimension=2) as worker:
                for k in range(number):
                    worker.step(*([None] * 2 if k == 0 else [np.zeros(2), np.zeros(1)]))

        with mock.patch("grader.grading.grade.measure_speed", return_value=None):
            judge()  # what is imported at first use is the class's
            total = _cpu_per_call(judge, runs, f"five points, tier {tier}")
        none, one, many = (_cpu_per_call(partial(steps, k), 5 * runs, f"{k} calls") for k in (0, 1, 1 + STEPS))
    call = (many - one) / STEPS
    own = _own_seconds(FIVE, [(variant, episode, STEPS) for episode in range(5)] * 20, SMALL_SOURCE) / 20
    return total, own, (none, one - none, call, total - 5 * many)


def _vacuum(tiers, runs):
    """Yield each tier and CPU seconds of a submission in all and its own."""
    assignment = assignments()["vacuum"].under(PUBLIC_SECRET)
    submission = Submission("ana", "ana.py", VACUUM_SOURCE)
    references = {variant.name: [] for variant in assignment.variants}
    with Server(trusted=assignment.reference) as reference_server:
        for variant, episode in track(plan(assignment, most_episodes(assignment)), "the reference, once for a class"):
            outcome = reference_outcome(reference_server, assignment, variant, episode, PUBLIC_SECRET)
            references[variant.name].append(outcome)
    for tier in tiers:
        results = []
        with (
            Server(preload=("course_lib.vacuum.constants",), withheld=assignment.withheld, tier=tier) as server,
            Server(trusted=assignment.reference, tier=tier) as reference_server,
        ):

            def launch(servers=(server, reference_server)):
                for each, source in zip(servers, (VACUUM_SOURCE, None), strict=True):
                    task = program(assignment, assignment.variants[0], 0, PUBLIC_SECRET, source)
                    each.start(task, limits(assignment), dimension=assignment.dimension).close()

            def judge(servers=(server, reference_server), results=results):
                results.append(grade(submission, assignment, *servers, references, PUBLIC_SECRET, nullcontext()))
                results[-1].to_json()

            launch()
            total = _cpu_per_call(judge, runs, f"the vacuum robots, tier {tier}")
        yield tier, (total, _own_seconds(assignment, list(_replayed(assignment, results)), VACUUM_SOURCE) / runs)


def _replayed(assignment, results):
    """Variant, episode and updates of all runs that gave these results."""
    for result in results:
        for variant in result.variants:
            declared = assignment.variant(variant.name)
            for episode in variant.episodes:
                yield declared, episode.index, declared.hidden.steps
        for pair in range(len(result.speed.ratios)):
            yield assignment.variant(assignment.speed.variant), pair, assignment.speed.steps


# CPU time


def _cpu_per_call(function, calls, title):
    """Median over batches: a virtual machine is at times only half as fast."""
    batches, each = min(BATCHES, calls), -(-calls // BATCHES)
    seconds = []
    for _ in track(range(batches), title):
        before = _cpu_seconds()
        for _ in range(each):
            function()
        seconds.append((_cpu_seconds() - before) / each)
    return float(np.median(seconds))


def _cpu_seconds():
    """CPU time of this process, all that descend from it, and all that these have reaped."""
    processes = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            # Its name, in brackets, may hold anything.
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # gone meanwhile
        processes[int(path.parent.name)] = int(fields[1]), sum(map(int, fields[11:15]))
    ours = {os.getpid()}
    while found := {pid for pid, (parent, _) in processes.items() if parent in ours} - ours:
        ours |= found
    return sum(processes[pid][1] for pid in ours) / os.sysconf("SC_CLK_TCK")


def _own_seconds(assignment, episodes, source):
    """CPU time of a submission's calls in this process, without any sandbox."""
    module = {}
    exec(compile(source, "submission.py", "exec"), module)
    used = 0.0
    for variant, episode, steps in episodes:
        run = recorded_run(assignment, variant, episode, PUBLIC_SECRET)
        rng = np.random.default_rng(program(assignment, variant, episode, PUBLIC_SECRET, source).seed)
        start = time.process_time()
        for _ in islice(replay(module["Estimator"], run, variant.constants, rng), steps + 1):
            pass
        used += time.process_time() - start
    return used
