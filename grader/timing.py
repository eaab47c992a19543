"""Time: the CPU time of a submission as a ratio to the reference's, measured side by side."""

import numpy as np

from grader.evaluate import limits, program, recorded_run
from grader.result import SpeedResult
from grader.sandbox.program import SandboxError, StudentError

#: Fresh pairs of processes; the median of their ratios counts.
PAIRS = 3
#: A pair ends early once this many updates took `HOPELESS` times what would earn nothing.
FEWEST_STEPS, HOPELESS = 10, 2.0


def measure_speed(server, reference_server, assignment, secret, source):
    """Replay the timed variant to a submission and to the reference in turn, call by call.

    Both meet the same load of the machine, whatever it is, so that their ratio does not depend on it. Their clocks are
    those of the whole processes, threads included, from the first posterior on: loading and compiling are free.

    Parameters
    ----------
    server, reference_server : grader.sandbox.server.Server
    assignment : Assignment
    secret : bytes
    source : str
        The submission's source.

    Returns
    -------
    SpeedResult
        No points when the submission fails in the timed run, or breaks its sandbox.
    """
    speed = assignment.speed
    pairs = []
    status, message = "ok", ""
    try:
        for pair in range(PAIRS):
            pairs.append(_pair(server, reference_server, assignment, secret, source, pair))
            if pairs[-1][0] > HOPELESS * speed.none * pairs[-1][1]:
                break
    except StudentError as error:
        status, message, pairs = error.status, error.message, []
    except SandboxError as error:
        status, message, pairs = "sandbox", f"the sandbox broke while this program was timed: {error}", []
    ratios = [float(student / reference) for student, reference in pairs]
    share = (speed.none - np.median(ratios)) / (speed.none - speed.full) if pairs else 0.0
    student, reference = np.median(pairs, axis=0) if pairs else (None, None)
    return SpeedResult(
        status=status,
        message=message,
        milliseconds=None if student is None else 1e3 * float(student),
        reference_milliseconds=None if reference is None else 1e3 * float(reference),
        ratios=ratios,
        points=speed.points * float(np.clip(share, 0.0, 1.0)),
        max_points=speed.points,
        full=speed.full,
        none=speed.none,
    )


def _pair(server, reference_server, assignment, secret, source, pair):
    """CPU seconds per update, of the submission and of the reference."""
    variant = assignment.variant(assignment.speed.variant)
    run = recorded_run(assignment, variant, pair, secret)
    bounds = limits(assignment)
    student_task = program(assignment, variant, pair, secret, source)
    reference_task = program(assignment, variant, pair, secret)
    with (
        server.start(student_task, bounds, dimension=assignment.dimension) as student,
        reference_server.start(reference_task, bounds, dimension=assignment.dimension) as reference,
    ):
        student.step(None, None)
        reference.step(None, None)
        start = np.array([student.cpu_seconds(), reference.cpu_seconds()])
        for k in range(1, min(assignment.speed.steps, run.steps) + 1):
            observation, control = run.observations[k - 1], run.controls[k - 1]
            student.step(observation, control)
            # Stopped, it can neither work ahead nor trash the caches while the reference runs.
            student.stop()
            reference.step(observation, control)
            student.cont()
            used = np.array([student.cpu_seconds(), reference.cpu_seconds()]) - start
            if k >= FEWEST_STEPS and used[0] > HOPELESS * assignment.speed.none * used[1]:
                break
        return used / k
