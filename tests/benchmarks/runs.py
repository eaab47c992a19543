"""Filters over recorded runs: what every accuracy benchmark measures, in parallel processes."""

import os
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import NamedTuple

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from course_lib.scoring import best_share_error, energy_score, region_rank, thin
from course_lib.vacuum.world import World

#: Particles that stand for a posterior in the scores that cost O(N²), and how often those are taken.
THINNED = 500
EVERY = 5


class Measured(NamedTuple):
    """What a filter did on one run: means over the steps, and the CPU time of the updates.

    Attributes
    ----------
    best_half, second_half : float
        ETH's error (m) over all steps and over the second half of them.
    all_particles : float
        Mean distance of all particles (m).
    energy : float
        Energy score of (x_A, y_A, x_B, y_B) in metres, at every fifth step.
    coverage : float
        Share of the same steps at which the truth lies in the most central 90 % of the posterior.
    cpu : float
        Process CPU time per update (ms).
    """

    best_half: float
    second_half: float
    all_particles: float
    energy: float
    coverage: float
    cpu: float


def measure(estimator, constants, hidden, index):
    """Replay one run and score the estimator on it.

    Parameters
    ----------
    estimator : callable
        As in `course_lib.recording.replay`.
    constants : Constants
    hidden : Hidden
    index : int
        Names the run: the same index gives every estimator the same truth and readings.

    Returns
    -------
    Measured
    """
    run = World(constants, hidden).simulate(np.random.default_rng([1, index]))
    own, scorer = np.random.default_rng([2, index]), np.random.default_rng([3, index])
    previous, cpu, errors, proper = None, 0.0, [], []
    for k, truth in enumerate(run.truth):
        data = (run.observations[k - 1], run.controls[k - 1]) if k else (None, None)
        start = time.process_time()
        previous = estimator(previous, *data, constants, own)
        cpu += (time.process_time() - start) if k else 0.0
        posterior = getattr(previous, "posterior", previous)
        errors.append(_errors(posterior, truth))
        if k % EVERY == 0:
            proper.append(_proper(posterior, truth, scorer))
    errors, proper = np.array(errors), np.array(proper)
    return Measured(
        errors[:, 0].mean(),
        errors[run.steps // 2 :, 0].mean(),
        errors[:, 1].mean(),
        proper[:, 0].mean(),
        proper[:, 1].mean(),
        1e3 * cpu / run.steps,
    )


def measure_all(tasks, title):
    """`measure` on many runs at once, one process per core, under a progress bar.

    Parameters
    ----------
    tasks : list of tuple
        Arguments of `measure`.
    title : str

    Returns
    -------
    list of Measured
    """
    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()]
    with Progress(*columns) as progress, ProcessPoolExecutor(os.cpu_count()) as pool:
        futures = [pool.submit(measure, *task) for task in tasks]
        bar = progress.add_task(title, total=len(futures))
        for _ in as_completed(futures):
            progress.advance(bar)
    return [future.result() for future in futures]


def columns_of(measured):
    """The same numbers as one `Measured` of arrays."""
    return Measured(*np.array(measured).T)


def _errors(posterior, truth):
    best_half, everyone = [], []
    for column in (0, 3):
        distance = np.hypot(*(posterior.states[:, column : column + 2] - truth[column : column + 2]).T)
        best_half.append(best_share_error(distance, posterior.weights))
        everyone.append(distance @ posterior.weights)
    return np.mean(best_half), np.mean(everyone)


def _proper(posterior, truth, rng):
    columns = [0, 1, 3, 4]
    points, truth = thin(posterior, THINNED, rng).states[:, columns], truth[columns]
    weights = np.full(len(points), 1.0 / len(points))
    return energy_score(points, weights, truth[None]), region_rank(points, weights, truth) <= 0.9
