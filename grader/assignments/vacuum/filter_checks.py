"""What the checks of likelihood, resampling, roughening and the whole filter try, and the faults they know by name.

Statistical checks draw from fixed seeds and fail a right function with a probability of at most 1e-8.
"""

import functools
import itertools
import warnings

import numpy as np
from scipy.stats import kstest

from course_lib.filters.particles import Step
from course_lib.recording import replay
from course_lib.scoring import best_share_error
from course_lib.vacuum import models
from course_lib.vacuum.constants import Constants, Hidden
from course_lib.vacuum.world import World
from grader.assignments.vacuum.motion_checks import OTHER_ROOM, RARE
from grader.lessons import expect


def log_likelihood(function):
    """Against the model, sensor by sensor and all together, in the words of the fault that was made."""
    rng = np.random.default_rng(3)
    silent = np.full(4, np.inf)
    for constants in (Constants(), OTHER_ROOM):
        n = 300
        states = rng.uniform(-np.pi, np.pi, (n, 6))
        states[:, [0, 1]] = rng.uniform(0, constants.room, (n, 2))
        states[:, [3, 4]] = rng.uniform(0, constants.room, (n, 2))
        # Readings near the distances of the first state, so that a good share of the likelihoods is not zero.
        readings = models.distances(states[:1], constants)[0, [0, 0, 1, 1], np.arange(4)] + 0.2 * constants.w_bar
        observations = [silent]
        observations += [np.where(np.arange(4) == i, readings, np.inf) for i in range(4)]
        observations += [np.where(np.arange(4) == [[0], [2]], readings, np.inf).min(axis=0), readings]
        for observation in observations:
            words = ", ".join("inf" if np.isinf(z) else f"{z:.2f}" for z in observation)
            call = f"log_likelihood([{words}], states, constants with L = {constants.L:g}, s̄ = {constants.s_bar})"
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                got = function(observation, states, constants)
            _reads_silence(got, observation, states, constants, call)
            got = expect.array(got, (n,), call, kind="l")
            expected = models.log_likelihood(observation, states, constants)
            # A state where the wrong models differ from each other shows best what went wrong.
            expect.close(got, expected, call, _likelihood_faults(observation, states, constants, expected))
            assert not caught, (
                f"{call}: right, but it warns: {caught[0].message}; the logarithm of 0 is meant here, so compute it "
                'within `with np.errstate(divide="ignore"):`'
            )


def _reads_silence(got, observation, states, constants, call):
    """Fail when a silent sensor's inf was computed with."""
    silent = np.isinf(observation)
    if not silent.any() or not isinstance(got, np.ndarray) or got.shape != (len(states),) or got.dtype.kind != "f":
        return
    possible = np.isfinite(models.log_likelihood(observation, states, constants))
    if possible.any() and not np.isfinite(got[possible]).any():
        raise AssertionError(
            f"inf is treated as a reading: a silent sensor says nothing, so it changes no likelihood\n{call}: "
            f"{got[possible][0]} at a state that explains the other readings"
        )


