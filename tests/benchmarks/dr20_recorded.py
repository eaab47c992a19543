"""A recorded robot with a laser scanner: localized in a map of its own first laps, scored against SLAM's poses."""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Column, Table
from scipy.spatial import cKDTree

from course_lib.dr20.recorded import laser, scans
from course_lib.dr20.success import KEPT, NEAR_HEADING, NEAR_POSITION, errors
from course_lib.geometry.occupancy import FREE, UNKNOWN
from course_lib.recording import LaserRecording, RecordingError, read_carmen

#: Particles at the start; what they are drawn from is written where they are.
TRACKED, GLOBAL = 2000, 50_000
#: Scans that a global run is given, about 50 m: then it must have converged.
HORIZON = 100
#: Scans in a row that must be near for convergence.
HOLD = 5
ALL_BEAMS, DR20_BEAMS = np.arange(0, 180, 5), np.array([0, 45, 90, 135, 179])
#: Small enough to lose no run in lap 2 (first table), with some to spare.
TEMPERS = {len(ALL_BEAMS): 0.05, len(DR20_BEAMS): 0.2}
#: α_slow and α_fast where random particles are strewn.
ALPHAS = (0.05, 0.5)
CHOICES = {len(ALL_BEAMS): (1.0, 0.2, 0.1, 0.05), len(DR20_BEAMS): (1.0, 0.5, 0.2)}


class Part(NamedTuple):
    """Which scans make the map and which are localized in it."""

    recording: LaserRecording
    field: scans.ScanField
    odometry: laser.Odometry
    first: int
    stop: int


class Job(NamedTuple):
    """One run: in the test half or in lap 2, from a known pose or from anywhere."""

    tested: bool
    known: bool
    beams: int
    temper: float
    alphas: tuple | None
    seed: int


class Score(NamedTuple):
    """What became of one run: errors are those after convergence."""

    success: bool
    converged: float
    position: np.ndarray
    heading: np.ndarray


def dr20_recorded(console: Console, runs):
    """Tracking and global localization on the Intel Research Lab's log, with `runs` seeds each."""
    if not os.environ.get("COURSE_DATA"):
        console.print(
            "dr20-recorded: left out, for there is no recording: name the folder that holds intel with --data FOLDER "
            "or in COURSE_DATA"
        )
        return
    try:
        test = _part(True)
    except RecordingError as error:
        console.print(f"dr20-recorded: left out: {error}")
        return
    _print_facts(console, test)
    with ProcessPoolExecutor() as pool:
        rows = [
            (f"{beams} beams, power {temper:g}", (False, False, beams, temper, None), False)
            for beams, tempers in CHOICES.items()
            for temper in tempers
        ]
        title = f"Choice of power: lap 2 in the map of lap 1, from anywhere, {GLOBAL} particles"
        _print_scores(console, pool, title, rows, runs)
        for known, title in (
            (True, f"Test half, known start, {TRACKED} particles"),
            (False, f"Test half, from anywhere, {GLOBAL} particles, {HORIZON} scans"),
        ):
            rows = []
            for beams, temper in TEMPERS.items():
                told = (True, known, beams)
                rows += [
                    (f"{beams} beams, power {temper:g}", (*told, temper, None), False),
                    ("  mean, not circular", (*told, temper, None), True),
                    ("  as if independent", (*told, 1.0, None), False),
                ]
                if not known:
                    rows.append(("  random particles", (*told, temper, ALPHAS), False))
            _print_scores(console, pool, title, rows, runs)


@cache
def _part(tested):
    recording = read_carmen(Path(os.environ["COURSE_DATA"]) / "intel")
    lap = scans.laps(recording.corrected)
    first, stop = (int(np.sum(lap <= 2)), len(lap)) if tested else (int(np.sum(lap <= 1)), int(np.sum(lap <= 2)))
    grid = scans.build_map(recording.corrected[:first], recording.ranges[:first], recording.bearings)
    # The wheels' errors are those of laps 1 and 2 for both.
    known = int(np.sum(lap <= 2))
    odometry = laser.calibrate(recording.odometry[:known], recording.corrected[:known])
    return Part(recording, scans.likelihood_field(grid), odometry, first, stop)


