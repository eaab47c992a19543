"""What an instructor meets at the command line: above all, what goes wrong."""

import pytest
from typer.testing import CliRunner

from grader import cli, doctor
from grader.assignments import assignments
from grader.cli import NOTHING_DONE, app
from grader.sandbox import isolation
from tests.grader.toy import TOY

ESTIMATOR = "def Estimator(previous, observation, control, constants, rng):\n    return [[0.0] * 6]\n"


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("essay.docx", b"PK", "essay.docx"),
        ("broken.py", b"def Estimator(:\n", "line 1"),
        ("empty.py", b"", "Estimator"),
        ("other.py", b"def estimator(a):\n    return a\n", "Estimator"),
        (
            "short.py",
            b"def Estimator(previous, observation):\n    return previous\n",
            "(previous, observation, control",
        ),
        ("torn.ipynb", b'{"cells": [', "torn.ipynb"),
        ("noise.py", bytes(range(128, 256)), "noise.py"),
        ("torn.zip", b"PK\3\4", "torn.zip: is not a whole zip"),
        (":bomb: \x1b[2J\n.py", b"", ":bomb: \\x1b[2J\\n.py: defines no Estimator"),
    ],
)
def test_a_bad_file_is_one_line_and_leaves_nothing(run, tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    result = run("grade", "-a", "vacuum", name)
    assert result.exit_code == NOTHING_DONE
    assert words in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "grades").exists()


def test_an_empty_folder(run, tmp_path):
    (tmp_path / "class").mkdir()
    result = run("grade", "-a", "vacuum", "class")
    assert result.exit_code == NOTHING_DONE
    assert "class" in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_a_path_that_is_not_there(run):
    result = run("grade", "-a", "vacuum", "nobody.py")
    assert result.exit_code == NOTHING_DONE
    assert "nobody.py" in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_an_output_that_cannot_be_written_is_found_before_grading(run, tmp_path):
    (tmp_path / "good.py").write_text(ESTIMATOR)
    (tmp_path / "taken").write_text("a file, not a folder")
    result = run("grade", "-a", "vacuum", "good.py", "--output", "taken")
    assert result.exit_code == NOTHING_DONE
    assert "cannot write to taken" in result.stderr and len(result.stderr.strip().splitlines()) == 1
    assert (tmp_path / "taken").read_text() == "a file, not a folder"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--assignment", "juggling"], "there is no assignment juggling: --assignment is one of "),
        (["--width", "0"], "--width 0"),
        (["--width", "nan"], "--width nan"),
        (["--max-episodes", "19"], "20 variants"),
        (["--max-episodes", "-1"], "20 variants"),
        (["--secret", "missing"], "cannot read the secret missing"),
        (["--secret", "short"], "5 bytes"),
    ],
)
def test_options_that_make_no_sense(run, tmp_path, words, message):
    (tmp_path / "good.py").write_text(ESTIMATOR)
    (tmp_path / "short").write_text("12345")
    result = run("grade", "-a", "vacuum", "good.py", *words)
    assert result.exit_code == NOTHING_DONE
    assert message in result.stderr and len(result.stderr.strip().splitlines()) == 1


@pytest.fixture
def offer(monkeypatch):
    """Offer other assignments."""
    return lambda *offered, broken=(): monkeypatch.setattr(
        cli, "load", lambda: ({assignment.name: assignment for assignment in offered}, list(broken))
    )


VACUUM = assignments()["vacuum"]


def test_of_several_assignments_one_must_be_named(run, offer):
    offer(TOY, VACUUM)
    for words, problem in (([], "which assignment?"), (["-a", "tpy"], "no assignment tpy")):
        result = run("grade", "x.py", *words)
        assert result.exit_code == NOTHING_DONE and len(result.stderr.strip().splitlines()) == 1
        assert problem in result.stderr
        assert "toy (A point around a box), vacuum (Two vacuum robots: a particle filter)" in result.stderr
    assert "x.py: no such file" in run("grade", "x.py", "-a", "toy").stderr
    offer(VACUUM)
    assert "x.py: no such file" in run("grade", "x.py").stderr


