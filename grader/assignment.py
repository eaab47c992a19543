"""What is asked: a declaration per assignment, no behaviour but its own arithmetic."""

import hashlib
import hmac
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Keys the episodes when the instructor gives no secret: anyone can repeat these.
PUBLIC_SECRET = b"public episodes"


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
        How many runs are replayed.
    criteria : tuple of Criterion
    """

    name: str
    title: str
    constants: Any
    hidden: Any
    episodes: int
    criteria: tuple[Criterion, ...]

    @property
    def points(self):
        """The most this variant can earn."""
        return sum(criterion.points for criterion in self.criteria)


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
    """

    variant: str
    steps: int
    points: float
    full: float
    none: float


@dataclass(frozen=True, eq=False)
class Assignment:
    """Everything the grader knows of one assignment.

    Attributes
    ----------
    name, title : str
    entry_point : str
        The function a submission must define.
    parameters : tuple of str
        Its parameters, in order.
    reference : str
        `module:function`, the same entry point as the instructor's copy has it.
    simulate : callable
        `simulate(variant, rng) -> Run`.
    measure : callable
        `measure(posterior, truth, rng) -> dict` of metric name to float, for one step; `truth` is a row of `Run.truth`.
    dimension : int
        Columns of a state.
    picture : callable
        `picture(variant) -> dict` of what a drawing of the world needs: room, sensors, axis titles.
    positions : tuple of (int, int)
        State columns x and y of each target, for pictures.
    variants : tuple of Variant
    speed : Speed
    withheld : tuple of str
        Modules a submission may not import: they hold the answer.
    deadline : float
        Wall seconds one call may take before the worker is stopped.
    landmarks : dict
        Metric name to ((value, words), ...): the source's own figures, shown beside the results.
    """

    name: str
    title: str
    entry_point: str
    parameters: tuple[str, ...]
    reference: str
    simulate: Callable
    measure: Callable
    dimension: int
    picture: Callable
    positions: tuple[tuple[int, int], ...]
    variants: tuple[Variant, ...]
    speed: Speed
    withheld: tuple[str, ...]
    deadline: float
    landmarks: dict[str, tuple[tuple[float, str], ...]]

    @property
    def points(self):
        """The most a submission can earn."""
        return sum(variant.points for variant in self.variants) + self.speed.points

    def variant(self, name):
        """The variant of this name."""
        return next(variant for variant in self.variants if variant.name == name)


def episode_seed(secret, assignment, variant, episode, purpose):
    """A 128-bit seed nobody can guess without the secret.

    Parameters
    ----------
    secret : bytes
    assignment, variant : str
        Names.
    episode : int
    purpose : str
        Whose randomness it is: "world", "estimator", "reference", "score". Purposes have unrelated streams.

    Returns
    -------
    int
        HMAC-SHA256 of what names the episode, cut to 128 bits; a seed for `numpy.random.default_rng`.
    """
    words = "|".join([assignment, variant, str(episode), purpose])
    return int.from_bytes(hmac.digest(secret, words.encode(), hashlib.sha256)[:16], "little")