def _likelihood_faults(observation, states, constants, expected):
    """What faulty models say instead of the right one, and their names."""

    def model(combine=None, tuned=(0, 0, 1, 1), sensors=(0, 1, 2, 3), density=None, across=None, told=constants):
        reports = np.flatnonzero(np.isfinite(observation))
        apart = np.linalg.norm(states[:, [[0, 1], [3, 4]]][:, :, None] - told.sensors[list(sensors)], axis=-1)
        noise = observation[reports] - apart[:, :, reports]
        f = (density or models.triangular_density)(noise, told.w_bar)
        robot, column = np.array(tuned)[reports], np.arange(len(reports))
        right, wrong = f[:, robot, column], f[:, 1 - robot, column]
        each = combine(right, wrong) if combine else (1 - told.s_bar) * right + told.s_bar * wrong
        with np.errstate(divide="ignore"):
            return across(each) if across else np.log(each).sum(axis=1)

    def swapped(right, wrong):
        return constants.s_bar * right + (1 - constants.s_bar) * wrong

    reports = np.flatnonzero(np.isfinite(observation))
    if not len(reports):
        return
    yield model(tuned=(0, 0, 0, 0)), "Sensors 3 and 4 are read as if tuned to robot A; they are tuned to B."
    yield model(tuned=(0, 1, 0, 1)), "S1 and S2 are tuned to A, S3 and S4 to B."
    yield (
        model(lambda right, wrong: right),
        "The mixture is missing: with probability s̄ a sensor measures the other robot.",
    )
    yield model(lambda right, wrong: right + wrong), "The two cases need their probabilities 1 - s̄ and s̄ as weights."
    yield model(swapped), "The weights of the mixture are swapped: 1 - s̄ belongs to the robot the sensor is tuned to."
    if constants != Constants():
        yield model(told=Constants()), "The numbers are those of the default constants: read all from `constants`."
    with np.errstate(divide="ignore"):
        yield np.exp(expected), "This is the likelihood: return its logarithm."
        yield expected / np.log(10.0), "This is the logarithm to base 10: use np.log."
    if len(reports) > 1:
        yield model(across=lambda each: np.log(each.sum(axis=1))), "Independent sensors: multiply, do not add."
        yield model(across=lambda each: np.log(each.mean(axis=1))), "Independent sensors: multiply, do not average."
        yield model(across=lambda each: np.log(each[:, -1])), "Only the last sensor that reports is used."
        yield model(across=lambda each: np.log(each[:, 0])), "Only the first sensor that reports is used."
    for order in itertools.permutations(range(4)):
        if order != (0, 1, 2, 3):
            yield model(sensors=order), "The positions of the sensors are swapped: compare with `constants.sensors`."
    for density, name in [
        (
            lambda w, half: np.maximum(1 - np.abs(w) / half, 0),
            "The triangle's area is not 1: its peak has the height 1/w̄.",
        ),
        (lambda w, half: (np.abs(w) <= half) / (2 * half), "The noise is taken as uniform; its density is a triangle."),
        (
            lambda w, half: np.where(np.abs(w) <= half, 1 - w / half, 0) / half,
            "The triangle has two sides: take the absolute value of the residual.",
        ),
        (
            lambda w, half: np.exp(-(w**2) / (2 * half**2)) / np.sqrt(2 * np.pi * half**2),
            "The noise is taken as normal; its density is a triangle.",
        ),
    ]:
        yield model(density=density), name
    for tiny in (1e-300, 1e-12, 1e-10, 1e-9):
        yield (
            np.logaddexp(expected, np.log(tiny)),
            f"Adding {tiny:g} hides zeros: a likelihood of zero is -inf as a logarithm.",
        )


