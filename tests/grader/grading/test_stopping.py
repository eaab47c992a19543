"""When episodes end, and what the interval says then: of outcomes that are written down here, without a sandbox."""

import contextlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import grader.grading.grade as grading
from course_lib.vacuum.constants import Constants, Hidden
from grader.assignment import Criterion, Variant
from grader.assignments import assignments
from grader.grading.evaluate import Outcome
from grader.grading.grade import CAPPED, IMPATIENT, NARROW, grade, most_episodes, plan
from grader.intake.submission import Submission

#: 60 points for errors in rounds of six episodes, a, b, c, a, a, b by turns.
ASSIGNMENT = replace(
    assignments()["vacuum"],
    variants=tuple(
        Variant(name, name, Constants(), Hidden(), episodes, (Criterion("error", 10.0 * episodes, 1.0, 2.0),))
        for name, episodes in (("a", 3), ("b", 2), ("c", 1))
    ),
    speed=replace(assignments()["vacuum"].speed, variant="a"),
)


def outcome(share):
    """Of an episode that earns this share, where the reference's error is 1; or that ends as the word says."""
    if isinstance(share, str):
        return Outcome(share, "it failed", {})
    return Outcome("ok", "", {"error": np.array([2.0 - share])})


@pytest.fixture
def judge(monkeypatch):
    """Grade whoever earns `shares(variant name, episode)`, with no points for time."""

    def judge(shares, cap=60, width=15.0):
        ran = []

        def evaluate(server, assignment, variant, episode, secret, source, draw):
            ran.append((variant.name, episode))
            return outcome(shares(variant.name, episode))

        monkeypatch.setattr(grading, "evaluate", evaluate)
        monkeypatch.setattr(grading, "measure_speed", lambda *arguments: None)
        references = {variant.name: [] for variant in ASSIGNMENT.variants}
        for variant, _ in plan(ASSIGNMENT, cap):
            references[variant.name].append(outcome(1.0))
        server, turn = SimpleNamespace(tier=0), contextlib.nullcontext()
        result = grade(Submission("ana", "ana.py", ""), ASSIGNMENT, server, None, references, b"key", turn, width)
        assert ran == [(variant.name, episode) for variant, episode in plan(ASSIGNMENT, cap)][: len(ran)]
        return result

    return judge


@pytest.mark.parametrize("assignment", [ASSIGNMENT, assignments()["vacuum"]], ids=["short", "vacuum"])
def test_the_plan_visits_every_variant_first_and_keeps_to_the_proportions_of_a_round(assignment):
    cap = most_episodes(assignment)
    episodes = plan(assignment, cap)
    firsts = {variant.name for variant, _ in episodes[: len(assignment.variants)]}
    assert firsts == {variant.name for variant in assignment.variants}
    for variant in assignment.variants:
        numbers = [episode for other, episode in episodes if other is variant]
        assert numbers == list(range(2 * variant.episodes))
    # A higher cap adds episodes and changes none.
    assert plan(assignment, cap + 10)[:cap] == episodes


def test_episodes_of_a_variant_are_interleaved_with_the_others():
    assert "".join(variant.name for variant, _ in plan(ASSIGNMENT, 8)) == "abcabaab"


@pytest.mark.parametrize("share", [0.0, 1.0, "crashed"])
def test_who_is_always_as_good_is_known_soon(judge, share):
    wide, narrow = (judge(lambda variant, episode: share, width=width) for width in (15.0, 6.0))
    assert wide.stopped == narrow.stopped == NARROW
    assert 3 <= wide.episodes < narrow.episodes < 60
    for result, width in ((wide, 15.0), (narrow, 6.0)):
        low, high = result.interval
        assert low <= result.points <= high < low + width
        assert result.points == (60.0 if share == 1.0 else 0.0) and result.points in (low, high)
        assert result.confidence == 0.95


def test_who_varies_is_run_to_the_cap(judge):
    result = judge(lambda variant, episode: float(episode % 2))
    low, high = result.interval
    assert result.stopped == CAPPED and result.episodes == 60
    assert low < 30.0 - 7.5 and high > 30.0 + 7.5 and result.points == 30.0


def test_each_variant_counts_what_it_is_worth_however_often_it_was_seen(judge):
    result = judge(lambda variant, episode: float(variant == "a"), cap=7, width=0.1)
    assert [len(variant.episodes) for variant in result.variants] == [4, 2, 1]
    assert result.points == pytest.approx(30.0)


def test_every_variant_is_seen_however_wide_the_interval_may_be(judge):
    result = judge(lambda variant, episode: 1.0, width=1000.0)
    assert result.stopped == NARROW
    assert [len(variant.episodes) for variant in result.variants] == [1, 1, 1]


def test_when_patience_is_lost_the_rest_of_the_round_fails(judge):
    def shares(variant, episode):
        return "timeout" if variant == "b" and episode >= 2 else 1.0

    result = judge(shares, width=0.1)
    a, b, c = result.variants
    assert result.stopped == IMPATIENT and result.interval is None and result.confidence is None
    assert result.episodes == 12
    assert [episode.status for episode in b.episodes] == ["ok", "ok", "timeout", "timeout"]
    assert b.points == 10.0 and c.points == 10.0
    assert sum("not run" in episode.message for episode in a.episodes) == 6 - round(a.points / 5.0)


def test_patience_that_is_lost_at_once_leaves_nothing(judge):
    result = judge(lambda variant, episode: "timeout")
    assert result.stopped == IMPATIENT and result.points == 0.0 and result.episodes == 6
    assert "6 of 6 episodes failed" in result.message
    assert sum("not run" in e.message for variant in result.variants for e in variant.episodes) == 4


def test_narrowing_is_what_a_longer_look_would_have_seen(judge):
    """Whether one stops early or not, the first episodes are the same, and the interval only shrinks."""
    rng = np.random.default_rng(1)
    drawn = {name: rng.random(40) ** 0.2 for name in "abc"}
    results = [judge(lambda variant, episode: drawn[variant][episode], width=width) for width in (25.0, 15.0, 0.1)]
    for early, late in zip(results, results[1:], strict=False):
        assert early.episodes < late.episodes
        assert late.interval[0] >= early.interval[0] and late.interval[1] <= early.interval[1]
        for one, other in zip(early.variants, late.variants, strict=True):
            assert one.episodes == other.episodes[: len(one.episodes)]
