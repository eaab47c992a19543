"""Time: the rule that decides, fed with numbers, and the ways in which measuring ends. Nothing here has to be fast."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course_lib.filters import equally_weighted
from course_lib.recording import Run
from grader.assignment import Criterion, EstimatorAssignment, Speed, Variant
from grader.grading.evaluate import Outcome
from grader.grading.timing import (
    MOST_PAIRS,
    NOISE,
    PAIRS,
    WARM_UP,
    Pair,
    bounds,
    changed,
    goes_on,
    measure_speed,
    share,
)
from grader.sandbox.program import Escape, SandboxError, StudentError

SPEED = Speed("default", steps=100, points=8.0, full=5.0, none=25.0)
RATIOS = st.lists(st.floats(0.01, 1000.0), min_size=1, max_size=MOST_PAIRS)


# The rule


def test_bounds_are_students_t_on_the_logarithms():
    # t quantiles of a table: 2.920 for two degrees of freedom, 1.943 for six.
    logs = np.array([-0.02, 0.0, 0.02])
    np.testing.assert_allclose(np.log(bounds(np.exp(logs))), [-2.920 * 0.02 / 3**0.5, 2.920 * 0.02 / 3**0.5], rtol=1e-3)
    logs = 1.0 + 0.01 * np.array([-3, -2, -1, 0, 1, 2, 3])
    half = 1.943 * logs.std(ddof=1) / 7**0.5
    np.testing.assert_allclose(np.log(bounds(np.exp(logs))), [1.0 - half, 1.0 + half], rtol=1e-3)


def test_one_pair_is_as_doubtful_as_the_noisiest_machine():
    np.testing.assert_allclose(bounds([10.0]), [10.0 * np.exp(-1.645 * NOISE), 10.0 * np.exp(1.645 * NOISE)], rtol=1e-3)


@given(RATIOS)
def test_the_median_lies_between_the_bounds(ratios):
    lower, upper = bounds(ratios)
    assert lower <= np.median(ratios) * (1 + 1e-12) and np.median(ratios) <= upper * (1 + 1e-12)


@given(RATIOS, st.floats(0.1, 10.0))
def test_bounds_are_ratios_whatever_the_unit(ratios, factor):
    np.testing.assert_allclose(bounds(factor * np.array(ratios)), factor * np.array(bounds(ratios)), rtol=1e-9)


def test_at_the_limit_points_are_lost_once_in_twenty_times():
    # 5 000 programs exactly at the ratio up to which time costs nothing, seven pairs with 3 % noise: a lower bound
    # above the limit is false. Binomial with p = 0.05: 6.6 % would be five standard deviations; the seed is fixed.
    rng = np.random.default_rng(1)
    logs = np.log(SPEED.full) + 0.03 * rng.standard_normal((5_000, MOST_PAIRS))
    lost = np.mean([share(SPEED, bounds(np.exp(row))[0]) < 1.0 for row in logs])
    assert lost < 0.066


def test_stopping_after_three_pairs_does_not_make_it_more():
    # The whole rule, with the look after three pairs.
    rng = np.random.default_rng(2)
    for ratio in (SPEED.full / 1.2, SPEED.full / 1.1, SPEED.full):
        lost = 0
        for _ in range(1_500):
            ratios = []
            while goes_on(SPEED, ratios):
                ratios.append(float(ratio * np.exp(0.05 * rng.standard_normal())))
            lost += share(SPEED, bounds(ratios)[0]) < 1.0
        assert lost / 1_500 < 0.079  # five standard deviations above 5 %


def test_being_erratic_earns_no_benefit_of_doubt():
    # Slow in every other run, on purpose: without `NOISE` the lower bound would be 3.3, which earns everything.
    erratic = [4.0, 40.0, 4.0, 40.0, 4.0, 40.0, 40.0]
    assert share(SPEED, bounds(erratic)[0]) < 0.65
    assert bounds([40.0, 40.0, 40.0, 40.0, 40.0, 40.0, 1.0])[0] > 20.0


def test_share_is_linear_between_the_limits():
    assert [share(SPEED, ratio) for ratio in (0.1, 5.0, 15.0, 25.0, 1e9)] == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0])


@pytest.mark.parametrize(
    ("ratios", "due"),
    [
        ([], True),
        ([1.0], True),
        ([30.0, 30.0], True),
        # Hopeless at once; or only in one of two runs, which is no reason to stop.
        ([51.0], False),
        ([51.0, 51.0], False),
        ([1.0, 51.0], True),
        # Clear in three.
        ([1.0, 1.01, 1.02], False),
        ([4.0, 4.1, 4.2], False),
        ([60.0, 60.0, 1.0], True),
        ([15.0, 15.1, 15.2], False),
        ([45.0, 30.0, 48.0], False),
        # Near the limit on either side, however sharp.
        ([4.5, 4.5, 4.5], True),
        ([5.6, 5.6, 5.6], True),
        # Half a point hangs on it.
        ([14.0, 15.0, 16.0], True),
        ([24.0, 20.0, 26.0], True),
        # Seven it is then, and no more.
        ([14.0, 15.0, 16.0, 15.0], True),
        ([14.0, 15.0, 16.0, 20.0, 14.0, 15.0, 16.0], False),
    ],
)
def test_pairs_go_on_while_something_hangs_on_them(ratios, due):
    assert goes_on(SPEED, ratios) is due


@given(RATIOS)
def test_no_more_than_seven_pairs(ratios):
    assert not goes_on(SPEED, (ratios * MOST_PAIRS)[:MOST_PAIRS])


def test_limits_that_noise_could_decide_are_refused():
    with pytest.raises(ValueError, match="at least 2, the second larger"):
        Speed("default", steps=100, points=8.0, full=1.5, none=3.0)
    with pytest.raises(ValueError, match="at least 2, the second larger"):
        Speed("default", steps=100, points=8.0, full=3.0, none=3.0)
    with pytest.raises(ValueError, match="too few to time"):
        Speed("default", steps=5, points=8.0, full=2.0, none=3.0)


def pairs_and_outcomes(before, now):
    """Timed runs and graded ones with these errors at all steps."""
    pairs = [Pair(1.0, 1.0, [{"error": error}] * 3) for error in now]
    return pairs, [Outcome("ok", "", {"error": np.full(20, error)}) for error in before]


@pytest.mark.parametrize(
    ("before", "now", "factor"),
    [
        ([0.3, 0.4, 0.5], [0.3, 0.4, 0.5], 1.0),
        ([0.3, 0.4, 0.5], [0.6, 0.8, 1.0], 2.0),
        # A target lost in one run of three, or of two, is bad luck.
        ([0.3, 0.4, 0.5], [0.3, 4.0, 0.5], 1.0),
        ([0.3, 0.4], [0.3, 4.0], 1.0),
        ([0.3], [4.0], None),
        ([], [4.0, 4.0], None),
        ([0.0, 0.0], [0.0, 0.0], 0.0),
    ],
)
def test_who_is_worse_when_timed_is_told_by_the_median_run(before, now, factor):
    result = changed(*pairs_and_outcomes(before, now), ["error"])
    assert result == (None if factor is None else pytest.approx(factor))


def test_runs_that_failed_when_graded_are_not_compared():
    pairs, outcomes = pairs_and_outcomes([0.3, 0.3, 0.3], [0.3, 9.0, 9.0])
    outcomes[2] = Outcome("crashed", "", {})
    assert changed(pairs, outcomes, ["error"]) == pytest.approx(1.0)


# Measuring


def simulate(variant, rng):
    """A point that stands still, and a reading that says nothing."""
    truth = np.zeros((41, 2))
    return Run(truth=truth, observations=np.zeros((40, 1)), controls=np.zeros((40, 1)))


def measure(particles, truth, rng):
    return {"error": float(np.abs(particles.states - truth).mean())}


STILL = EstimatorAssignment(
    name="still",
    title="A point that stands still",
    entry_point="Estimator",
    reference="nobody:imports",
    simulate=simulate,
    measure=measure,
    dimension=2,
    angles=(),
    picture=None,
    positions=((0, 1),),
    variants=(Variant("default", "as it is", None, None, 4, (Criterion("error", 5.0, 2.0, 4.0),)),),
    speed=replace(SPEED, steps=40),
    withheld=(),
    deadline=1.0,
)


class Clockwork:
    """A fork server whose programs use the CPU time they are told to, each update, and no other.

    `costs` gives a program's seconds per update from its number and the update's; `answers` its posterior.
    """

    def __init__(self, costs, answers=lambda program, k: np.full((4, 2), 0.1), breaks=()):
        self.costs, self.answers, self.breaks = costs, answers, set(breaks)
        self.started, self.log = 0, []

    def start(self, program, limits, *, dimension):
        self.started += 1
        return ClockworkWorker(self, self.started - 1)


class ClockworkWorker:
    def __init__(self, server, number):
        self.server, self.number, self.k, self.used, self.running = server, number, 0, 100.0, True

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.server.log.append(("closed", self.number))

    def pin(self, core):
        self.server.log.append(("pinned", core))

    def step(self, observation, control):
        assert self.running
        if self.number in self.server.breaks and self.k == 8:
            raise SandboxError("the fork server died")
        self.server.log.append(("step", self.k))
        self.used += self.server.costs(self.number, self.k)
        answer = self.server.answers(self.number, self.k)
        self.k += 1
        if isinstance(answer, Exception):
            raise answer
        return equally_weighted(answer)

    def cpu_seconds(self):
        return self.used

    def stop(self):
        self.running = False

    def cont(self):
        self.running = True


def timed(costs, assignment=STILL, graded=(), **how):
    """The result for a program that costs this against one that costs a millisecond, and both servers."""
    servers = Clockwork(costs, **how), Clockwork(lambda program, k: 1e-3)
    return measure_speed(*servers, assignment, b"secret", "", graded), *servers


def test_the_ratio_is_that_of_the_updates_after_the_warm_up():
    # Loading, the first call and what is compiled in the first updates cost a hundred times more.
    result, _, _ = timed(lambda program, k: 0.002 if k > WARM_UP else 0.2)
    assert result.ratios == pytest.approx([2.0] * PAIRS)
    assert result.ratio == pytest.approx(2.0) and result.bound == pytest.approx(2.0)
    assert result.milliseconds == pytest.approx(2.0) and result.reference_milliseconds == pytest.approx(1.0)
    assert (result.status, result.points, result.max_points) == ("ok", 8.0, 8.0)


def test_each_pair_has_fresh_processes_on_one_core():
    _, students, references = timed(lambda program, k: 0.002)
    for server in (students, references):
        assert server.started == PAIRS == sum(entry[0] == "closed" for entry in server.log)
    cores = [[core for word, core in server.log if word == "pinned"] for server in (students, references)]
    assert cores[0] == cores[1]


def test_the_student_is_stopped_while_the_reference_runs():
    students = Clockwork(lambda program, k: 0.002)
    halted = []
    make = students.start
    students.start = lambda *arguments, **words: halted.append(make(*arguments, **words)) or halted[-1]
    references = Clockwork(lambda program, k: 1e-3 if not halted[-1].running else pytest.fail("the student runs"))
    assert measure_speed(students, references, STILL, b"secret", "").status == "ok"


def test_near_the_limit_there_are_seven_pairs_and_the_bound_is_what_counts():
    noise = [0.9, 1.1, 1.0, 0.95, 1.15, 1.0, 1.08]
    result, _, _ = timed(lambda program, k: 0.0051 * noise[program])
    assert len(result.ratios) == MOST_PAIRS
    assert result.ratio > STILL.speed.full > result.bound
    assert result.points == result.max_points


def test_in_the_middle_the_points_are_those_of_the_bound():
    result, _, _ = timed(lambda program, k: 0.015 * (1.0 + 0.01 * (program - 1)))
    assert len(result.ratios) == PAIRS
    assert result.points == pytest.approx(8.0 * share(STILL.speed, result.bound)) and 4.0 < result.points < 4.3


def test_a_hopeless_program_is_stopped_early():
    result, students, _ = timed(lambda program, k: 0.06)
    assert result.ratios == [pytest.approx(60.0)] and result.points == 0.0
    assert max(k for word, k in students.log if word == "step") < STILL.speed.steps


def test_hopeless_in_one_run_only_is_weighed_with_the_others():
    result, _, _ = timed(lambda program, k: 0.06 if program == 1 else 0.002)
    assert len(result.ratios) > PAIRS - 1 and result.ratio == pytest.approx(2.0)


def test_who_fails_when_timed_earns_nothing_for_time():
    def answers(program, k):
        return StudentError("crashed", "KeyError") if program == 1 and k == 20 else np.zeros((4, 2))

    result, students, references = timed(lambda program, k: 0.001, answers=answers)
    assert (result.status, result.message, result.points) == ("crashed", "KeyError", 0.0)
    assert result.ratios == [] and result.bound is None and result.ratio is None
    # Nothing is left behind.
    assert ("closed", 1) in students.log and ("closed", 1) in references.log


def test_a_sandbox_that_breaks_once_is_forgiven_and_twice_is_not():
    result, _, _ = timed(lambda program, k: 0.001, breaks=[1])
    assert (result.status, len(result.ratios)) == ("ok", PAIRS)
    result, _, _ = timed(lambda program, k: 0.001, breaks=[1, 2])
    assert (result.status, result.points) == ("sandbox", 0.0) and "sandbox broke" in result.message


def test_what_outlives_a_program_is_not_forgiven():
    def answers(program, k):
        return Escape("a program had started processes") if program == 0 else np.zeros((4, 2))

    result, students, _ = timed(lambda program, k: 0.001, answers=answers)
    assert (result.status, students.started) == ("sandbox", 1)


def test_waiting_is_cut_short(monkeypatch):
    # A clock on the wall that only the student's calls move: nobody has to wait for this test.
    clock = [0.0]
    monkeypatch.setattr("grader.grading.timing.time.monotonic", lambda: clock[0])

    def costs(program, k):
        clock[0] += 3.0
        return 0.001

    result, students, _ = timed(costs)
    assert (result.status, result.points) == ("timeout", 0.0) and "waited" in result.message
    assert len(students.log) < 20


def test_short_cuts_while_the_clock_runs_earn_nothing():
    graded = [Outcome("ok", "", {"error": np.full(41, 0.1)}) for _ in range(4)]
    honest, _, _ = timed(lambda program, k: 0.002, graded=graded)
    assert honest.status == "ok" and honest.points == 8.0
    result, _, _ = timed(lambda program, k: 0.002, graded=graded, answers=lambda program, k: np.full((4, 2), 0.3))
    assert (result.status, result.points) == ("inconsistent", 0.0)
    assert "3 times as large" in result.message


def test_one_that_was_as_bad_when_graded_takes_no_short_cut():
    graded = [Outcome("ok", "", {"error": np.full(41, 0.3)}) for _ in range(4)]
    result, _, _ = timed(lambda program, k: 0.002, graded=graded, answers=lambda program, k: np.full((4, 2), 0.3))
    assert result.status == "ok"
