"""Coverage and NEES: who is called overconfident, and how rarely that is wrong."""

import numpy as np
import pytest
from scipy.stats import chi2

from grader.reports.calibration import FALSE_ALARM, calibrations, consistency, coverage
from grader.result import COVERAGE, NEES, Episode, VariantResult


def episodes(values, references=None, metric=COVERAGE):
    references = [0.9] * len(values) if references is None else references
    return [
        Episode(i, "ok", "", {metric: value}, {COVERAGE: reference})
        for i, (value, reference) in enumerate(zip(values, references, strict=True))
    ]


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ([0.01, 0.0, 0.02], "overconfident"),
        ([0.5] * 6, "overconfident"),
        ([0.8] * 60, "overconfident"),
        ([0.95, 0.9, 0.85] * 20, ""),
        ([0.01], ""),
        ([1.0] * 6, ""),
        ([1.0] * 60, "overcautious"),
        ([0.0] * 5000, "overconfident"),
    ],
)
def test_verdicts(values, verdict):
    assert coverage(episodes(values)).verdict == verdict


def test_nobody_is_blamed_for_what_the_reference_does_too():
    assert coverage(episodes([0.5] * 50, [0.5] * 50)).verdict == ""
    assert coverage(episodes([1.0] * 90, [0.99] * 90)).verdict == ""
    assert coverage(episodes([0.1] * 50, [0.5] * 50)).verdict == "overconfident"
    assert coverage(episodes([0.6] * 4, [1.0] * 4)).expected == "1.00"


@pytest.mark.parametrize("run_length", [1, 20])
def test_a_calibrated_filter_is_rarely_blamed_however_long_its_errors_last(run_length):
    # 400 classes' filters of 60 episodes of 100 steps, looked at after every tenth. Each may be blamed for either fault
    # with probability 0.01: more than 26 of 400 with probability 1e-7. Fixed seed.
    rng = np.random.default_rng(61)
    blamed = 0
    for _ in range(400):
        hits = np.repeat(rng.random((60, 100 // run_length)) < 0.9, run_length, axis=1).mean(axis=1)
        blamed += any(coverage(episodes(hits[:n], rng.uniform(0.85, 0.95, n))).verdict for n in range(10, 61, 10))
    assert blamed <= 26


def test_consistency_has_chi_square_bounds():
    found = consistency(episodes([6.0, 5.0, 7.0], metric=NEES), 6)
    low, high = chi2(18).ppf([FALSE_ALARM, 1.0 - FALSE_ALARM]) / 3.0
    assert found.value == pytest.approx(6.0) and found.verdict == ""
    assert found.expected == f"{low:.3g} to {high:.3g}"
    assert consistency(episodes([high + 0.1] * 3, metric=NEES), 6).verdict == "overconfident"
    assert consistency(episodes([low - 0.1] * 3, metric=NEES), 6).verdict == "overcautious"


def test_nothing_measured_is_nothing_said():
    failed = [Episode(0, "crashed", "", {}, {COVERAGE: 0.9})]
    assert coverage(failed) is None and consistency(failed, 6) is None and coverage([]) is None
    assert calibrations([VariantResult("a", "", [], failed)], 6) == []
    mixed = VariantResult("a", "", [], failed + episodes([0.7]))
    assert [found.metric for found in calibrations([mixed], 6)] == [COVERAGE]
    assert coverage(failed + episodes([0.7])).value == pytest.approx(0.7)
