"""Planners: graded in closed loop, each way of failing with its line, and by the same isolation as estimators."""

import contextlib
import io
import time
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from course_lib.vacuum.constants import Constants
from grader import doctor
from grader.assignment import Criterion, Variant, episode_seed
from grader.grading.evaluate import evaluate, preload, program, simulated
from grader.grading.grade import CAPPED, DISTANCE, IMPATIENT, grade, most_episodes, plan, reference_outcome
from grader.intake import collect
from grader.intake.submission import Submission
from grader.reports import html, terminal
from grader.result import Result
from grader.sandbox.program import Limits, Program, StudentError
from grader.sandbox.server import Server
from tests.grader.toy import ROOT, TOY, Hidden, Scene, World, on_the_path
from tests.tiers import need

SECRET = b"a secret of the tests of planners"
ASSIGNMENT = TOY.under(SECRET)
TIER = 1
HEAD = "import numpy as np\nfrom course_lib.filters import Step\n\n\n"
STEER = (
    (ROOT / "tests/grader/toy.py")
    .read_text()
    .partition("def Planner")[2]
    .partition("def picture")[0]
    .replace("(previous, belief, state", "steer(previous, belief, state")
)
STEER = "def " + STEER
SIGNATURE = "def Planner(previous, belief, state, constants, rng):\n"


def planner(*body):
    """Source of a Planner with this body, in which `steer` is the good one."""
    return HEAD + STEER + SIGNATURE + "".join(f"    {line}\n" for line in body)


WELL = "return steer(previous, belief, state, constants, rng)"
GOOD = planner(WELL)
#: Where the force is half, it goes straight on.
CARELESS = planner("if constants.force == 1.0:", "    return np.array([1.0, 0.0])", WELL)
STRAIGHT = planner("return 3.0 * (np.array(constants.goal[:2]) - state[:2]) - 2.5 * state[2:]")
LATE = "previous is not None and state[0] > 1.0"


@pytest.fixture(scope="module")
def servers():
    need(TIER)
    with (
        on_the_path(),
        Server(preload=preload(ASSIGNMENT), withheld=TOY.withheld, tier=TIER) as server,
        Server(trusted=TOY.reference, tier=TIER) as reference_server,
    ):
        yield server, reference_server


@pytest.fixture(scope="module")
def references(servers):
    references = {variant.name: [] for variant in ASSIGNMENT.variants}
    for variant, episode in plan(ASSIGNMENT, most_episodes(ASSIGNMENT)):
        outcome = reference_outcome(servers[1], ASSIGNMENT, variant, episode, SECRET)
        references[variant.name].append(outcome)
    return references


@pytest.fixture(scope="module")
def judge(servers, references):
    """Grade a source."""

    def judge(source, name="ana", assignment=ASSIGNMENT):
        turn = contextlib.nullcontext()
        submission = Submission(name, f"{name}.py", source)
        return grade(submission, assignment, *servers, references, SECRET, turn, width=0.1)

    return judge


@pytest.fixture(scope="module")
def fail(servers):
    """What becomes of a source that fails in the first episode, with short deadlines."""
    hasty = replace(ASSIGNMENT, deadline=0.3, first_call=3.0)

    def fail(source):
        outcome = evaluate(servers[0], hasty, hasty.variants[0], 0, SECRET, source)
        assert outcome.status != "ok" and outcome.values == {} and "\n" not in outcome.message
        assert len(outcome.path) == len(outcome.distances) >= 1
        return outcome

    return fail


# What works


def test_a_planner_as_good_as_the_reference_earns_all_there_is(judge, references):
    result = judge(GOOD)
    assert result.points == result.max_points == 100.0
    assert result.message == "" and result.speed is None and result.stopped == CAPPED
    assert [len(variant.episodes) for variant in result.variants] == [4, 2]
    for variant in result.variants:
        for episode, reference in zip(variant.episodes, references[variant.name], strict=True):
            # The same program in the same gusts.
            assert episode.values == episode.reference == reference.values
            assert set(episode.values) == {"time", "effort"}
    assert result.variants[1].drawn.keys() == {"gust"}
    assert Result.from_json(result.to_json()) == result


def test_a_grade_repeats_bit_for_bit_and_is_the_secrets(judge, servers):
    noisy = planner("return steer(previous, belief, state, constants, rng) + 0.3 * rng.standard_normal(2)")
    first, second = judge(noisy), judge(noisy)
    assert first.to_json() == second.to_json()
    assert first.variants[0].episodes[0].values != first.variants[0].episodes[1].values
    other = evaluate(servers[0], ASSIGNMENT, ASSIGNMENT.variants[0], 0, b"another", noisy)
    assert other.values != first.variants[0].episodes[0].values


