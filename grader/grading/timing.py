"""Time: the CPU time of a submission as a ratio to the reference's, measured side by side.

Of two programs that take turns on one core, call by call, both meet whatever else the machine does, and the ratio of
their CPU times hardly feels it. What doubt is left is the submission's to gain by.
"""

import os
import secrets
import time
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri, stdtrit

from grader.grading.evaluate import as_particles, limits, measured, program, recorded_run
from grader.result import SpeedResult
from grader.sandbox.program import Escape, SandboxError, StudentError

#: Fresh pairs of processes, and how many they become when the outcome is in doubt.
PAIRS, MOST_PAIRS = 3, 7
#: Updates that do not count: a kernel may be compiled where it is first used, and not at the first call.
WARM_UP = 5
#: A pair ends early once this many updates took `HOPELESS` times what would earn nothing.
FEWEST_STEPS, HOPELESS = 10, 2.0
#: It ends, too, when by the clock on the wall a submission has taken longer than this (s) and `HOPELESS` times what is
#: hopeless: it waits, and the class with it.
LONGEST_WAIT = 10.0

#: One-sided.
CONFIDENCE = 0.95
#: Standard deviation of the logarithm of a pair's ratio on the noisiest machine. What varies more is the submission's
#: own doing, and earns it no benefit of doubt.
NOISE = 0.2
#: How near, as a ratio, is near the limit up to which time costs nothing; and points that are worth four more pairs.
NEAR, MATTERS = 1.15, 0.5

#: How often a posterior is looked at while it is timed, and how many times further off it may be than the submission's
#: own in the same run when it was graded.
LOOK_EVERY, WORSE = 5, 1.5


class Pair(NamedTuple):
    """One timed run.

    Attributes
    ----------
    student, reference : float
        CPU seconds per update.
    looks : list of dict
        The submission's metrics at steps 0, `LOOK_EVERY`, ...
    """

    student: float
    reference: float
    looks: list[dict]


def measure_speed(server, reference_server, assignment, secret, source, graded=()):
    """Replay the timed variant to a submission and to the reference in turn, call by call.

    Their clocks are those of the whole processes, threads included: what a submission does between calls is charged.
    Loading, compiling and the first `WARM_UP` updates are free. What a program could make ready there cannot depend on
    the readings to come.

    Parameters
    ----------
    server, reference_server : grader.sandbox.server.Server
    assignment : Assignment
    secret : bytes
    source : str
        The submission's source.
    graded : sequence of Outcome, optional
        Of the submission in the episodes 0, 1, ... of the timed variant, which the timed runs repeat: one that knows
        by the pauses that it is being timed must not take short cuts.

    Returns
    -------
    SpeedResult
        No points when the submission fails in a timed run, breaks its sandbox, or is another when it is timed.
    """
    speed = assignment.speed
    pairs, status, message = [], "ok", ""
    try:
        while goes_on(speed, _ratios(pairs)):
            pairs.append(_try_pair(server, reference_server, assignment, secret, source, len(pairs)))
        _check_unchanged(assignment, pairs, graded)
    except StudentError as error:
        status, message, pairs = error.status, error.message, []
    except SandboxError as error:
        status, message, pairs = "sandbox", f"the sandbox broke while this program was timed: {error}", []
    ratios = _ratios(pairs)
    lower = bounds(ratios)[0] if pairs else None
    student, reference = np.median([pair[:2] for pair in pairs], axis=0) if pairs else (None, None)
    return SpeedResult(
        status=status,
        message=message,
        milliseconds=None if student is None else 1e3 * float(student),
        reference_milliseconds=None if reference is None else 1e3 * float(reference),
        ratios=ratios,
        points=speed.points * share(speed, lower) if pairs else 0.0,
        max_points=speed.points,
        full=speed.full,
        none=speed.none,
        bound=lower,
    )


def bounds(ratios):
    """Between what a submission's ratio lies, each side with confidence `CONFIDENCE`.

    Parameters
    ----------
    ratios : sequence of float
        One per pair, at least one.

    Returns
    -------
    lower, upper : float
        By Student's t from the logarithms, their standard deviation taken to be at most `NOISE`. The median lies
        between.
    """
    logs = np.log(ratios)
    n = len(logs)
    doubt = ndtri(CONFIDENCE) * NOISE
    if n > 1:
        doubt = min(doubt, stdtrit(n - 1, CONFIDENCE) * logs.std(ddof=1))
    lower, upper = np.exp(logs.mean() + np.array([-1.0, 1.0]) * doubt / np.sqrt(n))
    median = np.median(ratios)
    return float(min(lower, median)), float(max(upper, median))


def share(speed, ratio):
    """Share of the points that a ratio earns, between 0 and 1."""
    return float(np.clip((speed.none - ratio) / (speed.none - speed.full), 0.0, 1.0))


