"""From a submission and an assignment to a result: errors, then time, then the sum."""

import platform
import sys
from dataclasses import replace

import numpy as np

from grader.grading.evaluate import Outcome, evaluate, recorded_run, simulated
from grader.grading.secret import fingerprint
from grader.grading.sequential import CONFIDENCE, bounds, schedule, soonest
from grader.grading.timing import measure_speed
from grader.result import CriterionResult, Episode, Result, Trace, VariantResult
from grader.sandbox import isolation

#: After this many episodes that ran out of time or broke the sandbox the rest of the round is not run: it would take
#: as long.
PATIENCE = 2
#: Points: when the interval of the points for errors is narrower than this, episodes end.
WIDTH = 15.0
#: Rounds of all variants after which episodes end anyway. Resampled, the vacuum's sample class ends after 50 of 56
#: episodes on average: good filters after 42, faulty ones nearly all at the cap, with intervals of 19 to 21 points.
#: Three rounds instead would narrow those to 15 to 17, for 67 episodes.
ROUNDS = 2
#: Why episodes ended.
NARROW, CAPPED, IMPATIENT = "the interval is narrow enough", "the cap is reached", "patience is lost"

#: Scenes that are drawn for an episode of a planner, at most: the class meets the first that the reference masters.
DRAWS = 5
#: What is drawn of a planner over time.
DISTANCE = "distance to the goal"


def most_episodes(assignment):
    """The cap when none is asked for."""
    return ROUNDS * sum(variant.episodes for variant in assignment.variants)


def plan(assignment, cap):
    """What the whole class is graded in, in this order.

    Parameters
    ----------
    assignment : Assignment
    cap : int

    Returns
    -------
    list of (Variant, int)
        Variant and number of an episode, `cap` of them: rounds in which each variant has its `episodes`, interleaved.
    """
    episodes, numbers = [], [0] * len(assignment.variants)
    for stratum in schedule([variant.episodes for variant in assignment.variants], cap):
        episodes.append((assignment.variants[stratum], numbers[stratum]))
        numbers[stratum] += 1
    return episodes


def reference_outcome(reference_server, assignment, variant, episode, secret):
    """The reference's outcome in an episode, against which the class is graded.

    A planner's reference may fail in a scene, because of gusts or because nothing leads through it: then another scene
    is drawn, for the whole class.

    Parameters
    ----------
    reference_server : grader.sandbox.server.Server
    assignment : Assignment
    variant : Variant
    episode : int
    secret : bytes

    Returns
    -------
    Outcome
        Without clouds: nobody looks at the reference's. Its `draw` is the class's.

    Raises
    ------
    RuntimeError
        The reference failed: no grade could be defended.
    """
    for draw in range(DRAWS if assignment.answer == "action" else 1):
        outcome = evaluate(reference_server, assignment, variant, episode, secret, draw=draw)
        if outcome.status == "ok":
            return replace(outcome, frames=[])
    raise RuntimeError(
        f"the reference of assignment {assignment.name} failed in variant {variant.name}, "
        f"episode {episode}: {outcome.message}; with another --secret it may not, but report this"
    )


def grade(submission, assignment, server, reference_server, references, secret, timing_turn, width=WIDTH):
    """Grade one submission.

    Episodes are run in the order of `plan` until the interval of the points for errors is narrow enough or the cap is
    reached. Each variant's points are its mean share over the episodes run: what earned nothing because it failed
    counts like what earned nothing because it was wrong. When patience is lost, the rest of that round counts as
    failed; such points are a rule's and no sample's, and bear no interval.

    Parameters
    ----------
    submission : Submission
    assignment : Assignment
    server, reference_server : grader.sandbox.server.Server
    references : dict of str to list of Outcome
        Variant name to `reference_outcome` of its episodes 0, 1, ...: those of the `plan`, whose cap is their number.
    secret : bytes
    timing_turn : context manager
        Entered while CPU time is measured, so that not all cores measure at once.
    width : float
        In points.

    Returns
    -------
    Result
    """
    outcomes, interval, stopped = _run(submission, assignment, server, references, secret, width)
    variants = [
        _variant_result(variant, outcomes[variant.name], references[variant.name]) for variant in assignment.variants
    ]
    if assignment.speed and any(outcome.status == "ok" for episodes in outcomes.values() for outcome in episodes):
        with timing_turn:
            graded = outcomes[assignment.speed.variant]
            speed = measure_speed(server, reference_server, assignment, secret, submission.source, graded)
    else:
        speed = None
    error_points, speed_points = sum(variant.points for variant in variants), speed.points if speed else 0.0
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
        points=error_points + speed_points,
        max_points=assignment.points,
        variants=variants,
        speed=speed,
        trace=_trace(assignment, outcomes, references, secret),
        environment=environment(secret, server.tier),
        dimension=assignment.dimension,
        # It contains the mean, but in rare cases of an unlikely sequence the bets do not know that.
        interval=interval
        and [
            min(*interval, error_points) + speed_points,
            max(*interval, error_points) + speed_points,
        ],
        confidence=CONFIDENCE if interval else None,
        stopped=stopped,
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


