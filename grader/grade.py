"""From a submission and an assignment to a result: errors, then time, then the sum."""

import platform
import sys
from dataclasses import replace

import numpy as np

from grader.evaluate import Outcome, evaluate, recorded_run
from grader.result import CriterionResult, Episode, Result, Trace, VariantResult
from grader.sandbox import isolation
from grader.secret import fingerprint
from grader.timing import measure_speed

#: After this many episodes that ran out of time or broke the sandbox the rest are not run: they would take as long.
PATIENCE = 2


def reference_outcomes(reference_server, assignment, variant, secret):
    """The reference's outcomes in all episodes of a variant, against which the class is graded.

    Parameters
    ----------
    reference_server : grader.sandbox.server.Server
    assignment : Assignment
    variant : Variant
    secret : bytes

    Returns
    -------
    list of Outcome
        Without frames: nobody looks at the reference's.

    Raises
    ------
    RuntimeError
        The reference failed: no grade could be defended.
    """
    outcomes = []
    for episode in range(variant.episodes):
        outcome = evaluate(reference_server, assignment, variant, episode, secret)
        if outcome.status != "ok":
            raise RuntimeError(
                f"the reference of assignment {assignment.name} failed in variant {variant.name}, "
                f"episode {episode}: {outcome.message}"
            )
        outcomes.append(replace(outcome, frames=[]))
    return outcomes


def grade(submission, assignment, server, reference_server, references, secret, timing_turn):
    """Grade one submission.

    Parameters
    ----------
    submission : Submission
    assignment : Assignment
    server, reference_server : grader.sandbox.server.Server
    references : dict of str to list of Outcome
        Variant name to `reference_outcomes`.
    secret : bytes
    timing_turn : context manager
        Entered while CPU time is measured, so that not all cores measure at once.

    Returns
    -------
    Result
    """
    outcomes = {variant.name: [] for variant in assignment.variants}
    costly = 0
    for variant in assignment.variants:
        for episode in range(variant.episodes):
            if costly < PATIENCE:
                outcome = evaluate(server, assignment, variant, episode, secret, submission.source)
            else:
                outcome = Outcome(
                    "timeout", f"not run: {PATIENCE} earlier episodes ran out of time or broke the sandbox", {}
                )
            costly += outcome.status in ("timeout", "sandbox")
            outcomes[variant.name].append(outcome)
    variants = [
        _variant_result(variant, outcomes[variant.name], references[variant.name]) for variant in assignment.variants
    ]
    if any(outcome.status == "ok" for episodes in outcomes.values() for outcome in episodes):
        with timing_turn:
            graded = outcomes[assignment.speed.variant]
            speed = measure_speed(server, reference_server, assignment, secret, submission.source, graded)
    else:
        speed = None
    points = sum(variant.points for variant in variants) + (speed.points if speed else 0.0)
    failures = [episode for variant in variants for episode in variant.episodes if episode.status != "ok"]
    episodes = sum(len(variant.episodes) for variant in variants)
    message = f"{len(failures)} of {episodes} episodes failed: {failures[0].message}" if failures else ""
    return Result(
        submission=submission.name,
        path=submission.path,
        digest=submission.digest,
        assignment=assignment.name,
        status="graded",
        message=message or (speed.message if speed else ""),
        points=points,
        max_points=assignment.points,
        variants=variants,
        speed=speed,
        trace=_worst(assignment, outcomes, references, secret),
        environment=environment(secret, server.tier),
        dimension=assignment.dimension,
    )


def refused(refusal, assignment, secret):
    """The result of a file that holds no gradable program: no points, and the reason."""
    return Result(
        submission=refusal.name,
        path=refusal.path,
        digest="",
        assignment=assignment.name,
        status="refused",
        message=refusal.reason,
        points=0.0,
        max_points=assignment.points,
        environment=environment(secret),
    )


def environment(secret, tier=None):
    """What a repetition of the grade needs to know; without a tier, no program was run."""
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "platform": f"{sys.platform} {platform.machine()}",
        "isolation": "nothing was run" if tier is None else isolation.describe(tier),
        "secret": fingerprint(secret),
    }


def _variant_result(variant, outcomes, references):
    criteria = []
    for criterion in variant.criteria:
        values = [outcome.values.get(criterion.metric) for outcome in outcomes]
        baselines = [reference.values[criterion.metric] for reference in references]
        shares = [
            0.0 if value is None else criterion.score(value, baseline)
            for value, baseline in zip(values, baselines, strict=True)
        ]
        finished = [value for value in values if value is not None]
        criteria.append(
            CriterionResult(
                metric=criterion.metric,
                points=criterion.points * float(np.mean(shares)),
                max_points=criterion.points,
                full=criterion.full,
                none=criterion.none,
                value=float(np.mean(finished)) if finished else None,
                reference=float(np.mean(baselines)),
            )
        )
    episodes = [
        Episode(index, outcome.status, outcome.message, outcome.values, reference.values)
        for index, (outcome, reference) in enumerate(zip(outcomes, references, strict=True))
    ]
    return VariantResult(variant.name, variant.title, criteria, episodes, drawn=variant.drawn)


def _worst(assignment, outcomes, references, secret):
    """The episode that went worst against the reference, of those with one truth; None when nothing ran."""
    candidates = []
    for variant in assignment.variants:
        metric = variant.criteria[0].metric
        for episode, outcome in enumerate(outcomes[variant.name]):
            reference = references[variant.name][episode]
            if not outcome.frames or recorded_run(assignment, variant, episode, secret).truth.ndim > 2:
                continue
            # Finished episodes come first: a picture that ends early shows less.
            ratio = np.mean(outcome.metrics[metric]) / reference.values[metric]
            candidates.append((outcome.status == "ok", float(ratio), variant, episode, metric))
    if not candidates:
        return None
    *_, variant, episode, metric = max(candidates, key=lambda candidate: candidate[:2])
    outcome, reference = outcomes[variant.name][episode], references[variant.name][episode]
    truth = recorded_run(assignment, variant, episode, secret).truth
    return Trace(
        variant=variant.name,
        episode=episode,
        metric=metric,
        error=outcome.metrics[metric].round(4).tolist(),
        reference_error=reference.metrics[metric].round(4).tolist(),
        truth=[truth[:, list(columns)].round(3).tolist() for columns in assignment.positions],
        frames=outcome.frames,
        picture=assignment.picture(variant),
    )
