"""Grading one submission: what it earns, what it loses, and why."""

import contextlib
from dataclasses import replace
from pathlib import Path

import pytest

from course_lib.vacuum.constants import Constants, Hidden
from grader.assignment import Criterion, Speed, Uniform, Variant
from grader.assignments import assignments
from grader.grading.grade import IMPATIENT, PATIENCE, grade, reference_outcome
from grader.grading.secret import new_secret, read_secret
from grader.intake.submission import Submission
from grader.result import Result
from grader.sandbox.server import Server

SECRET = b"a secret of the tests"
GOOD = (Path(__file__).parents[2] / "submissions/vacuum/good_plain.py").read_text()

CRITERIA = (Criterion("best half", 4.0, 1.6, 3.0), Criterion("energy score", 1.0, 1.6, 3.0))
SHORT = replace(
    assignments()["vacuum"],
    variants=(
        Variant("default", "as it is", Constants(), Hidden(steps=25), 2, CRITERIA),
        Variant("mirror", "ideal reflections", Constants(v_bar=0.0), Hidden(steps=25), 2, CRITERIA),
    ),
    speed=Speed("default", steps=20, points=5.0, full=3.0, none=6.0),
    deadline=1.0,
)


@contextlib.contextmanager
def judging(assignment, secret):
    """Grades a source against an assignment, in one whole round of its episodes."""
    with Server(preload=("course_lib.vacuum.constants",)) as server, Server(trusted=assignment.reference) as trusted:
        references = {
            variant.name: [
                reference_outcome(trusted, assignment, variant, episode, secret) for episode in range(variant.episodes)
            ]
            for variant in assignment.variants
        }

        def judge(source):
            submission = Submission("ana", "ana.py", source)
            turn = contextlib.nullcontext()
            return grade(submission, assignment, server, trusted, references, secret, turn, width=0.1)

        yield judge


@pytest.fixture(scope="module")
def judge():
    """Grade a source against the short assignment."""
    with judging(SHORT, SECRET) as judge:
        yield judge


def broken(condition, then):
    """The good filter, in which `then` happens on `condition`."""
    return f"{GOOD}\n_good = Estimator\n\n\ndef Estimator(previous, observation, control, constants, rng):\n" + (
        f"    if {condition}:\n        {then}\n    return _good(previous, observation, control, constants, rng)\n"
    )


def test_a_good_filter_earns_full_marks_and_explains_itself(judge):
    result = judge(GOOD)
    assert result.points == pytest.approx(result.max_points, abs=0.2)
    assert result.message == ""
    assert [episode.status for variant in result.variants for episode in variant.episodes] == ["ok"] * 4
    assert result.speed.status == "ok" and result.speed.ratio > 0
    trace = result.trace
    assert len(trace.error) == len(trace.reference_error) == len(trace.truth[0]) == 26
    assert [frame["step"] for frame in trace.frames] == [0, 5, 10, 15, 20, 25]
    assert Result.from_json(result.to_json()) == result


def without_time(result):
    """What is the submission's alone."""
    low, high = result.interval
    return replace(
        result,
        points=0.0,
        speed=None,
        interval=[round(low - result.speed.points, 9), round(high - result.speed.points, 9)],
    )


def test_a_grade_repeats_bit_for_bit(judge):
    first, second = judge(GOOD), judge(GOOD)
    assert without_time(first) == without_time(second)


def test_drawn_variants_repeat_bit_for_bit_from_the_file_of_the_secret(tmp_path):
    wide = {"L": Uniform(3.0, 9.0), "slowest": Uniform(0.2, 1.0)}
    default = SHORT.variants[0]
    declared = replace(SHORT, variants=(default, replace(default, name="drawn", constants=Constants(), ranges=wide)))
    new_secret(tmp_path / "ours")
    new_secret(tmp_path / "another")

    def graded(name):
        secret = read_secret(tmp_path / name)
        with judging(declared.under(secret), secret) as judge:
            return without_time(judge(GOOD))

    first, again, other = graded("ours"), graded("ours"), graded("another")
    assert first.to_json() == again.to_json()
    assert first.variants[1].drawn.keys() == wide.keys()
    assert first.environment["secret"] != other.environment["secret"]
    for name in wide:
        assert first.variants[1].drawn[name] != other.variants[1].drawn[name]
    for ours, theirs in zip(first.variants, other.variants, strict=True):
        assert all(a.reference != b.reference for a, b in zip(ours.episodes, theirs.episodes, strict=True))


def test_what_was_drawn_is_in_the_record_and_in_no_line_for_students():
    secret = b"a secret with another room"
    declared = replace(SHORT, variants=(replace(SHORT.variants[0], ranges={"L": Uniform(6.0, 9.0)}),))
    with judging(declared.under(secret), secret) as judge:
        result = judge(broken("observation is not None", "return None"))
    [variant] = result.variants
    assert 6.0 <= variant.drawn["L"] <= 9.0
    lines = [result.message, variant.title, *(episode.message for episode in variant.episodes)]
    assert not any(str(variant.drawn["L"]) in line for line in lines)


