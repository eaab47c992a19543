"""What is asked: a declaration per assignment, no behaviour but its own arithmetic."""

import hashlib
import hmac
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol

import numpy as np

from grader.sandbox.program import PARAMETERS

#: Keys the episodes when the instructor gives no secret: anyone can repeat these.
PUBLIC_SECRET = b"public episodes"
#: What costs no points must be at least this many times the reference's CPU time.
FAIREST_LIMIT = 2.0
#: Updates that a timed run has at least.
FEWEST_TIMED = 10


@dataclass(frozen=True)
class Criterion:
    """How one metric of one variant earns points, episode by episode.

    Attributes
    ----------
    metric : str
        A key of what `Assignment.measure` returns.
    points : float
        What the variant is worth by this metric.
    full, none : float
        Ratios of the submission's metric to the reference's on the same episode: full marks up to the
        first, no marks from the second on, linear between.
    """

    metric: str
    points: float
    full: float
    none: float

    def score(self, value, reference):
        """Share of the points one episode earns, between 0 and 1; NaN earns nothing."""
        share = (self.none - value / reference) / (self.none - self.full)
        return float(min(max(share, 0.0), 1.0)) if np.isfinite(share) else 0.0


@dataclass(frozen=True)
class Uniform:
    """A number between two others, rounded to three significant digits so that a report can be read.

    Attributes
    ----------
    low, high : float
        Of at most three significant digits, so that rounding does not leave the range.
    """

    low: float
    high: float

    def __call__(self, rng):
        """Draw one."""
        return _rounded(rng.uniform(self.low, self.high))


@dataclass(frozen=True)
class LogUniform(Uniform):
    """A positive number whose logarithm is uniform: as likely between 1 and 2 as between 2 and 4."""

    def __call__(self, rng):
        """Draw one."""
        return _rounded(np.exp(rng.uniform(np.log(self.low), np.log(self.high))))


def _rounded(value):
    return float(f"{value:.3g}")


@dataclass(frozen=True, eq=False)
class Variant:
    """One setting of the world.

    Attributes
    ----------
    name : str
        Short and stable: episode seeds depend on it.
    title : str
        What is different here, in words a student reads.
    constants, hidden : dataclass
        What the estimator is told and what it is not.
    episodes : int
        How many of the runs in a round are its own. Points are the surest when that goes with what they are worth.
    criteria : tuple of Criterion
    ranges : dict of str to callable
        Fields of `constants` or `hidden` that the secret chooses: `draw(rng)` returns a value, as `Uniform` and
        `LogUniform` do. Until then, and empty in most variants, they are what the two records say.
    drawn : dict of str to object
        What the secret chose, for the instructor's record: no title and nothing a student reads names it.
    """

    name: str
    title: str
    constants: Any
    hidden: Any
    episodes: int
    criteria: tuple[Criterion, ...]
    ranges: dict[str, Callable] = field(default_factory=dict)
    drawn: dict[str, Any] = field(default_factory=dict)

    @property
    def points(self):
        """The most this variant can earn."""
        return sum(criterion.points for criterion in self.criteria)

    def under(self, secret, assignment):
        """This variant with what the secret draws from its ranges; itself when it has none.

        Parameters
        ----------
        secret : bytes
        assignment : str
            Name of the assignment. Each field is drawn by a stream of its own: no other field, variant or assignment
            has a say in it.
        """
        if not self.ranges:
            return self
        drawn = {
            name: draw(np.random.default_rng(seed(secret, assignment, self.name, name, "drawn")))
            for name, draw in self.ranges.items()
        }
        told = {name: value for name, value in drawn.items() if hasattr(self.constants, name)}
        untold = {name: value for name, value in drawn.items() if name not in told}
        return replace(
            self,
            constants=replace(self.constants, **told),
            hidden=replace(self.hidden, **untold),
            ranges={},
            drawn=drawn,
        )


