"""Every attack of tests/submissions/hostile, on every tier of isolation that there is here.

None may score more than the honest wrong answer, take longer than its deadlines, leave anything behind, or change the
grade of a neighbour: one that is graded next, and one that runs at the same time. An attack is run on the tiers that
claim to contain it; those that harm nobody are run below as well, where they must succeed: so is known that they bite.
"""

import contextlib
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from course_lib.vacuum.constants import Constants, Hidden
from grader.assignment import PUBLIC_SECRET, Criterion, Speed, Variant
from grader.assignments import assignments
from grader.grading.evaluate import evaluate, limits, program, recorded_run
from grader.grading.grade import grade
from grader.intake import collect
from grader.intake.submission import Submission
from grader.reports import html
from grader.sandbox import isolation
from grader.sandbox.channel import patience
from grader.sandbox.server import Server
from tests.surroundings import Surroundings
from tests.tiers import need

FOLDER = Path(__file__).parent / "submissions" / "hostile"
ATTACKS = sorted(path for path in FOLDER.glob("*.[pi][yp]*") if not path.stem.startswith("honest"))
GOOD = (FOLDER.parent / "vacuum" / "good_plain.py").read_text(encoding="utf-8")
SECRET = b"a secret of the tests of hostile programs"
STEPS = 10
SHORT = replace(
    assignments()["vacuum"],
    variants=(
        Variant(
            "default",
            "as it is",
            Constants(),
            Hidden(steps=STEPS),
            1,
            (Criterion("best half", 4.0, 1.6, 3.0), Criterion("energy score", 1.0, 1.6, 3.0)),
        ),
    ),
    speed=Speed("default", steps=STEPS, points=5.0, full=2.0, none=4.0),
    deadline=0.5,
)
(VARIANT,) = SHORT.variants
#: Wall seconds for an attack and its neighbours, on a machine that is not busy: loading, two deadlines, cleaning up.
GENEROUS = 20.0
#: What particles say that got what they wanted and can make no points of it.
WORKED = -47.11
#: Attacks that harm nobody, and that no more than the parent's checks do not hold: they must succeed at tier 0.
BITES = """
disk_reads_gradebook disk_reads_secret disk_import_by_zip
disk_import_by_loader disk_mmap disk_symlink disk_parent_fd disk_parent_paths disk_neighbour disk_writes_elsewhere
disk_makes_elsewhere disk_changes_gradebook disk_openat2 memory_left_sysv memory_left_queue signal_kill signal_sigio
process_exec process_exec_memory process_terminal network_tcp network_udp network_unix network_abstract share_files
share_shared_memory result_writes
""".split()


def contained_from(path):
    """The lowest tier on which an attack is held."""
    return int(re.search(r"Contained from tier (\d)\.", path.read_text(encoding="utf-8")).group(1))


class Bench:
    """Both fork servers of a tier, and what honest programs earn there."""

    def __init__(self, tier, surroundings):
        self.tier, self.surroundings = tier, surroundings
        self.server = Server(preload=("course_lib.vacuum.constants",), withheld=SHORT.withheld, tier=tier)
        self.reference_server = Server(trusted=SHORT.reference, tier=tier)

    def __enter__(self):
        with contextlib.ExitStack() as stack:
            stack.enter_context(self.server)
            stack.enter_context(self.reference_server)
            self.run = recorded_run(SHORT, VARIANT, 0, SECRET)
            self.reference = replace(evaluate(self.reference_server, SHORT, VARIANT, 0, SECRET), frames=[])
            self.neighbour = self.evaluate(GOOD)
            assert self.reference.status == self.neighbour.status == "ok"
            with self.bystander() as posteriors:
                pass
            self.posteriors = posteriors
            self.wrong = self.points(self.evaluate((FOLDER / "honest_wrong.py").read_text()))
            self.surroundings.differences(self.directories)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exception):
        self._stack.close()

    @property
    def directories(self):
        return [self.server.directory, self.reference_server.directory]

    def evaluate(self, source):
        return evaluate(self.server, SHORT, VARIANT, 0, SECRET, source)

    def points(self, outcome):
        values, baselines = outcome.values, self.reference.values
        return sum(
            criterion.points * criterion.score(values[criterion.metric], baselines[criterion.metric])
            for criterion in VARIANT.criteria
            if criterion.metric in values
        )

    def grade(self, source):
        submission = Submission("mallory", "mallory.py", source)
        references = {VARIANT.name: [self.reference]}
        return grade(
            submission, SHORT, self.server, self.reference_server, references, SECRET, contextlib.nullcontext()
        )

    @contextlib.contextmanager
    def bystander(self):
        """The reference, in the middle of whose run something else happens; yields its posteriors."""
        posteriors = []
        task = program(SHORT, VARIANT, 0, SECRET)
        with self.reference_server.start(task, limits(SHORT), dimension=SHORT.dimension) as worker:
            for k in range(STEPS + 1):
                if k == STEPS // 2:
                    yield posteriors
                inputs = (self.run.observations[k - 1], self.run.controls[k - 1]) if k else (None, None)
                posteriors.append(worker.step(*inputs).states)

    def findings(self, source):
        """What an attack achieved that it must not, in words."""
        source, found = self.surroundings.tell(source), []
        start = time.monotonic()
        with self.bystander() as posteriors:
            outcome = self.evaluate(source)
        if self.points(outcome) > self.wrong + 1e-9:
            found.append(f"scored {self.points(outcome):.3g}, the honest wrong answer {self.wrong:.3g}")
        if any(WORKED in robot[0] for frame in outcome.frames for robot in frame["particles"]):
            found.append("says that it worked")
        if not all(map(np.array_equal, posteriors, self.posteriors)):
            found.append("changed what ran at the same time")
        if not same(self.evaluate(GOOD), self.neighbour):
            found.append("changed what was graded next")
        took = time.monotonic() - start
        if took > GENEROUS * patience():
            found.append(f"took {took:.3g} s")
        return found + self.surroundings.differences(self.directories)


