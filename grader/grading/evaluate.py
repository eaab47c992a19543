"""Error: replay recorded runs to an estimator in its sandbox and measure its posteriors against the truth; or let a
planner, there, steer a world that is here, and see how it ends."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from course_lib.angles import wrap
from course_lib.filters import Gaussian, Particles, equally_weighted
from course_lib.scoring import nees, thin
from grader.assignment import episode_seed
from grader.result import NEES
from grader.sandbox.program import Limits, Program, SandboxError, StudentError

#: Draws that stand for a Gaussian posterior where a metric wants particles, in pairs on either side of the mean.
GAUSSIAN_DRAWS = 500
#: Particles of a picture, and steps between two pictures.
FRAME_PARTICLES, FRAME_EVERY = 100, 5
#: A metric beyond this says that an answer is nowhere near its world, and would overflow what is made of it.
LARGEST_METRIC = 1e9


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one program in one episode.

    Attributes
    ----------
    status, message : str
        As in `grader.result.Episode`.
    metrics : dict of str to ndarray
        Metric name to its values at steps 0, 1, ..., as far as the estimator came; `NEES` at those with a Gaussian. Of
        a planner that arrived, to the one value each.
    frames : list of dict
        As in `grader.result.Trace`; of estimators.
    path, distances : list
        The planner's [x, y] and its distance to the goal at times 0, 1, ..., as far as it came.
    draw : int
        Which draw of the episode this was, as `simulated` takes it.
    """

    status: str
    message: str
    metrics: dict[str, np.ndarray]
    frames: list[dict] = field(default_factory=list)
    path: list[list[float]] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)
    draw: int = 0

    @property
    def values(self):
        """Metric name to its mean over the run; empty unless the run was finished."""
        if self.status != "ok":
            return {}
        return {name: float(np.mean(steps)) for name, steps in self.metrics.items()}


@lru_cache(maxsize=256)
def recorded_run(assignment, variant, episode, secret):
    """The run every estimator of the class meets in this episode.

    Parameters
    ----------
    assignment : EstimatorAssignment
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
    return simulated(assignment, variant, episode, secret)


def simulated(assignment, variant, episode, secret, draw=0):
    """As `recorded_run`; of a PlannerAssignment a world at its start, which is nobody else's.

    Of a scene that the reference cannot master (`grade.reference_outcome`), the class meets another `draw`.
    """
    if variant.ranges:
        raise ValueError(f"variant {variant.name} has ranges, not numbers: take it from assignment.under(secret)")
    purpose = f"world, draw {draw}" if draw else "world"
    seed = episode_seed(secret, assignment.name, variant.name, episode, purpose)
    return assignment.simulate(variant, np.random.default_rng(seed))


def program(assignment, variant, episode, secret, source=None, constants=None):
    """What a sandbox needs to run a program in this episode: the submission's source, or else the reference.

    It is told the constants of the variant, or those given.
    """
    purpose = "reference" if source is None else {"posterior": "estimator", "action": "planner"}[assignment.answer]
    return Program(
        source=source,
        trusted=assignment.reference if source is None else None,
        entry_point=assignment.entry_point,
        constants=variant.constants if constants is None else constants,
        seed=episode_seed(secret, assignment.name, variant.name, episode, purpose),
        answer=assignment.answer,
    )


def preload(assignment):
    """Modules of what programs are given, for a fork server to import.

    Parameters
    ----------
    assignment : Assignment
        Under a secret.

    Returns
    -------
    tuple of str
    """
    given = assignment.variants[0].constants
    if assignment.answer == "action":
        given = assignment.simulate(assignment.variants[0], np.random.default_rng(0)).constants
    return (type(given).__module__, *assignment.given)


def limits(assignment):
    """What one episode may use."""
    return Limits(call=assignment.deadline, first_call=assignment.first_call)


def evaluate(server, assignment, variant, episode, secret, source=None, draw=0):
    """Run one episode.

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
    draw : int
        Of a planner's world: as in `simulated`.

    Returns
    -------
    Outcome
        Also of a program that fails: then with the metrics or the path up to its last good step.

    Raises
    ------
    grader.sandbox.program.SandboxError
        The sandbox broke under the reference: it does not work at all. When it breaks twice under a submission, that
        submission broke it.
    """
    for _ in range(2):
        try:
            if assignment.answer == "action":
                return _steer(server, assignment, variant, episode, secret, source, draw)
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
                particles = as_particles(posterior, assignment.angles, k, rng)
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


def _steer(server, assignment, variant, episode, secret, source, draw):
    world = simulated(assignment, variant, episode, secret, draw)
    path, distances, metrics = [], [], {}

    def look():
        path.append([round(float(coordinate), 3) for coordinate in world.position()])
        distances.append(round(float(world.distance()), 4))

    try:
        task = program(assignment, variant, episode, secret, source, world.constants)
        with server.start(task, limits(assignment), dimension=assignment.dimension) as worker:
            look()
            while not world.over:
                world.act(worker.step(*world.inputs()))
                look()
        status, message = world.status, world.message
        if status == "ok":
            metrics = {name: np.array([value]) for name, value in achieved(world).items()}
    except StudentError as error:
        status, message = error.status, error.message
    return Outcome(status, message, metrics, path=path, distances=distances, draw=draw)


def achieved(world):
    """The metrics of a world that ended well, all of them numbers one can write down."""
    metrics = world.metrics()
    for name, value in metrics.items():
        if not abs(value) <= LARGEST_METRIC:
            message = f"the {name} is {value:.3g}: keep actions within the actuators' limits"
            raise StudentError("invalid action", message)
    return metrics


def as_particles(posterior, angles, k, rng):
    """Every posterior as equally or otherwise weighted particles.

    Of a Gaussian, draws whose angles are wrapped. They take as much of `rng` whatever its numbers are, so that the
    reference and a submission that both return Gaussians are compared by the same draws.
    """
    if isinstance(posterior, Particles):
        return posterior
    if isinstance(posterior, Gaussian):
        return equally_weighted(_draws(posterior, list(angles), rng))
    raise StudentError(
        "invalid posterior",
        f"step {k}: expected one posterior of all targets together, got a list of {len(posterior)}",
    )


def _draws(gaussian, angles, rng):
    with np.errstate(over="ignore", invalid="ignore"):
        # Scaled to at most one, no entry can overflow.
        scale = np.abs(gaussian.covariance).max() or 1.0
        variances, axes = np.linalg.eigh(gaussian.covariance / scale)
        normals = rng.standard_normal((GAUSSIAN_DRAWS // 2, len(variances)))
        # The symmetric root: where covariances differ little, draws by the same normals do.
        deviations = normals @ (np.sqrt(scale) * axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T)
        states = np.concatenate([gaussian.mean + deviations, gaussian.mean - deviations])
        states[:, angles] = wrap(states[:, angles])
    return states


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
