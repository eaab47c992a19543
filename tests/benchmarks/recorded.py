"""Recorded robots: how near the two filters come to the truth, and what each of their precautions is worth."""

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Column, Table
from scipy.stats import chi2

from course_lib.angles import wrap
from course_lib.beacon.planar.calibration import calibrate, labyrinth, sighting_residuals
from course_lib.beacon.planar.filters import dead_reckoning, kalman_step, localize, particle_step
from course_lib.beacon.planar.robot import Constants
from course_lib.recording import GroundRecording, RecordingError, read_mrclam, read_uwb

#: Seconds between the instants at which errors are taken: filters take their steps at the same ones, and at sightings.
EVERY = 0.2
#: Each robot of MRCLAM and the one that says how to read its odometry and camera.
CALIBRATED_ON = {3: 1, 1: 3}
FILTERS = {"EKF": kalman_step, "PF": particle_step}


class Row(NamedTuple):
    """One line of a table: a filter, what it is told, and of which recording."""

    name: str
    recording: GroundRecording
    constants: Constants
    step: Callable


def recorded(console: Console, runs):
    """Both filters on the recordings that are there, each with `runs` seeds."""
    folder = os.environ.get("COURSE_DATA")
    if not folder:
        console.print(
            "recorded: left out, for there are no recordings: name the folder that holds mrclam6 and uwb with "
            "--data FOLDER or in COURSE_DATA"
        )
        return
    console.print(
        "Filters start at the true pose plus an error of 0.1 m and 0.1 rad (one standard deviation), which differs "
        "from seed to seed; they use the truth for nothing else.\n"
    )
    for tables in (mrclam, labyrinth_tables):
        try:
            made = list(tables(Path(folder)))
        except RecordingError as error:
            console.print(f"left out: {error}")
            continue
        for title, rows in made:
            _print(console, title, rows, runs)


def mrclam(folder):
    """Tables of MRCLAM: titles and rows."""
    robots = {robot: read_mrclam(folder / "mrclam6", robot) for robot in CALIBRATED_ON}
    for robot, other in CALIBRATED_ON.items():
        recording, told = robots[robot], calibrate(robots[other])
        as_it_is = replace(told, v_scale=1.0, omega_scale=1.0, omega_offset=0.0, delay=0.0)
        rows = [
            *_both("", recording, told),
            *_both("range as a distance", recording, calibrate(robots[other], depth=False)),
            *_both("errors independent", recording, calibrate(robots[other], window=1e-3)),
            *_both("odometry as it is", recording, as_it_is),
            *_both("bearings not wrapped", recording, told, difference=np.subtract),
            Row("dead reckoning", recording, told, dead_reckoning),
        ]
        yield f"MRCLAM set 6, robot {robot}: noise, odometry and camera calibrated on robot {other}", rows


def labyrinth_tables(folder):
    """Table of the UWB labyrinth: title and rows."""
    recording = read_uwb(folder / "uwb")
    constant = {"bias_sigma": 0.0, "bias_walk": 0.0}
    bias = float(sighting_residuals(recording, depth=False)[2][:, 0].mean())
    rows = [
        *_both("bias estimated", recording, labyrinth(recording)),
        *_both("bias ignored", recording, labyrinth(recording, **constant)),
        *_both(f"told {bias:+.2f} m", recording, labyrinth(recording, **constant, range_offset=bias)),
        Row("dead reckoning", recording, labyrinth(recording), dead_reckoning),
    ]
    yield "UWB labyrinth: noise as its files state it; the bias that is told is from its own truth", rows


def errors(track):
    """What a track is worth, at instants EVERY seconds apart.

    Parameters
    ----------
    track : Track

    Returns
    -------
    rmse, median : float
        Of the distance to the true position (m).
    nees : float
        Mean normalised error squared, over the dimension (3, or 2 where the true heading is not known): ideally 1.
    coverage : float
        Share of instants at which the truth lies in the Gaussian 90 % region: ideally 0.9.
    """
    instants = np.arange(track.times[0], track.times[-1], EVERY)
    steps = np.searchsorted(track.times, instants, side="right") - 1
    error = track.means[steps, :3] - track.truth[steps]
    error[:, 2] = wrap(error[:, 2])
    known = 3 if np.isfinite(error[:, 2]).all() else 2
    distance = np.hypot(error[:, 0], error[:, 1])
    error, covariances = error[:, :known], track.covariances[steps, :known, :known]
    squared = np.einsum("ti,ti->t", error, np.linalg.solve(covariances, error[:, :, None])[:, :, 0])
    covered = np.mean(squared <= chi2.ppf(0.9, known))
    return np.sqrt(np.mean(distance**2)), np.median(distance), squared.mean() / known, covered


def _both(remark, recording, constants, **options):
    for name, step in FILTERS.items():
        yield Row(f"{name}, {remark}" if remark else name, recording, constants, partial(step, **options))


def _print(console, title, rows, runs):
    heads = ("RMSE / m", f"worst of {runs}", "median / m", "NEES / dim.", "in 90 %", "log-evidence")
    table = Table("", *(Column(head, justify="right") for head in heads), title=title)
    with ProcessPoolExecutor() as pool:
        measured = list(pool.map(_measure, [row for row in rows for _ in range(runs)], list(range(runs)) * len(rows)))
    for i, row in enumerate(rows):
        rmse, median, nees, coverage, log_evidence = np.array(measured[i * runs : (i + 1) * runs]).T
        table.add_row(
            row.name,
            f"{rmse.mean():.4f}",
            f"{rmse.max():.4f}",
            f"{median.mean():.3f}",
            f"{nees.mean():.2f}",
            f"{coverage.mean():.2f}",
            f"{log_evidence.mean():.0f}",
        )
    console.print(table)
    console.print()


def _measure(row, seed):
    track = localize(row.recording, row.constants, np.random.default_rng(seed), row.step)
    return *errors(track), track.log_evidence