def systematic(function):
    """Counts of offspring: bounded in each draw, right on average, at the edges of the unit interval too."""
    rng = np.random.default_rng(4)
    ragged = rng.dirichlet(np.full(12, 0.4))
    draws = 4000
    for weights in (np.array([0.5, 0.3, 0.2]), np.array([0.0, 0.25, 0.75, 0.0]), ragged):
        n = len(weights)
        call = f"systematic({np.round(weights, 3).tolist()}, rng)"
        counts = np.empty((draws, n))
        for d in range(draws):
            indices = expect.array(function(weights.copy(), rng), (n,), call, kind="i")
            outside = (indices < 0) | (indices >= n)
            assert not outside.any(), f"{call}: index {indices[outside][0]} is outside 0 ... {n - 1}"
            counts[d] = np.bincount(indices, minlength=n)
        share = n * weights
        mean = counts.mean(axis=0)
        table = f"{call}\nmean offspring: expected {np.round(share, 3).tolist()}, got {np.round(mean, 3).tolist()}"
        assert not mean[weights == 0].any(), f"A particle of weight zero has offspring.\n{table}"
        # A count lies between ⌊share⌋ and ⌈share⌉, so its variance is at most 1/4; of a mean, 7 standard deviations.
        biased = np.abs(mean - share) > 7 * np.sqrt(np.maximum(counts.var(axis=0), 0.25) / draws)
        if biased.any():
            fixed = not np.ptp(counts, axis=0).any()
            reason = "The same offspring in every draw: draw a number from rng" if fixed else "Offspring are biased"
            raise AssertionError(f"{reason}; on average, i has N wᵢ.\n{table}")
        wild = (counts < np.floor(share - 1e-9)) | (counts > np.ceil(share + 1e-9))
        if wild.any():
            d, i = np.argwhere(wild)[0]
            raise AssertionError(
                "Right on average, but not systematic: one number for all positions (u + n) / N, not one for each.\n"
                f"{call}: expected {np.floor(share[i]):.0f} or {np.ceil(share[i]):.0f} offspring of index {i}, "
                f"got {counts[d, i]:.0f}"
            )
    many = rng.dirichlet(np.full(200, 0.4))
    expect.repeats(lambda rng: function(many, rng), "systematic")
    weights = np.full(1000, 0.001)
    weights *= (1 - 1e-12) / weights.sum()
    indices = expect.array(function(weights, _LargeDraw(np.random.PCG64(5))), (1000,), "systematic", kind="i")
    assert indices.max() < 1000, (
        "systematic(1000 weights that sum to 1 - 1e-12, rng) when rng.random() is 1 - 1e-10: index 1000, one too many\n"
        "Rounding leaves the last cumulative weight a little below 1: divide by it."
    )


class _LargeDraw(np.random.Generator):
    """Draws uniform numbers close to 1."""

    def random(self, size=None, **_):
        return (1 - 1e-10) * (np.ones(size) if size is not None else 1.0)

    def uniform(self, low=0.0, high=1.0, size=None):
        return low + (high - low) * self.random(size)


