"""What the tests of the sample classes share: grading one program in one run, and a class by the command."""

import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

from grader.assignment import PUBLIC_SECRET
from grader.assignments import assignments
from grader.grading.evaluate import evaluate, preload
from grader.grading.grade import reference_outcome
from grader.result import Result
from grader.sandbox import isolation
from grader.sandbox.server import Server

FOLDER = Path(__file__).parent / "submissions"


class Bench:
    """The servers of an assignment, and the reference's outcomes."""

    def __init__(self, name, stack):
        self.assignment = assignments()[name].under(PUBLIC_SECRET)
        tier = isolation.strongest()
        self.servers = [
            stack.enter_context(server)
            for server in (
                Server(preload=preload(self.assignment), withheld=self.assignment.withheld, tier=tier),
                Server(trusted=self.assignment.reference, tier=tier),
            )
        ]
        self.references = {}

    def grade(self, specimen, variant_name, episode=0):
        """Outcome of a specimen in a run of a variant, and its share of the points."""
        assignment, variant = self.assignment, self.assignment.variant(variant_name)
        run = variant_name, episode
        if run not in self.references:
            self.references[run] = reference_outcome(self.servers[1], assignment, variant, episode, PUBLIC_SECRET)
        reference = self.references[run]
        source = (FOLDER / assignment.name / f"{specimen}.py").read_text(encoding="utf-8")
        outcome = evaluate(self.servers[0], assignment, variant, episode, PUBLIC_SECRET, source, reference.draw)
        earned = [
            criterion.points * criterion.score(outcome.values[criterion.metric], reference.values[criterion.metric])
            for criterion in variant.criteria
            if outcome.status == "ok"
        ]
        return outcome, sum(earned) / variant.points

    def grade_round(self, specimen, variant_name):
        """Outcomes in all runs of a variant's round, and the share of the points of all of them."""
        count = self.assignment.variant(variant_name).episodes
        outcomes, shares = zip(*(self.grade(specimen, variant_name, e) for e in range(count)), strict=True)
        return outcomes, sum(shares) / count


@contextmanager
def opened_benches():
    """A function from an assignment's name to its `Bench`, opened when it is first asked for."""
    with ExitStack() as stack:
        opened = {}

        def bench(name):
            if name not in opened:
                opened[name] = Bench(name, stack)
            return opened[name]

        yield bench


def grade_by_command(name, specimens, output):
    """Results by submission, and the report's page, of `grader grade` in one round of episodes."""
    paths = [FOLDER / name / f"{specimen}.py" for specimen in specimens]
    episodes = str(len(assignments()[name].variants))
    command = ["from grader.cli import main; main()", "grade", *paths, "--assignment", name, "--output", output]
    words = [*command, "--max-episodes", episodes, "--allow-unsandboxed"]
    done = subprocess.run([sys.executable, "-c", *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    records = [Result.from_json(path.read_text(encoding="utf-8")) for path in (output / "results").iterdir()]
    return {record.submission: record for record in records}, (output / "report.html").read_text(encoding="utf-8")