SURE = """import numpy as np
from course_lib.filters import Gaussian


def Estimator(previous, observation, control, constants, rng):
    return Gaussian(np.array([1.0, 1.0, 0.0, 4.0, 4.0, 0.0]), {covariance})
"""


@pytest.mark.parametrize(
    ("covariance", "low", "high"), [("np.diag([4.0, 4.0, 9.0] * 2)", 0.5, 12.0), ("np.zeros((6, 6))", 1e8, 1e9)]
)
def test_gaussians_have_their_nees_and_are_not_failed_by_it(judge, covariance, low, high):
    result = judge(SURE.format(covariance=covariance))
    assert result.dimension == 6
    for episode in (episode for variant in result.variants for episode in variant.episodes):
        assert episode.status == "ok" and low <= episode.values["NEES"] <= high
        assert "energy score" in episode.values and "NEES" not in episode.reference
    assert Result.from_json(result.to_json()) == result


def test_points_for_time_move_the_interval(judge):
    result = judge(GOOD)
    low, high = result.interval
    assert low <= result.points <= high <= 10.0 + result.speed.points
    assert low >= result.speed.points


def test_a_crash_costs_the_episodes_it_happens_in(judge):
    result = judge(broken("constants.v_bar == 0.0 and previous is not None", "raise KeyError('lost')"))
    default, mirror = result.variants
    assert default.points == pytest.approx(default.max_points, abs=0.1)
    assert mirror.points == 0.0
    assert [episode.status for episode in mirror.episodes] == ["crashed"] * 2
    assert "KeyError" in result.message and "2 of 4 episodes failed" in result.message


def test_a_crash_in_every_episode_earns_nothing(judge):
    result = judge("def Estimator(previous, observation, control, constants, rng):\n    return 1 / 0\n")
    assert result.points == 0.0
    assert result.speed is None and result.trace is None
    assert "ZeroDivisionError" in result.message


def test_not_a_number_earns_nothing_however_it_is_compared(judge):
    result = judge(broken("observation is not None", "return np.full((10, 6), np.nan)"))
    assert sum(variant.points for variant in result.variants) == 0.0
    assert result.variants[0].episodes[0].status == "invalid posterior"


def test_finite_numbers_too_large_to_measure_earn_nothing_and_can_be_written(judge):
    result = judge(broken("observation is not None", "return np.full((10, 6), 1e200)"))
    assert sum(variant.points for variant in result.variants) == 0.0
    assert "the states reach 1e+200" in result.message
    assert Result.from_json(result.to_json()) == result


def test_patience_ends(judge):
    result = judge(broken("previous is not None", "import time; time.sleep(60)"))
    first, second = ([variant.episodes[i].message for variant in result.variants] for i in range(PATIENCE))
    assert all("longer than 1 s" in message for message in first)
    assert all("not run" in message for message in second)
    assert result.points == 0.0
    # The rest earns nothing by a rule, whatever chance would have had it earn.
    assert result.stopped == IMPATIENT and result.interval is None and result.confidence is None


def test_killing_the_fork_server_earns_nothing_and_harms_nobody(judge):
    killer = judge(broken("previous is not None", "import os; os.kill(os.getppid(), 9)"))
    assert killer.points == 0.0
    # Where the tier does not forbid it, it breaks a sandbox that is its own.
    assert "sandbox broke" in killer.message or "PermissionError" in killer.message
    assert judge(GOOD).points == pytest.approx(10.0 + SHORT.speed.points, abs=0.2)


def test_a_wrong_filter_loses_points(judge):
    wrong = GOOD.replace("Estimator", "_unused", 1) + (
        "\n\ndef Estimator(previous, observation, control, constants, rng):\n"
        "    states = np.zeros((500, 6))\n"
        "    states[:, [0, 1, 3, 4]] = constants.L * rng.random((500, 4))\n"
        "    return states\n"
    )
    result = judge(wrong)
    assert sum(variant.points for variant in result.variants) < 0.2 * 10.0


def test_work_is_charged_and_waiting_is_not(judge):
    waiting = judge(broken("previous is not None", "import time; time.sleep(0.02)"))
    assert waiting.speed.points == waiting.speed.max_points
    working = judge(broken("previous is not None", "sum(range(5_000_000))"))
    assert working.speed.points == 0.0
    # Hopeless after the first pair, so that the others are not run.
    assert len(working.speed.ratios) == 1


def test_background_work_is_charged(judge):
    thread = "import threading\n\n\ndef _burn():\n    while True:\n        sum(range(100))\n\n\n"
    source = broken("previous is None", "threading.Thread(target=_burn, daemon=True).start()")
    assert judge(thread + source).speed.ratio > 2 * judge(GOOD).speed.ratio


def test_a_reference_that_fails_stops_the_grading():
    impossible = replace(SHORT.variants[0], constants=replace(Constants(), w_bar=1e-9))
    failing = replace(SHORT, reference="course_lib.vacuum.world:World")
    with Server(trusted=failing.reference) as trusted, pytest.raises(RuntimeError, match="the reference of assignment"):
        reference_outcome(trusted, failing, impossible, 0, SECRET)