@dataclass(frozen=True)
class Speed:
    """How CPU time earns points.

    Attributes
    ----------
    variant : str
        The variant that is timed.
    steps : int
        Updates in one timed run.
    points : float
    full, none : float
        Ratios of the submission's CPU time to the reference's: full marks up to the first, none from the second.

    Raises
    ------
    ValueError
        Limits that a noisy machine could turn into luck.
    """

    variant: str
    steps: int
    points: float
    full: float
    none: float

    def __post_init__(self):
        if not self.none > self.full >= FAIREST_LIMIT:
            raise ValueError(
                f"speed of {self.variant}: full marks up to {self.full:g} times the reference's CPU time and none from "
                f"{self.none:g}: the first must be at least {FAIREST_LIMIT:g}, the second larger"
            )
        if self.steps < FEWEST_TIMED:
            raise ValueError(f"speed of {self.variant}: {self.steps} updates are too few to time: take {FEWEST_TIMED}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Assignment:
    """What the grader knows of any assignment: declare an `EstimatorAssignment` or a `PlannerAssignment`.

    Attributes
    ----------
    name, title : str
    entry_point : str
        The function a submission must define.
    reference : str
        `module:function`, the same entry point as the instructor's copy has it.
    dimension : int
        Columns of a state in an estimator's posterior, or numbers in a planner's action.
    variants : tuple of Variant
    withheld : tuple of str
        Modules a submission may not import: they hold the answer.
    given : tuple of str
        Modules a submission is meant to import: fork servers have them, and it does not wait for them in each episode.
    deadline, first_call : float
        Wall seconds that one call may take before the worker is stopped, and that loading the file and the first call
        may take together.
    speed : Speed or None
        None where CPU time earns nothing, as in all closed loops.
    landmarks : dict
        Metric name to ((value, words), ...): the source's own figures, shown beside the results.
    """

    #: What the entry point returns: a key of `grader.sandbox.program.PARAMETERS`.
    answer: ClassVar[str]

    name: str
    title: str
    entry_point: str
    reference: str
    dimension: int
    variants: tuple[Variant, ...]
    withheld: tuple[str, ...]
    deadline: float
    first_call: float = 60.0
    given: tuple[str, ...] = ()
    speed: Speed | None = None
    landmarks: dict[str, tuple[tuple[float, str], ...]] = field(default_factory=dict)

    @property
    def parameters(self):
        """The entry point's parameters, in order."""
        return PARAMETERS[self.answer]

    @property
    def points(self):
        """The most a submission can earn."""
        return sum(variant.points for variant in self.variants) + (self.speed.points if self.speed else 0.0)

    def variant(self, name):
        """The variant of this name."""
        return next(variant for variant in self.variants if variant.name == name)

    def under(self, secret):
        """The assignment as a class with this secret meets it: every variant has its numbers.

        Whatever simulates or grades takes this one; the declaration itself has ranges where it needs numbers.
        """
        return replace(self, variants=tuple(variant.under(secret, self.name) for variant in self.variants))


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimatorAssignment(Assignment):
    """An estimator, graded on replays of recorded runs: `Estimator(previous, observation, control, constants, rng)`.

    Attributes
    ----------
    simulate : callable
        `simulate(variant, rng) -> Run`.
    measure : callable
        `measure(posterior, truth, rng) -> dict` of metric name to float, for one step; `truth` is a row of `Run.truth`.
        Reports read `grader.result.COVERAGE` among them as calibration.
    angles : tuple of int
        The columns of a state that are angles, in radians.
    positions : tuple of (int, int)
        State columns x and y of each target, for pictures.
    picture : callable
        `picture(variant) -> dict` of what a drawing of the world from above needs: "room" [x₀, y₀, x₁, y₁], "sensors"
        [[x, y, name], ...], "targets" [name, ...] and "unit"; it may have "obstacles" [[x₀, y₀, x₁, y₁], ...], or
        "rings" [[[x, y], ...], ...], the outlines of a map within "room": inside is what an odd number goes round.
    """

    answer = "posterior"

    simulate: Callable
    measure: Callable
    angles: tuple[int, ...]
    positions: tuple[tuple[int, int], ...]
    picture: Callable


class World(Protocol):
    """One episode of a planner: the truth, its noise and its clock. What a planner does not see is only here.

    Attributes
    ----------
    constants : dataclass
        Frozen: what the planner is told of this episode. Its fields are numbers, strings and tuples of these.
    over : bool
        Nothing more can happen: it has arrived, failed, or run out of time. The world itself must see to that.
    status, message : str
        Once it is over: "ok" and nothing; or "collided", "not arrived" or what else went wrong, and one line for the
        student that says when and where, such as "step 63 (3.15 s): flew into obstacle 4 at (1.20, 0.33, 2.00) m".
    """

    constants: Any
    over: bool
    status: str
    message: str

    def inputs(self):
        """What the planner is given next: the belief (an array, or None) and the state, an array."""

    def act(self, action):
        """Advance by one step.

        Parameters
        ----------
        action : ndarray, shape (dimension,)
            Finite, and otherwise anything: what lies beyond the actuators' limits is the world's to cut. However it is
            acted, every step takes the same draws of the world's generator: all planners meet the same gusts.
        """

    def metrics(self):
        """Metric name to a positive number, of an episode that ended "ok": the less the better."""

    def position(self):
        """Where it is, x and y, for pictures."""

    def distance(self):
        """How far the goal is, for the curve beside the picture."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlannerAssignment(Assignment):
    """A planner, graded in closed loop: `Planner(previous, belief, state, constants, rng)`.

    Attributes
    ----------
    simulate : callable
        `simulate(variant, rng) -> World`, at its start. The scene is drawn from `rng`, and later each step's noise.
    picture : callable
        `picture(world) -> dict` as an estimator's, without "targets"; it may have a "goal" [x, y, radius].
    """

    answer = "action"

    simulate: Callable
    picture: Callable


def seed(secret, *words):
    """A 128-bit seed nobody can guess without the secret.

    Parameters
    ----------
    secret : bytes
    words : str
        What the seed is for; without `|`. Different words have unrelated seeds.

    Returns
    -------
    int
        HMAC-SHA256 of the words, cut to 128 bits; a seed for `numpy.random.default_rng`.
    """
    return int.from_bytes(hmac.digest(secret, "|".join(words).encode(), hashlib.sha256)[:16], "little")


def episode_seed(secret, assignment, variant, episode, purpose):
    """The `seed` of one stream in one episode.

    Parameters
    ----------
    secret : bytes
    assignment, variant : str
        Names.
    episode : int
    purpose : str
        Whose randomness it is: "world", "estimator", "planner", "reference", "score". Purposes have unrelated streams.

    Returns
    -------
    int
    """
    return seed(secret, assignment, variant, str(episode), purpose)