def _run(submission, assignment, server, references, secret, width):
    """Outcomes by variant, an interval of the points for errors or None, and why episodes ended."""
    episodes = plan(assignment, sum(map(len, references.values())))
    variants = assignment.variants
    strata = np.array([variants.index(variant) for variant, _ in episodes])
    most = sum(variant.points for variant in variants)
    weights = np.array([variant.points for variant in variants]) / most
    outcomes = {variant.name: [] for variant in variants}
    shares, costly = [], 0
    first = soonest(width / most)
    low, high = 0.0, most
    for number, (variant, episode) in enumerate(episodes, 1):
        reference = references[variant.name][episode]
        outcome = evaluate(server, assignment, variant, episode, secret, submission.source, reference.draw)
        outcomes[variant.name].append(outcome)
        shares.append(_share(variant, outcome, reference))
        costly += outcome.status in ("timeout", "sandbox")
        if costly == PATIENCE:
            _give_up(assignment, outcomes, episodes, number)
            return outcomes, None, IMPATIENT
        # Before, a variant not yet seen may be worth anything.
        if number >= max(len(variants), first) or number == len(episodes):
            lower, upper = bounds(shares, strata, weights, width / most)
            low, high = max(low, most * float(lower)), min(high, most * float(upper))
            if high - low < width:
                return outcomes, (low, high), NARROW
    return outcomes, (low, high), CAPPED


def _give_up(assignment, outcomes, episodes, number):
    """Let the rest of a round fail, after this many episodes."""
    length = sum(variant.episodes for variant in assignment.variants)
    message = f"not run: {PATIENCE} earlier episodes ran out of time or broke the sandbox"
    for variant, _ in episodes[number : -(-number // length) * length]:
        outcomes[variant.name].append(Outcome("timeout", message, {}))


def _share(variant, outcome, reference):
    """What an episode earns of the variant's points, between 0 and 1."""
    earned = sum(
        criterion.points * criterion.score(outcome.values[criterion.metric], reference.values[criterion.metric])
        for criterion in variant.criteria
        if criterion.metric in outcome.values
    )
    return earned / variant.points if variant.points else 0.0


def _variant_result(variant, outcomes, references):
    references = references[: len(outcomes)]
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


def _trace(assignment, outcomes, references, secret):
    """The episode that went worst against the reference; None when none can be drawn."""
    candidates = [
        (variant, episode, outcome, references[variant.name][episode])
        for variant in assignment.variants
        for episode, outcome in enumerate(outcomes[variant.name])
    ]
    trace = {"posterior": _worst_run, "action": _worst_path}[assignment.answer]
    return trace(assignment, candidates, secret)


def _worst_run(assignment, candidates, secret):
    """Of an estimator, and of runs with one truth."""

    def rank(candidate):
        variant, _, outcome, reference = candidate
        metric = variant.criteria[0].metric
        # Finished episodes come first: a picture that ends early shows less.
        return outcome.status == "ok", np.mean(outcome.metrics[metric]) / reference.values[metric]

    def single(variant, episode):
        return recorded_run(assignment, variant, episode, secret).truth.ndim == 2

    drawable = [each for each in candidates if each[2].frames and single(*each[:2])]
    if not drawable:
        return None
    variant, episode, outcome, reference = max(drawable, key=rank)
    metric, truth = variant.criteria[0].metric, recorded_run(assignment, variant, episode, secret).truth
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


def _worst_path(assignment, candidates, secret):
    """Of a planner."""

    def rank(candidate):
        variant, _, outcome, reference = candidate
        if outcome.status == "ok":
            metric = variant.criteria[0].metric
            return False, outcome.values[metric] / reference.values[metric]
        # A failure comes first, and of failures the one that was farthest under way: where it hit what, one sees.
        return True, len(outcome.path)

    drawable = [each for each in candidates if len(each[2].path) > 1]
    if not drawable:
        return None
    variant, episode, outcome, reference = max(drawable, key=rank)
    picture = assignment.picture(simulated(assignment, variant, episode, secret, reference.draw))
    return Trace(
        variant=variant.name,
        episode=episode,
        metric=DISTANCE,
        error=outcome.distances,
        reference_error=reference.distances,
        truth=[outcome.path, reference.path],
        frames=[{"step": step, "particles": []} for step in range(max(len(outcome.path), len(reference.path)))],
        picture=picture | {"targets": ["submission", "reference"]},
    )
