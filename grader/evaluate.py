"""Error: replay recorded runs to an estimator in its sandbox, and measure what it returns against the truth."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from course_lib.filters import Gaussian, Particles, equally_weighted
from course_lib.scoring import nees, thin
from grader.assignment import episode_seed
from grader.result import NEES
from grader.sandbox.program import Limits, Program, SandboxError, StudentError

#: Draws that stand for a Gaussian posterior where a metric wants particles.
GAUSSIAN_DRAWS = 2000
#: Particles of a picture, and steps between two pictures.
FRAME_PARTICLES, FRAME_EVERY = 100, 5
#: A metric beyond this says that the posterior is nowhere near its world, and would overflow what is made of it.
LARGEST_METRIC = 1e9


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one estimator in one episode.

    Attributes
    ----------
    status, message : str
        As in `grader.result.Episode`.
    metrics : dict of str to ndarray
        Metric name to its values at steps 0, 1, ..., as far as the estimator came; `NEES` at those with a Gaussian.
    frames : list of dict
        As in `grader.result.Trace`.
    """

    status: str
    message: str
    metrics: dict[str, np.ndarray]
    frames: list[dict] = field(default_factory=list)

    @property
    def values(self):
        """Metric name to its mean over the run; empty unless the run was finished."""
        if self.status != "ok":
            return {}
        return {name: float(np.mean(steps)) for name, steps in self.metrics.items()}


@lru_cache(maxsize=256)
def recorded_run(assignment, variant, episode, secret):
    """The run every submission of the class meets in this episode.

    Parameters
    ----------
    assignment : Assignment
    variant : Variant
    episode : int
    secret : bytes

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        The variant is a declaration whose numbers no secret has drawn.
    """
    if variant.ranges:
        raise ValueError(f"variant {variant.name} has ranges, not numbers: take it from assignment.under(secret)")
    seed = episode_seed(secret, assignment.name, variant.name, episode, "world")
    return assignment.simulate(variant, np.random.default_rng(seed))


def program(assignment, variant, episode, secret, source=None):
    """What a sandbox needs to run an estimator in this episode: the submission's source, or else the reference."""
    purpose = "estimator" if source is not None else "reference"
    return Program(
        source=source,
        trusted=assignment.reference if source is None else None,
        entry_point=assignment.entry_point,
        constants=variant.constants,
        seed=episode_seed(secret, assignment.name, variant.name, episode, purpose),
    )


def limits(assignment):
    """What one episode may use."""
    return Limits(call=assignment.deadline)


def evaluate(server, assignment, variant, episode, secret, source=None):
    """Replay one episode.

    Parameters
    ----------
    server : grader.sandbox.server.Server
        For submissions, or for the reference when `source` is None.
    assignment : Assignment
    variant : Variant
    episode : int
    secret : bytes
    source : str, optional
        The submission's source; the reference runs when it is left out.

    Returns
    -------
    Outcome
        Also of an estimator that fails: then with the metrics up to its last good step.

    Raises
    ------
    grader.sandbox.program.SandboxError
        The sandbox broke under the reference: it does not work at all. When it breaks twice under a submission, that
        submission broke it.
    """
    for _ in range(2):
        try:
            return _replay(server, assignment, variant, episode, secret, source)
        except SandboxError as error:
            if source is None:
                raise
            message = f"the sandbox broke twice while this program ran: {error}"
    return Outcome("sandbox", message, {})


def _replay(server, assignment, variant, episode, secret, source):
    run = recorded_run(assignment, variant, episode, secret)
    rng = np.random.default_rng(episode_seed(secret, assignment.name, variant.name, episode, "score"))
    steps, frames = [], []
    status, message = "ok", ""
    try:
        task = program(assignment, variant, episode, secret, source)
        with server.start(task, limits(assignment), dimension=assignment.dimension) as worker:
            for k in range(run.steps + 1):
                inputs = (None, None) if k == 0 else (run.observations[k - 1], run.controls[k - 1])
                posterior = worker.step(*inputs)
                particles = as_particles(posterior, k, rng)
                steps.append(measured(assignment, particles, run.truth[k], k, rng))
                if isinstance(posterior, Gaussian):
                    steps[-1][NEES] = _nees(posterior, run.truth[k], assignment.angles)
                if k % FRAME_EVERY == 0:
                    frames.append(_frame(particles, k, assignment.positions, rng))
    except StudentError as error:
        status, message = error.status, error.message
    names = dict.fromkeys(name for step in steps for name in step)
    metrics = {name: np.array([step[name] for step in steps if name in step]) for name in names}
    return Outcome(status, message, metrics, frames)


def as_particles(posterior, k, rng):
    """Every posterior as equally or otherwise weighted particles."""
    if isinstance(posterior, Particles):
        return posterior
    if isinstance(posterior, Gaussian):
        draws = rng.multivariate_normal(posterior.mean, posterior.covariance, GAUSSIAN_DRAWS, method="eigh")
        return equally_weighted(draws)
    raise StudentError(
        "invalid posterior",
        f"step {k}: expected one posterior of all targets together, got a list of {len(posterior)}",
    )


def measured(assignment, particles, truth, k, rng):
    """The metrics of one step, all of them numbers one can average and write down."""
    with np.errstate(over="ignore", invalid="ignore"):
        metrics = assignment.measure(particles, truth, rng)
    if not all(abs(value) <= LARGEST_METRIC for value in metrics.values()):
        largest = np.abs(particles.states).max()
        raise StudentError(
            "invalid posterior",
            f"step {k}: the states reach {largest:.3g}, too far to be measured: keep them in the world",
        )
    return metrics


def _nees(gaussian, truth, angles):
    """Mean over the truths; a sure and wrong Gaussian's is large, but a number."""
    with np.errstate(over="ignore"):
        return float(min(nees(gaussian, np.atleast_2d(truth), angles).mean(), LARGEST_METRIC))


def _frame(particles, k, positions, rng):
    states = thin(particles, FRAME_PARTICLES, rng).states
    return {"step": k, "particles": [states[:, list(columns)].round(2).tolist() for columns in positions]}