def roughen(function):
    """The deviation of the jitter, column by column; walls; wrapping."""
    n, K = 5000, 0.05
    rng = np.random.default_rng(6)
    for constants in (Constants(), Constants(L=10.0, length=2.0)):
        centre = np.array([*constants.room / 2, 0.0, *constants.room / 2, 0.0])
        extent = np.array([1.0, 0.6, 1.5, 0.8, 1.2, 0.9])
        states = centre + extent * (rng.random((n, 6)) - 0.5)
        # The ends of each column are there, so that its extent is known exactly.
        states[0], states[1] = centre - extent / 2, centre + extent / 2
        call = f"roughen(states {states.shape}, K = {K}, constants, rng)"
        got = expect.array(function(states, K, constants, np.random.default_rng(7)), states.shape, call)
        jitter = got - states
        assert jitter.any(), f"{call}: returns the states unchanged"
        expected = K * extent * n ** (-1 / 6)
        deviation = jitter.std(axis=0)
        room = np.tile([*constants.room, 2 * np.pi], 2)
        for ratio, name in [
            (np.zeros(6), "All particles get the same jitter: copies stay copies. Draw (N, 6) numbers."),
            (np.full(6, n ** (1 / 6)), "The factor N^(-1/6) is missing."),
            (np.full(6, n ** (1 / 6 - 1)), "The exponent of N is -1/6: one over the number of columns."),
            (np.full(6, n ** (1 / 6 - 1 / 2)), "The exponent of N is -1/6: one over the number of columns, not 1/2."),
            (
                np.full(6, n ** (1 / 6 - 1 / 3)),
                "The exponent of N is -1/6: the joint state has six columns, not three.",
            ),
            (np.full(6, n ** (1 / 3)), "The exponent of N is -1/6: more particles need less jitter."),
            (room / extent, "E is the interval the particles span, not the room."),
            (states.std(axis=0) / extent, "E is the largest minus the smallest value, not the standard deviation."),
            (1 / extent, "The factor E is missing: each column spans its own interval."),
            (np.sqrt(expected) / expected, "K E N^(-1/6) is the standard deviation, not the variance."),
            (expected, "K E N^(-1/6) is the standard deviation: it is squared here."),
            (np.full(6, 1 / np.sqrt(3)), "The jitter is uniform; Gordon's is normal."),
        ]:
            # The deviation of 5000 normal numbers is known to 1 %; 7 times that.
            if np.allclose(deviation, ratio * expected, rtol=0.07, atol=1e-12):
                raise AssertionError(
                    f"{name}\n{call}: standard deviation per column: expected {np.round(expected, 4).tolist()}, "
                    f"got {np.round(deviation, 4).tolist()}"
                )
        assert np.allclose(deviation, expected, rtol=0.07), (
            f"{call}: standard deviation of the jitter per column:\nexpected {np.round(expected, 4).tolist()}\n"
            f"got {np.round(deviation, 4).tolist()}"
        )
        assert (np.abs(jitter.mean(axis=0)) < 6.5 * expected / np.sqrt(n)).all(), (
            f"{call}: the jitter has a mean: {np.round(jitter.mean(axis=0), 4).tolist()}, expected 0"
        )
        for column in range(6):
            assert kstest(jitter[:, column] / expected[column], "norm").pvalue > RARE, (
                f"{call}: the jitter is not normal"
            )
        related = np.abs(np.corrcoef(jitter.T) - np.eye(6)).max()
        assert related < 0.15, f"{call}: columns get the same jitter (correlation {related:.2f}); draw (N, 6) numbers"
        edge = np.array([[0, 0, -np.pi, *constants.room, 3.14], [*constants.room, 3.14, 0, 0, -np.pi]])[
            np.arange(n) % 2
        ]
        call = "roughen at the walls, headings near ±π"
        got = expect.array(function(edge, K, constants, np.random.default_rng(7)), edge.shape, call)
        positions = got[:, [0, 1, 3, 4]]
        out = (positions < -1e-12) | (positions > np.tile(constants.room, 2) + 1e-12)
        assert not out.any(), f"{call}: {out.any(axis=1).sum()} of {n} particles leave the room: keep positions in it"
        turned = got[:, [2, 5]]
        loose = (turned < -np.pi) | (turned >= np.pi)
        assert not loose.any(), f"{call}: heading {turned[loose][0]:.4f} is not wrapped to [-π, π)"
    expect.repeats(lambda rng: function(states, K, Constants(), rng), "roughen")


#: Runs of the last check, and what passes: the exercise sheet's 0.4 m and one standard deviation of a mean over them.
RUNS = 3
ENOUGH = 0.5


def estimator(function):
    """The contract first, then recorded runs beside the course's reference."""
    _contract(function)
    errors = [_run_error(function, run, f"Estimator in run {i + 1}") for i, run in enumerate(_recorded_runs())]
    got = f"{np.mean(errors):.3f} m ({', '.join(f'{e:.2f}' for e in errors)})"
    own = _reference_errors()
    beside = f", the course's reference {np.mean(own):.3f} m ({', '.join(f'{e:.2f}' for e in own)})" if own else ""
    line = f"Error over {RUNS} recorded runs: yours {got}{beside}; the exercise sheet's 0.4 m."
    assert np.mean(errors) <= ENOUGH, f"{line}\nTo pass here, at most {ENOUGH} m. Do all the pieces above pass?"
    return line


def _recorded_runs():
    return [World().simulate(np.random.default_rng([2015, i])) for i in range(RUNS)]


@functools.cache
def _reference_errors():
    """The reference's error in each recorded run; nothing where the reference was not handed out."""
    try:
        from course_lib.vacuum.reference import Estimator
    except ModuleNotFoundError:
        return []
    return [_run_error(Estimator, run, "the reference") for run in _recorded_runs()]