def test_what_is_told_arrives_as_it_is_and_what_was_returned_comes_back(servers):
    source = planner(
        "boxes, goal = constants.obstacles, constants.goal",
        "assert type(boxes) is tuple and type(boxes[0]) is tuple and type(goal) is tuple, constants",
        "assert constants.__dataclass_params__.frozen and belief is None",
        "assert isinstance(state, np.ndarray) and state.shape == (4,) and state.dtype == float",
        "count = previous.memory + 1 if previous is not None else 0",
        "assert previous is None or previous.posterior[1] == count - 1",
        "state[:] = np.nan",
        "return Step(np.array([0.0, count]), count)",
    )
    variant, actions = ASSIGNMENT.variants[0], []
    world = simulated(ASSIGNMENT, variant, 0, SECRET)
    task = program(ASSIGNMENT, variant, 0, SECRET, source, world.constants)
    with servers[0].start(task, Limits(), dimension=2) as worker:
        for _ in range(4):
            actions.append(worker.step(*world.inputs()).tolist())
    assert actions == [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [0.0, 3.0]]
    # The parent's state is another copy.
    assert np.isfinite(world.inputs()[1]).all()


def test_a_belief_crosses_as_an_array(servers):
    task = Program(planner("return belief[:2] + state"), "Planner", Scene(), 1, answer="action")
    with servers[0].start(task, Limits(), dimension=2) as worker:
        assert worker.step(np.arange(5.0), np.ones(2)).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("returned", ["np.array([1, 2])", "np.float32([1, 2])", "[1.0, 2.0]", "Step((1.0, 2), None)"])
def test_two_numbers_of_any_kind_are_an_action(servers, returned):
    task = Program(planner(f"return {returned}"), "Planner", Scene(), 1, answer="action")
    with servers[0].start(task, Limits(), dimension=2) as worker:
        action = worker.step(None, np.zeros(4))
    assert action.tolist() == [1.0, 2.0] and action.dtype == float


def test_printing_and_reckless_actions_are_the_worlds_to_cut(judge):
    result = judge(
        planner(
            "print('at', state)",
            "return steer(previous, belief, state, constants, rng) * (1e300 if previous is None else 1.0)",
        )
    )
    assert result.message == "" and result.points > 90.0


def test_all_planners_meet_the_same_scene_and_the_same_gusts(servers, monkeypatch):
    worlds = []

    def remembered(variant, rng):
        worlds.append(TOY.simulate(variant, rng))
        return worlds[-1]

    watched = replace(ASSIGNMENT, simulate=remembered)
    for source in (GOOD, STRAIGHT, planner("return rng.standard_normal(2)")):
        evaluate(servers[0], watched, ASSIGNMENT.variants[0], 1, SECRET, source)
    shortest = min(len(world.log) for world in worlds)
    assert shortest > 5 and len({world.constants for world in worlds}) == 1
    for world in worlds[1:]:
        np.testing.assert_array_equal(world.log[:shortest], worlds[0].log[:shortest])
    assert not np.array_equal(worlds[0].state, worlds[2].state)


def test_the_planners_generator_is_unrelated_to_the_worlds():
    variant = ASSIGNMENT.variants[0]
    seeds = {
        program(ASSIGNMENT, variant, 0, SECRET, "source").seed,
        program(ASSIGNMENT, variant, 0, SECRET).seed,
        episode_seed(SECRET, "toy", "default", 0, "world"),
    }
    assert len(seeds) == 3


# What fails


def test_a_collision_says_when_and_where(fail):
    outcome = fail(STRAIGHT)
    assert outcome.status == "collided"
    assert outcome.message.startswith("step ") and "ran into obstacle 1 at (2." in outcome.message
    assert outcome.path[-1][0] > 2.0 and len(outcome.path) == int(outcome.message.split()[1]) + 1


