"""What came out: one JSON-serialisable record per submission and assignment. Every report is a view of it."""

import json
from dataclasses import dataclass, field

#: Metrics that say whether a posterior means what it says. The first is 1 where the truth lies in the most central 90 %
#: of the posterior, for assignments that measure it; the second is there for every Gaussian.
COVERAGE, NEES = "within 90 %", "NEES"


@dataclass(frozen=True)
class Episode:
    """One replayed run.

    Attributes
    ----------
    index : int
    status : str
        "ok", or why it earned nothing: "crashed", "timeout", "invalid posterior", "invalid action", "flooded",
        "exited", "memory", "disk", or "sandbox" when it broke what it ran in; of a planner also what its world calls
        it, such as "collided" or "not arrived".
    message : str
        One line for the student; empty when all went well.
    values, reference : dict of str to float
        Metrics of the run, an estimator's as means over it, of the submission (empty unless ok) and of the reference in
        the same run.
    """

    index: int
    status: str
    message: str
    values: dict[str, float]
    reference: dict[str, float]


@dataclass(frozen=True)
class CriterionResult:
    """What one metric of one variant earned. `value` is the mean over the episodes that finished, or None."""

    metric: str
    points: float
    max_points: float
    full: float
    none: float
    value: float | None
    reference: float


@dataclass(frozen=True)
class VariantResult:
    """What one variant earned.

    `drawn` is what the secret chose of its world: for the instructor, who may have to explain a grade, and not for
    students.
    """

    name: str
    title: str
    criteria: list[CriterionResult]
    episodes: list[Episode]
    drawn: dict = field(default_factory=dict)

    @property
    def points(self):
        """Points earned here."""
        return sum(criterion.points for criterion in self.criteria)

    @property
    def max_points(self):
        """Points there were to earn here."""
        return sum(criterion.max_points for criterion in self.criteria)


@dataclass(frozen=True)
class SpeedResult:
    """CPU time per update, as a ratio to the reference's, measured side by side.

    Attributes
    ----------
    status, message : str
        As in `Episode`; also "inconsistent", when it took short cuts while it was timed.
    milliseconds, reference_milliseconds : float or None
        CPU time per update on this machine: information, not a grade.
    ratios : list of float
        One per pair of fresh processes.
    points, max_points, full, none : float
    bound : float or None
        What the submission's ratio is at least, with 95 % confidence: the grade is this one's, so that doubt costs
        nothing. Never above `ratio`.
    """

    status: str
    message: str
    milliseconds: float | None
    reference_milliseconds: float | None
    ratios: list[float]
    points: float
    max_points: float
    full: float
    none: float
    bound: float | None = None

    @property
    def ratio(self):
        """Median ratio, or None when nothing was measured."""
        ranked = sorted(self.ratios)
        middle = len(ranked) // 2
        if not ranked:
            return None
        return ranked[middle] if len(ranked) % 2 else (ranked[middle - 1] + ranked[middle]) / 2


@dataclass(frozen=True)
class Trace:
    """The worst episode, for the pictures of a report.

    Attributes
    ----------
    variant : str
    episode : int
    metric : str
        What `error` and `reference_error` hold: a metric, or the planner's distance to its goal.
    error, reference_error : list of float
        Per time step; either ends where its program did.
    truth : list
        [target][step] -> [x, y]. Of a planner the paths of the submission and of the reference.
    frames : list of dict
        {"step": int, "particles": [target][particle] -> [x, y]}, a thinned cloud every few steps; of a planner without
        clouds.
    picture : dict
        What a drawing of the world needs, from `Assignment.picture`; a planner's "targets" are whose paths they are.
    """

    variant: str
    episode: int
    metric: str
    error: list[float]
    reference_error: list[float]
    truth: list
    frames: list[dict]
    picture: dict


@dataclass(frozen=True)
class Result:
    """The grade of one submission and everything that explains it.

    Attributes
    ----------
    submission, path, digest : str
        Whose it is, the file, SHA-256 of its source.
    assignment : str
    status : str
        "graded" or "refused".
    message : str
        Why it was refused, or the line that explains the worst thing that happened; may be empty.
    points, max_points : float
    variants : list of VariantResult
    speed : SpeedResult or None
        None when the assignment has none, or when nothing could be timed.
    trace : Trace or None
    environment : dict
        Versions, isolation, secret's fingerprint: what a repetition needs.
    dimension : int
        Columns of a state: degrees of freedom of a "NEES".
    interval : list of float or None
        [low, high]: contains the points that infinitely many episodes would give, with the stated confidence, however
        early they ended. Those for time are added as they are. None where points are no sample's: of a refused
        submission, or after patience was lost.
    confidence : float or None
    stopped : str
        Why no more episodes were run, in words: one of `grader.grading.grade`'s.
    """

    submission: str
    path: str
    digest: str
    assignment: str
    status: str
    message: str
    points: float
    max_points: float
    variants: list[VariantResult] = field(default_factory=list)
    speed: SpeedResult | None = None
    trace: Trace | None = None
    environment: dict = field(default_factory=dict)
    dimension: int = 0
    interval: list[float] | None = None
    confidence: float | None = None
    stopped: str = ""

    @property
    def episodes(self):
        """How many episodes the points rest on."""
        return sum(len(variant.episodes) for variant in self.variants)

    def to_json(self):
        """The record as JSON text."""
        return json.dumps(self, ensure_ascii=False, allow_nan=False, default=_fields)

    @classmethod
    def from_json(cls, text):
        """The record that `to_json` wrote."""
        data = json.loads(text)
        data["variants"] = [
            VariantResult(
                **{
                    **variant,
                    "criteria": [CriterionResult(**criterion) for criterion in variant["criteria"]],
                    "episodes": [Episode(**episode) for episode in variant["episodes"]],
                }
            )
            for variant in data["variants"]
        ]
        data["speed"] = data["speed"] and SpeedResult(**data["speed"])
        data["trace"] = data["trace"] and Trace(**data["trace"])
        return cls(**data)


def _fields(record):
    # Not `asdict`: it copies every number of every picture.
    return vars(record)
