"""A result survives being written and read."""

from dataclasses import replace

import pytest

from grader.result import CriterionResult, Episode, Result, SpeedResult, Trace, VariantResult

RESULT = Result(
    submission="ana/x",
    path="class/ana/x.py",
    digest="00",
    assignment="vacuum",
    status="graded",
    message="",
    points=7.5,
    max_points=10.0,
    variants=[
        VariantResult(
            name="default",
            title="as it is",
            criteria=[CriterionResult("error", 7.5, 10.0, 1.5, 3.0, 0.5, 0.3)],
            episodes=[
                Episode(0, "ok", "", {"error": 0.5}, {"error": 0.3}),
                Episode(1, "crashed", "KeyError: 1", {}, {"error": 0.3}),
            ],
        )
    ],
    speed=SpeedResult("ok", "", 2.0, 1.0, [2.1, 1.9, 5.0], 3.0, 5.0, 10.0, 60.0),
    trace=Trace("default", 0, "error", [0.1], [0.2], [[[0.0, 1.0]]], [{"step": 0, "particles": [[[0.0, 1.0]]]}], {}),
    interval=[6.0, 9.5],
    confidence=0.95,
    stopped="the cap is reached",
)


def test_json_round_trip():
    assert Result.from_json(RESULT.to_json()) == RESULT


def test_sums_and_median():
    assert RESULT.variants[0].points == 7.5
    assert RESULT.variants[0].max_points == 10.0
    assert RESULT.speed.ratio == 2.1
    assert RESULT.episodes == 2


def test_numbers_that_json_does_not_have_are_not_written():
    with pytest.raises(ValueError):
        replace(RESULT, points=float("nan")).to_json()