def goes_on(speed, ratios):
    """Whether another pair is due after those that gave these ratios.

    Three, unless the first is hopeless. Seven, when the median is within 15 % of the ratio up to which time costs
    nothing, for there one is told that one lost points; or when half a point hangs on where in its interval it lies.
    """
    if len(ratios) < PAIRS:
        return not (ratios and min(ratios) > HOPELESS * speed.none)
    if len(ratios) > PAIRS:
        return len(ratios) < MOST_PAIRS
    near = speed.full / NEAR <= np.median(ratios) <= speed.full * NEAR
    lower, upper = bounds(ratios)
    return bool(near or speed.points * (share(speed, lower) - share(speed, upper)) > MATTERS)


def changed(pairs, graded, metrics):
    """How many times further off a submission is when it is timed than in the same runs when it was graded.

    Parameters
    ----------
    pairs : sequence of Pair
    graded : sequence of Outcome
    metrics : sequence of str
        That count.

    Returns
    -------
    float or None
        The median (the lower one of two) over the runs, for a program that draws its own random numbers may lose its
        target in one of them; None when fewer than two can be compared. Exactly 1 for a program that repeats.
    """
    factors = []
    for pair, outcome in zip(pairs, graded, strict=False):
        if outcome.status == "ok":
            before = {name: outcome.metrics[name][::LOOK_EVERY][: len(pair.looks)].mean() for name in metrics}
            now = {name: np.mean([look[name] for look in pair.looks]) for name in metrics}
            factors.append(max(now[name] / max(before[name], np.finfo(float).tiny) for name in metrics))
    return float(sorted(factors)[(len(factors) - 1) // 2]) if len(factors) > 1 else None


def _ratios(pairs):
    return [float(pair.student / pair.reference) for pair in pairs]


def _check_unchanged(assignment, pairs, graded):
    metrics = [criterion.metric for criterion in assignment.variant(assignment.speed.variant).criteria]
    factor = changed(pairs, graded, metrics)
    if factor is not None and factor > WORSE:
        raise StudentError(
            "inconsistent",
            f"its errors are {factor:.3g} times as large while it is timed as in the same runs when it was graded: "
            "a program must not know that it is timed",
        )


def _try_pair(*arguments):
    """A pair; another one when the sandbox breaks, for that may be a neighbour's doing."""
    try:
        return _pair(*arguments)
    except Escape:
        raise
    except SandboxError:
        return _pair(*arguments)


def _pair(server, reference_server, assignment, secret, source, pair):
    speed = assignment.speed
    variant = assignment.variant(speed.variant)
    run = recorded_run(assignment, variant, pair, secret)
    allowed, rng = limits(assignment), np.random.default_rng()
    student_task = program(assignment, variant, pair, secret, source)
    reference_task = program(assignment, variant, pair, secret)
    looks = []
    with (
        server.start(student_task, allowed, dimension=assignment.dimension) as student,
        reference_server.start(reference_task, allowed, dimension=assignment.dimension) as reference,
    ):
        _share_a_core(student, reference)
        for k in range(min(speed.steps, run.steps) + 1):
            inputs = (None, None) if k == 0 else (run.observations[k - 1], run.controls[k - 1])
            times = [time.monotonic()]
            posterior = student.step(*inputs)
            # Stopped, it can neither work ahead nor trash the caches while the reference runs.
            student.stop()
            times.append(time.monotonic())
            reference.step(*inputs)
            times.append(time.monotonic())
            if k % LOOK_EVERY == 0:
                looks.append(
                    measured(assignment, as_particles(posterior, assignment.angles, k, rng), run.truth[k], k, rng)
                )
            student.cont()
            now = np.array([[student.cpu_seconds(), reference.cpu_seconds()], np.diff(times)])
            if k == WARM_UP:
                cpu_start, wall = now[0], np.zeros(2)
            elif k > WARM_UP:
                used, wall = now[0] - cpu_start, wall + now[1]
                _check_wait(speed, wall, k)
                if k - WARM_UP >= FEWEST_STEPS and used[0] > HOPELESS * speed.none * used[1]:
                    break
    return Pair(*(used / (k - WARM_UP)), looks)


def _share_a_core(*workers):
    """Keep both on one core, any one: two cores of a busy or virtual machine are not equally fast."""
    if hasattr(os, "sched_setaffinity"):
        core = secrets.choice(sorted(os.sched_getaffinity(0)))
        for worker in workers:
            worker.pin(core)


def _check_wait(speed, wall, k):
    student, reference = wall
    if student > max(LONGEST_WAIT, HOPELESS**2 * speed.none * reference):
        raise StudentError(
            "timeout",
            f"step {k}: waited {student:.0f} s by the clock on the wall, where the reference took {reference:.2g} s",
        )
