"""Grading one submission: what it earns, what it loses, and why."""

import contextlib
from dataclasses import replace
from pathlib import Path

import pytest

from course_lib.vacuum.constants import Constants, Hidden
from grader.assignment import Criterion, Speed, Variant
from grader.assignments import assignments
from grader.grade import PATIENCE, grade, reference_outcomes
from grader.result import Result
from grader.sandbox.server import Server
from grader.submission import Submission

SECRET = b"a secret of the tests"
GOOD = (Path(__file__).parents[1] / "submissions/vacuum/good_plain.py").read_text()

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


@pytest.fixture(scope="module")
def judge():
    """Grade a source against the short assignment."""
    with Server(preload=("course_lib.vacuum.constants",)) as server, Server(trusted=SHORT.reference) as trusted:
        references = {variant.name: reference_outcomes(trusted, SHORT, variant, SECRET) for variant in SHORT.variants}

        def judge(source):
            submission = Submission("ana", "ana.py", source)
            return grade(submission, SHORT, server, trusted, references, SECRET, contextlib.nullcontext())

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


def test_a_grade_repeats_bit_for_bit(judge):
    first, second = judge(GOOD), judge(GOOD)
    # CPU time is the machine's, everything else is the submission's.
    assert replace(first, points=0.0, speed=None) == replace(second, points=0.0, speed=None)


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
    messages = [episode.message for variant in result.variants for episode in variant.episodes]
    assert all("longer than 1 s" in message for message in messages[:PATIENCE])
    assert all("not run" in message for message in messages[PATIENCE:])
    assert result.points == 0.0


def test_killing_the_fork_server_earns_nothing_and_harms_nobody(judge):
    killer = judge(broken("previous is not None", "import os; os.kill(os.getppid(), 9)"))
    assert killer.points == 0.0
    assert "sandbox broke" in killer.message
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
        reference_outcomes(trusted, failing, impossible, SECRET)