def same(one, other):
    return (one.status, one.message, one.frames) == (other.status, other.message, other.frames) and all(
        np.array_equal(one.metrics[name], other.metrics[name]) for name in (one.metrics | other.metrics)
    )


@pytest.fixture(scope="module")
def surroundings():
    def table():
        for episode in range(3):
            run = recorded_run(SHORT, VARIANT, episode, PUBLIC_SECRET)
            first = np.concatenate([run.observations[0], run.controls[0]])
            yield first.tobytes().hex(), run.truth.tolist()

    truth = recorded_run(SHORT, VARIANT, 0, SECRET).truth
    episode = "|".join([SHORT.name, VARIANT.name, "0", "world"])
    with Surroundings(SECRET, truth, dict(table()), episode=episode, steps=STEPS) as surroundings:
        yield surroundings


@pytest.fixture(scope="module")
def sources():
    """Every attack as it comes through intake: source by name."""
    submissions, refusals = collect.gather([FOLDER], SHORT)
    assert refusals == []
    return {submission.name: submission.source for submission in submissions}


@pytest.fixture(scope="class")
def bench(request, surroundings):
    need(request.cls.tier)
    with Bench(request.cls.tier, surroundings) as bench:
        yield bench


def pytest_generate_tests(metafunc):
    """Each attack on the tiers that claim to contain it."""
    if "path" in metafunc.fixturenames:
        on_the_clock = "clock" in metafunc.function.__name__
        paths = [
            path
            for path in ATTACKS
            if path.stem.startswith("clock_") == on_the_clock and contained_from(path) <= metafunc.cls.tier
        ]
        metafunc.parametrize("path", paths, ids=[path.stem for path in paths])


class OnATier:
    """The tests of one tier: a class of its own, that the tiers can be tested side by side."""

    tier: int

    def test_attack_achieves_nothing(self, bench, path, sources):
        findings = bench.findings(sources[path.stem])
        if path.stem.startswith("share_"):
            findings += bench.findings(sources[path.stem])
        assert findings == []

    def test_attack_on_the_clock_gains_no_time(self, bench, path, sources):
        # What hides its work must earn no more than what does the same work openly.
        honest = "honest_slow" if "\nWORK = " in sources[path.stem] else "honest_wrong"
        result = bench.grade(bench.surroundings.tell(sources[path.stem]))
        assert result.points <= bench.grade(sources[honest]).points + 1e-9
        assert not result.trace or all(WORKED not in robot[0] for f in result.trace.frames for robot in f["particles"])
        assert bench.findings(sources[path.stem]) == []


class TestTier0(OnATier):
    tier = 0

    @pytest.mark.parametrize("name", BITES)
    def test_attack_bites_where_nothing_holds_it(self, bench, name, sources):
        assert contained_from(FOLDER / f"{name}.py") > 0
        findings = bench.findings(sources[name])
        if name.startswith("share_"):
            findings = bench.findings(sources[name])
        assert findings != []


class TestTier1(OnATier):
    tier = 1


class TestTier2(OnATier):
    tier = 2


class TestTier3(OnATier):
    tier = 3


class TestReports:
    """What an attack says of itself, where people read it."""

    tier = isolation.strongest()

    def test_markup_in_names_and_messages_stays_text(self, bench, sources, tmp_path):
        result = bench.grade(sources["raise_markup"])
        result = replace(result, submission="=1+1<script>hostile()</script>")
        assert "<script>hostile" in result.message
        html.write([result], tmp_path / "report.html", SHORT.title, "today", SHORT.landmarks)
        page = (tmp_path / "report.html").read_text(encoding="utf-8")
        # JSON inside a script element may hold it only with its brackets escaped.
        assert "hostile()" in page and "<script>hostile" not in page and "<img src=x" not in page
        assert "\x1b" not in page and "\u202e" not in page


def test_corpus_is_what_it_claims(sources):
    assert len(ATTACKS) >= 60
    assert all(contained_from(path) in range(4) for path in ATTACKS)
    programs = {re.sub(r'^""".*?"""', "", source, flags=re.DOTALL): name for name, source in sources.items()}
    # The two notebooks hold the honest answer.
    assert len(programs) >= len(sources) - 2
