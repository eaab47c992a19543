"""The sample class through the grader, as `make demo` does it, and the worked lesson with it."""

import subprocess
import sys
from pathlib import Path

import pytest

from grader.reports.calibration import calibrations
from grader.result import Result

ROOT = Path(__file__).parents[1]
CLASS = ROOT / "tests/submissions/vacuum"
LESSON = ROOT / "solutions/03_vacuum_robots.ipynb"

RIGHT = {"reference_quality", "good_plain", "good_notebook", LESSON.stem}
#: Right in principle: robots resampled apart, or one particle at a time.
FAIR = {"good_separate_resampling", "slow_python_loop"}
WRONG = sorted({path.stem for path in CLASS.iterdir() if path.is_file()} - RIGHT - FAIR)


@pytest.fixture(scope="module")
def graded(tmp_path_factory):
    """Results by name, and what the command printed."""
    output = tmp_path_factory.mktemp("grades")
    command = "from grader.cli import main; main()"
    words = ["grade", CLASS, LESSON, "--assignment", "vacuum", "--output", output, "--allow-unsandboxed"]
    done = subprocess.run([sys.executable, "-c", command, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    results = [Result.from_json(path.read_text(encoding="utf-8")) for path in (output / "results").iterdir()]
    page = (output / "report.html").read_text(encoding="utf-8")
    return {result.submission: result for result in results}, done.stdout, page


def error_points(result):
    """Points without those for time, which are the machine's."""
    return sum(variant.points for variant in result.variants)


@pytest.mark.parametrize("name", sorted(RIGHT))
def test_right_filters_earn_full_marks(graded, name):
    result = graded[0][name]
    assert result.message == ""
    assert result.variants[0].points >= 0.99 * result.variants[0].max_points
    assert result.speed.points == result.speed.max_points
    # With 2000 particles a plain filter may lose a robot once in all its episodes, which costs two points. On which one
    # depends on the last digit of a cube root, and so on the machine.
    assert result.points >= result.max_points - 4.0


@pytest.mark.parametrize("name", sorted(FAIR))
def test_fair_filters_earn_most_of_the_marks(graded, name):
    result = graded[0][name]
    assert 0.75 * result.max_points <= result.points


def test_a_loop_over_particles_costs_time(graded):
    speed = graded[0]["slow_python_loop"].speed
    assert speed.points < speed.max_points


@pytest.mark.parametrize("name", WRONG)
def test_wrong_filters_lose_points(graded, name):
    wrong, right = graded[0][name], graded[0]["good_plain"]
    assert error_points(wrong) <= error_points(right) - 2.0


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("zero_weights_crash", "crashed"),
        ("heading_unwound_in_a_loop", "timeout"),
        ("returns_nan", "invalid posterior"),
        ("wrong_shape", "invalid posterior"),
        ("prints_a_flood", "flooded"),
    ],
)
def test_what_breaks_has_its_line_and_stops_nobody(graded, name, status):
    result = graded[0][name]
    broken = [episode for variant in result.variants for episode in variant.episodes if episode.status == status]
    assert broken and all(episode.message and "\n" not in episode.message for episode in broken)
    assert all(episode.values == {} for episode in broken)
    assert result.message


def test_the_measure_can_be_gamed_and_the_proper_score_cannot(graded):
    best_half, energy = graded[0]["gamed_two_centres"].variants[0].criteria
    honest_half, honest_energy = graded[0]["good_plain"].variants[0].criteria
    assert best_half.value < honest_half.value
    assert energy.value > honest_energy.value
    assert energy.points < 0.9 * energy.max_points and honest_energy.points > 0.98 * honest_energy.max_points


@pytest.mark.parametrize("name", ["gamed_two_centres", "collapses_to_mean"])
def test_posteriors_that_only_pretend_are_called_overconfident(graded, name):
    [gamed], [honest] = (calibrations(graded[0][who].variants, 6) for who in (name, "good_plain"))
    assert gamed.value < 0.1 and gamed.verdict == "overconfident"
    assert 0.85 < honest.value < 0.95 and honest.verdict == ""
    assert "overconfident" in graded[2]


def test_numbers_that_the_secret_draws_are_hard_coded_in_vain(graded):
    drawn = {name: graded[0][name].variants for name in ("hard_coded_room", "good_plain")}
    [hard], [right] = ([v for v in variants if v.name == "drawn room"] for variants in drawn.values())
    assert hard.points < 0.2 * hard.max_points and right.points > 0.9 * right.max_points


def test_table_and_report_name_everybody(graded):
    results, printed, page = graded
    assert len(results) == len(RIGHT | FAIR | set(WRONG))
    for name in results:
        assert name in printed
        assert name in page