def test_who_is_too_slow_has_not_arrived(fail):
    outcome = fail(planner("return 0.0 * state[:2]"))
    assert outcome.status == "not arrived" and "step 120 (12.00 s): time is up" in outcome.message
    assert len(outcome.path) == 121


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        ("return np.zeros(3)", "invalid action", "step 0: expected an action of shape (2,), got (3,)"),
        ("return np.zeros((1, 2))", "invalid action", "step 0: expected an action of shape (2,), got (1, 2)"),
        ("return 1.0", "invalid action", "expected an action of shape (2,), got ()"),
        ("return np.zeros((1,) * 5)", "invalid action", "expected an action, got an array of 5 dimensions"),
        ("return np.zeros(10**6)", "invalid action", "expected an action, got a frame of 8000048 bytes, over the cap"),
        ("return None", "invalid action", "step 0: expected an array of numbers, got None (is a return missing?)"),
        ("return {'u': 1}", "invalid action", "the action must be an array of real numbers, got dtype object"),
        ("return ['1', '2']", "invalid action", "the action must be an array of real numbers, got dtype <U1"),
        ("return [[1.0, 2.0], [3.0]]", "invalid action", "step 0: "),
        ("return np.zeros(2) * 1j", "invalid action", "got dtype complex128"),
        (
            f"return np.array([1.0, np.nan if {LATE} else 1.0])",
            "invalid action",
            "1 NaN or infinite numbers, the first",
        ),
        ("return np.array([np.inf, 1.0])", "invalid action", "step 0: the action holds 1 NaN or infinite numbers"),
        (f"return 1 / 0 if {LATE} else state[:2] + 1", "crashed", "ZeroDivisionError: division by zero (line"),
        ("while True: pass", "timeout", "loading the file and the first call took longer than 3 s"),
        ("import os; os._exit(0)", "exited", "with exit status 0: return an action instead"),
        ("print('x' * 10**7)", "flooded", "remove the print calls"),
        ("import course_lib.vacuum.reference", "crashed", "holds the answer to this assignment"),
    ],
)
def test_each_failure_has_its_status_and_one_line(fail, body, status, words):
    outcome = fail(planner(body))
    assert outcome.status == status and words in outcome.message


def test_the_first_call_may_take_longer_than_the_others(fail, servers):
    slow_start = planner("if previous is None: import time; time.sleep(0.6)", "return state[:2] * 0")
    assert fail(slow_start).status == "not arrived"
    hang = planner(f"while {LATE}: pass", "return np.array([1.0, 0.0])")
    outcome = fail(hang)
    assert outcome.status == "timeout" and "the call took longer than 0.3 s" in outcome.message
    assert len(outcome.path) > 5


def test_the_signature_is_the_planners(fail):
    source = HEAD + "def Planner(state, goal): return state\n"
    assert "expected def Planner(previous, belief, state, constants, rng), got def Planner(state, goal)" in (
        fail(source).message
    )


def test_a_world_whose_metric_is_no_number_fails_who_made_it_so(servers):
    class Unlimited(type(simulated(ASSIGNMENT, ASSIGNMENT.variants[0], 0, SECRET))):
        def metrics(self):
            return {"effort": np.inf}

    unlimited = replace(ASSIGNMENT, simulate=lambda variant, rng: Unlimited(variant.constants, variant.hidden, rng))
    outcome = evaluate(servers[0], unlimited, ASSIGNMENT.variants[0], 0, SECRET, GOOD)
    assert outcome.status == "invalid action" and "the effort is inf" in outcome.message and outcome.values == {}


# What it earns


def test_failed_episodes_earn_nothing_and_the_others_what_they_are_worth(judge):
    result = judge(CARELESS)
    default, weak = result.variants
    assert default.points == default.max_points and weak.points == 0.0
    assert [episode.status for episode in weak.episodes] == ["collided"] * 2
    assert result.message.startswith("2 of 6 episodes failed: step ")
    low, high = result.interval
    assert low <= result.points <= high


def test_slower_and_less_careful_costs_points(judge):
    slow = judge(planner("return 0.2 * steer(previous, belief, state, constants, rng) - 0.5 * state[2:]"))
    assert 0.0 < slow.points < 80.0 and slow.message == ""


def test_patience_ends(judge):
    hang = planner(f"while {LATE}: pass", "return np.array([1.0, 0.0])")
    result = judge(hang, assignment=replace(ASSIGNMENT, deadline=0.2))
    assert result.stopped == IMPATIENT and result.points == 0.0


def test_a_reference_that_does_not_arrive_stops_the_grading(servers):
    hopeless = Variant("default", "", Scene(), Hidden(steps=3), 1, (Criterion("time", 1.0, 1.5, 2.0),))
    with pytest.raises(RuntimeError, match="variant default, episode 0: step 3 .*time is up"):
        reference_outcome(servers[1], ASSIGNMENT, hopeless, 0, SECRET)


def test_a_scene_the_reference_cannot_master_is_drawn_again_and_the_class_meets_the_new_one(servers):
    def simulate(variant, rng):
        soon = rng.random() < 0.6
        return World(variant.constants, Hidden(steps=3 if soon else 120), rng)

    moody = replace(ASSIGNMENT, name="moody", simulate=simulate, variants=ASSIGNMENT.variants[:1])
    [variant] = moody.variants
    references = {variant.name: [reference_outcome(servers[1], moody, variant, e, SECRET) for e in range(4)]}
    draws = [outcome.draw for outcome in references[variant.name]]
    assert 0 in draws and max(draws) > 0
    result = grade(Submission("ana", "ana.py", GOOD), moody, *servers, references, SECRET, contextlib.nullcontext())
    assert [episode.status for episode in result.variants[0].episodes] == ["ok"] * 4