def _contract(function):
    """First call, silence, the impossible, other constants."""
    expect.repeats(
        lambda rng: _read(function(None, None, None, Constants(), rng), Constants(), "the first call")[0], "Estimator"
    )
    for constants in (Constants(), OTHER_ROOM, Constants(v_bar=0.0, w_bar=0.2, s_bar=0.0)):
        rng = np.random.default_rng(9)
        where = f"in a room of {constants.room[0]:g} m x {constants.room[1]:g} m, s̄ = {constants.s_bar:g}"
        posterior = function(None, None, None, constants, rng)
        states, weights = _read(posterior, constants, f"Estimator(None, None, None, constants, rng) {where}")
        for robot, name in enumerate("AB"):
            corners = constants.sensors[2 * robot : 2 * robot + 2]
            apart = np.linalg.norm(states[:, None, 3 * robot : 3 * robot + 2] - corners, axis=-1)
            assert apart.min(axis=1).max() < 0.1 * constants.L, (
                f"The first call {where} returns the prior: {name} in its corners"
            )
            assert 0.2 < weights @ (apart[:, 0] < apart[:, 1]) < 0.8, (
                f"The first call {where}: {name} starts in either of its two corners with probability 1/2, "
                f"got {weights @ (apart[:, 0] < apart[:, 1]):.2f} for the first"
            )
        silent = np.full(4, np.inf)
        diagonal = float(np.linalg.norm(constants.room))
        for observation, words in [
            (silent, "when all sensors are silent"),
            (
                np.array([diagonal + 10 * constants.w_bar, np.inf, np.inf, 0.0]),
                "when no particle can explain the readings",
            ),
            (silent, "in the step after that"),
        ]:
            posterior = function(posterior, observation, np.array([1.5, 1.0]), constants, rng)
            _read(posterior, constants, f"Estimator {words}, {where},")
        run = World(constants, Hidden(steps=30)).simulate(np.random.default_rng(10))
        for posterior in replay(function, run, constants, rng):
            _read(posterior, constants, f"Estimator on a run {where}")


def _run_error(function, run, words):
    """The exercise's error: mean distance of each robot's better half to its truth, over all time steps."""
    total = 0.0
    for truth, posterior in zip(run.truth, replay(function, run, Constants(), np.random.default_rng(21)), strict=True):
        states, weights = _read(posterior, Constants(), words)
        for column in (0, 3):
            distances = np.linalg.norm(states[:, column : column + 2] - truth[column : column + 2], axis=1)
            total += best_share_error(distances, weights) / 2
    return total / len(run.truth)


def _read(posterior, constants, call):
    """States and weights of a posterior, after making sure that it is one."""
    if isinstance(posterior, Step):
        posterior = posterior.posterior
    pair = isinstance(posterior, tuple) and len(posterior) == 2
    try:
        states = np.asarray(posterior[0] if pair else posterior)
    except ValueError:
        states = np.empty(0)
    assert states.ndim == 2 and states.shape[1] == 6 and len(states), (
        f"{call}: expected Particles(states, log_weights) or an array (N, 6), got "
        f"{'states of ' if pair else ''}{f'shape {states.shape}' if states.ndim else type(posterior).__name__}"
    )
    states = expect.array(states, states.shape, f"{call}: states")
    weights = np.full(len(states), 1 / len(states))
    if pair:
        weights = np.exp(expect.array(posterior[1], (len(states),), f"{call}: log_weights", kind="l"))
        assert abs(weights.sum() - 1) < 1e-6, f"{call}: the weights sum to {weights.sum():.6g}, expected 1"
    positions = states[:, [0, 1, 3, 4]]
    out = (positions < -1e-6) | (positions > np.tile(constants.room, 2) + 1e-6)
    assert not out.any(), f"{call}: {out.any(axis=1).sum()} of {len(states)} particles are outside the room"
    return states, weights