def test_a_world_that_cannot_be_imported_is_told_and_stops_nobody_else(run, offer):
    offer(VACUUM, broken=["the assignments of ruin cannot be loaded: ImportError: no module named walls"])
    result = run("grade", "x.py", "-a", "vacuum")
    assert "assignments of ruin cannot be loaded" in result.stderr and "x.py: no such file" in result.stderr
    # It may be the one that was meant.
    assert "which assignment?" in run("grade", "x.py").stderr
    listed = run("assignments")
    assert listed.exit_code == 0 and "vacuum" in listed.stdout and "of ruin cannot be loaded" in listed.stderr


def test_assignments_are_listed_with_what_they_ask_for(run, offer):
    offer(VACUUM, TOY)
    result = run("assignments")
    assert result.exit_code == 0 and result.stderr == ""
    assert result.stdout.startswith(
        "toy\n    A point around a box\n    def Planner(previous, belief, state, constants, rng)\n"
        "    2 variants, 100 points\nvacuum\n"
    )
    assert "grader assignments" in run("grade", "--help").stdout


def test_doctor_takes_an_assignment_that_is_timed(run, monkeypatch, no_sandbox):
    monkeypatch.setattr(cli, "assignments", lambda: {"toy": TOY, "vacuum": VACUUM})
    timed = []
    monkeypatch.setattr(doctor, "time_reference", lambda assignment, tier: timed.append(assignment.name) or [1.0])
    assert run("doctor").exit_code == 0 and timed == ["vacuum"]


@pytest.fixture
def no_sandbox(monkeypatch):
    """A machine whose kernel has nothing to shut a submission in with."""
    isolation.probe.cache_clear()
    monkeypatch.setattr(isolation, "kernel", lambda: ("the kernel is too old", "a newer kernel"))
    yield
    isolation.probe.cache_clear()


def test_grading_unsandboxed_has_to_be_allowed(run, tmp_path, no_sandbox):
    (tmp_path / "good.py").write_text(ESTIMATOR)
    result = run("grade", "-a", "vacuum", "good.py")
    assert result.exit_code == NOTHING_DONE and len(result.stderr.strip().splitlines()) == 1
    assert "the kernel is too old" in result.stderr and "--allow-unsandboxed" in result.stderr
    assert not (tmp_path / "grades").exists()
    # Allowed, it goes on, here to a file that is not there.
    result = run("grade", "-a", "vacuum", "nobody.py", "--allow-unsandboxed")
    assert "nobody.py" in result.stderr and "kernel" not in result.stderr


def test_doctor_says_what_is_missing_and_what_to_do(run, monkeypatch, no_sandbox):
    monkeypatch.setattr(doctor, "time_reference", lambda assignment, tier: [1.0, 0.99, 1.02])
    result = run("doctor")
    assert result.exit_code == 0
    assert "tier 1  no" in result.stdout and "why not: the kernel is too old" in result.stdout
    assert "remedy: a newer kernel" in result.stdout and "uses tier 0; it refuses to" in result.stdout
    assert "1.000, 0.990, 1.020" in result.stdout


@pytest.mark.tier(1)
def test_doctor_fails_when_a_tier_does_not_hold(run, monkeypatch):
    monkeypatch.setattr(doctor, "time_reference", lambda assignment, tier: [1.0])
    monkeypatch.setattr(doctor, "attempt", lambda tier, assignment: ["start a process"] if tier == 1 else [])
    result = run("doctor")
    assert result.exit_code == 1
    assert "tier 1: SUCCEEDED: start a process" in result.stdout


def test_release_outside_a_course(run):
    result = run("release", "--check")
    assert result.exit_code == NOTHING_DONE
    assert "solutions" in result.stderr


def test_a_malformed_lesson_is_one_line(run, tmp_path):
    (tmp_path / "solutions").mkdir()
    (tmp_path / "solutions/01_x.md").write_text(
        "---\njupytext:\n  text_representation:\n    format_name: myst\n---\n\n"
        "```{code-cell}\n### BEGIN SOLUTION\n```\n"
    )
    for words in (["release"], ["release", "--check"]):
        result = run(*words)
        assert result.exit_code == NOTHING_DONE
        assert "01_x.md" in result.stderr and len(result.stderr.strip().splitlines()) == 1