def _print_facts(console, part):
    recording, first = part.recording, part.first
    corrected, grid = recording.corrected, part.field.grid
    gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corrected[:, :2], axis=0).T))])
    console.print(
        f"{recording.name}: {len(corrected)} scans over {gone[-1]:.0f} m; laps 1 and 2, {first} scans over "
        f"{gone[first - 1]:.0f} m, make the map and the numbers; {len(corrected) - first} are the test half."
    )
    console.print(f"wheels, fitted on laps 1 and 2: {part.odometry}")
    for name, begin, odometry in (
        ("whole log, as it is", 0, None),
        ("test half, as it is", first, None),
        ("test half, corrected by what laps 1 and 2 say", first, part.odometry),
    ):
        position, heading = errors(dead_reckoning(recording, begin, odometry), corrected[begin:])
        console.print(
            f"dead reckoning, {name}: {position[-1]:.0f} m and {np.degrees(heading[-1]):.0f}° off after "
            f"{gone[-1] - gone[begin]:.0f} m; median {np.median(position):.1f} m, {np.degrees(np.median(heading)):.0f}°"
        )
    points, _ = scans.ends(corrected[:first], recording.ranges[:first], recording.bearings)
    tested, _ = scans.ends(corrected[first:], recording.ranges[first:], recording.bearings)
    apart = cKDTree(points).query(tested)[0]
    seen = grid.look_up(grid.cells, tested, UNKNOWN) != UNKNOWN
    console.print(
        f"map consistency, from the ends of the test half's beams to the nearest end of laps 1 and 2: median "
        f"{100 * np.median(apart):.1f} cm, 90 % {100 * np.quantile(apart, 0.9):.0f} cm; of those in known land "
        f"({100 * seen.mean():.0f} %) {100 * np.median(apart[seen]):.1f} cm and "
        f"{100 * np.quantile(apart[seen], 0.9):.0f} cm"
    )
    off = grid.look_up(grid.cells, corrected[first:, :2], UNKNOWN) != FREE
    console.print(f"{100 * off.mean():.0f} % of the test half's scans are taken in rooms that the map does not know.\n")
    console.print(
        "Mean, not circular: of all particles, in place of the heaviest cluster's. Of known: success of the runs that "
        "begin where the map is known; scans: until convergence, median; errors: "
        "after it, of the runs that succeed; ms: processor time of one scan.\n"
    )


def dead_reckoning(recording, begin, odometry=None):
    """Poses from the true one at a scan on, by the wheels alone.

    Parameters
    ----------
    recording : LaserRecording
    begin : int
    odometry : Odometry, optional
        Corrects them.

    Returns
    -------
    ndarray, shape (M - begin, 3)
    """
    poses = [recording.corrected[begin : begin + 1]]
    for step in laser.increments(recording.odometry[begin:], odometry):
        poses.append(laser.move(poses[-1], step[None]))
    return np.concatenate(poses)


def _run(job):
    """The track of a run, its scans, and its processor time."""
    part, rng = _part(job.tested), np.random.default_rng(job.seed)
    if job.known:
        stretch = range(part.first, part.stop)
        start = part.recording.corrected[part.first] + rng.normal(0.0, (0.1, 0.1, 0.1), (TRACKED, 3))
    else:
        length = min(HORIZON, (part.stop - part.first) // 2)
        begin = int(rng.integers(part.first, part.stop - length + 1))
        stretch = range(begin, begin + length)
        start = scans.anywhere(GLOBAL, part.field.grid, rng)
    beams = {len(beams): beams for beams in (ALL_BEAMS, DR20_BEAMS)}[job.beams]
    begun = time.process_time()
    track = laser.localize(
        part.recording, stretch, part.field, part.odometry, start, rng, beams, job.temper, job.alphas
    )
    return track, stretch, time.process_time() - begun


def score(estimates, truth):
    """Success as for the simulated robot (`dr20.success`), with time in scans.

    Parameters
    ----------
    estimates, truth : ndarray, shape (T, 3)

    Returns
    -------
    Score
    """
    position, heading = errors(estimates, truth)
    near = (position <= NEAR_POSITION) & (heading <= NEAR_HEADING)
    held = np.flatnonzero(np.lib.stride_tricks.sliding_window_view(near, HOLD).all(axis=1))
    if not len(held):
        return Score(False, np.inf, position[:0], heading[:0])
    first = held[0]
    return Score(bool(near[-1] and near[first:].mean() >= KEPT), first, position[first:], heading[first:])


def _print_scores(console, pool, title, rows, runs):
    heads = ("success", "of known", "scans", "50 %, m", "90 %", "50 %, °", "90 %", "ms", "particles")
    table = Table("", *(Column(head, justify="right") for head in heads), title=title)
    jobs = [Job(*what, seed) for what in dict.fromkeys(what for _, what, _ in rows) for seed in range(runs)]
    results = dict(zip(jobs, pool.map(_run, jobs), strict=True))
    for name, what, arithmetic in rows:
        mine = [results[Job(*what, seed)] for seed in range(runs)]
        part = _part(what[0])
        truth, grid = part.recording.corrected, part.field.grid
        inside = [grid.look_up(grid.cells, truth[stretch.start, :2], UNKNOWN) == FREE for _, stretch, _ in mine]
        scores = [
            score(track.means if arithmetic else track.estimates, truth[stretch.start : stretch.stop])
            for track, stretch, _ in mine
        ]
        of_known = [each.success for each, known in zip(scores, inside, strict=True) if known]
        good = [each for each in scores if each.success] or scores
        position = np.concatenate([each.position for each in good])
        heading = np.degrees(np.concatenate([each.heading for each in good]))
        quantiles = [
            f"{np.quantile(values, share):.{places}f}" if len(values) else "-"
            for values, places in ((position, 3), (heading, 2))
            for share in (0.5, 0.9)
        ]
        milliseconds = 1e3 * sum(spent for _, _, spent in mine) / sum(len(stretch) for _, stretch, _ in mine)
        table.add_row(
            name,
            f"{100 * np.mean([each.success for each in scores]):.0f} %",
            f"{100 * np.mean(of_known or [np.nan]):.0f} %",
            f"{np.median([each.converged for each in scores]):.0f}",
            *quantiles,
            f"{milliseconds:.2f}",
            f"{np.mean(np.concatenate([track.counts for track, _, _ in mine])):.0f}",
        )
    console.print(table)
    console.print()