# What is shown


def test_the_picture_is_of_a_failure_if_there_is_one_and_shows_both_ways(judge, references):
    result = judge(CARELESS)
    trace = result.trace
    assert trace.variant == "weak" and trace.metric == DISTANCE
    assert trace.picture["targets"] == ["submission", "reference"]
    ours, theirs = trace.truth
    assert theirs == references["weak"][trace.episode].path
    assert len(ours) == len(trace.error) and len(theirs) == len(trace.reference_error)
    assert len(trace.frames) == max(len(ours), len(theirs))
    [box] = trace.picture["obstacles"]
    assert box[0] < ours[-1][0] < box[2] and box[1] < ours[-1][1] < box[3]
    assert trace.reference_error[-1] < trace.picture["goal"][2]


def test_a_planner_that_never_starts_has_no_picture(judge):
    assert judge(planner("raise ValueError('no')")).trace is None


def test_reports_speak_of_planners(judge, tmp_path):
    results = [judge(GOOD, "ana"), judge(STRAIGHT, "ben"), judge(planner("return None"), "cem")]
    html.write(results, tmp_path / "report.html", TOY.title, "today", TOY.landmarks)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "ran into obstacle 1" in page and "distance to the goal" in page
    assert "CPU time" not in page.partition("<main>")[2] and "within 90 %" not in page
    assert page.count('"obstacles": [[2.0') == 2 and '"goal": [4.5, 2.0, 0.3]' in page
    console = Console(width=110, file=io.StringIO(), color_system=None)
    console.print(terminal.table(results))
    table = console.file.getvalue()
    words = " ".join(table.split())
    assert "CPU" not in words and "within" not in words
    assert "ana 100.0" in words and "6 failed" in words and "not timed" not in words
    assert max(map(len, table.splitlines())) <= 110


# Who may come in, and what shuts them in


def test_intake_asks_for_a_planner(tmp_path):
    (tmp_path / "good.py").write_text(GOOD)
    (tmp_path / "estimator.py").write_text("def Estimator(previous, observation, control, constants, rng): pass\n")
    submissions, [refusal] = collect.gather([tmp_path], TOY)
    assert [submission.name for submission in submissions] == ["good"]
    assert "define Planner(previous, belief, state, constants, rng)" in refusal.reason


@pytest.mark.parametrize("tier", [1, 2, 3])
def test_the_isolation_is_the_same(tier):
    """What `doctor` tries, tried by a planner."""
    need(tier)
    source = "REFERENCE = 'vacuum/reference.py'\n" + doctor._SOURCE
    source += SIGNATURE + "    return Estimator(None, None, None, constants, rng)[:, 0]\n"
    task = Program(source, "Planner", Constants(), 0, answer="action")
    preloaded = ("course_lib.vacuum.constants",)
    with (
        Server(preloaded, withheld=("course_lib.vacuum.reference",), tier=tier) as server,
        server.start(task, Limits(), dimension=len(doctor.ATTEMPTS)) as worker,
    ):
        succeeded = worker.step(None, np.zeros(4))
    attempts = zip(doctor.ATTEMPTS.items(), succeeded, strict=True)
    assert [name for (name, least), done in attempts if done and tier >= least] == []


FORGE = "import os\nfrom grader.sandbox import wire\n"


@pytest.mark.parametrize(
    "forged",
    [
        'b"".join(map(bytes, wire.encode_action(1.0, [0.0, 0.0])))',
        'b"".join(map(bytes, wire.encode_posterior(1.0, np.zeros((1, 2)))))',
        "b'bay\\x01' + bytes(12)",
        "b'bay\\x02\\x09\\x00\\x00\\x00collided\\n'",
    ],
)
def test_answers_that_are_forged_are_no_actions(fail, forged):
    outcome = fail(FORGE + planner(f"os.write(4, {forged})", "return np.zeros(2)"))
    assert outcome.status == "invalid action" and "expected an action, got " in outcome.message


def test_an_answer_that_lies_in_the_pipe_before_the_step_is_refused(servers):
    body = ["threading.Timer(0.05, lambda: os.write(4, bytes(8))).start()", "return np.zeros(2)"]
    task = Program("import os, threading\n" + planner(*body), "Planner", Scene(), 1, answer="action")
    with servers[0].start(task, Limits(), dimension=2) as worker:
        worker.step(None, np.zeros(4))
        time.sleep(0.5)
        with pytest.raises(StudentError, match="step 1: an answer came before the step was sent") as caught:
            worker.step(None, np.zeros(4))
    assert caught.value.status == "invalid action"
