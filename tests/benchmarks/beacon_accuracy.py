"""The quadrotor's filters side by side: error, consistency, evidence, and what each of the source's shortcuts costs."""

import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from scipy.stats import chi2

from course_lib.angles import wrap
from course_lib.beacon import ekf, models, particle_filter
from course_lib.beacon.constants import ANGLES, YAW, Constants, Hidden, X, Y, Z
from course_lib.beacon.particle_filter import WeightRepairs, source_log_weight
from course_lib.beacon.world import World
from course_lib.filters import Gaussian, equally_weighted, extended_kalman, regularized

#: Errors are taken from this step on, when the start is forgotten.
SETTLED = 50
#: Particles.
COUNT = 5000
POSE = [X, Y, Z, YAW]
#: A run is lost when the position is ever this far off (m), or the filter's covariance is no longer one.
LOST = 5.0

OWN = ekf.Repairs(range_of_its_own=True)
PLAIN, WHOLE = WeightRepairs(own=True), WeightRepairs(own=True, scaled=True, half=True, once=True)

_UNSURE = replace(Constants(), start_sigma=(0.5, float(np.radians(2.0)), float(np.radians(15.0)), 0.3, 0.1))
#: No outages, so that the evidence of every filter is of the same readings.
WORLDS = {
    "the defaults, no outages": (Constants(), Hidden(outage=0.0)),
    "yaw known to 15° at the start": (_UNSURE, Hidden(outage=0.0)),
    "beacons 1 and 3 only": (Constants(), Hidden(outage=0.0, dead=(1, 3))),
    "beacon 1 only, for 2 s": (Constants(), Hidden(outage=0.0, dead=(1, 2, 3), steps=40)),
}
#: Where each shortcut is shown alone.
ONE_BY_ONE = ("the defaults, no outages", "beacon 1 only, for 2 s")


def kalman(step, run, constants, rng):
    """Yield (Gaussian, log_evidence, nis, rows) of each step."""
    gaussian = models.prior(constants)
    for observation, control in zip(run.observations, run.controls, strict=True):
        outcome = step(gaussian, observation, control, constants)
        gaussian = outcome.posterior
        yield outcome


def raw(run, constants, rng):
    return kalman(ekf.raw_step, run, constants, rng)


def source(repairs, run, constants, rng):
    return kalman(partial(ekf.source_step, repairs=repairs), run, constants, rng)


def particles(options, weight, run, constants, rng):
    """A particle filter; with `weight`, the source's, beside a Kalman filter with all repairs. It has no NIS."""
    cloud, gaussian = equally_weighted(models.sample_prior(COUNT, constants, rng)), models.prior(constants)
    mask = np.isin(range(12), ANGLES)
    for observation, control in zip(run.observations, run.controls, strict=True):
        log_weight = None
        if weight is not None:
            predicted = ekf.predict(gaussian, control, constants)
            gaussian = ekf.source_step(gaussian, observation, control, constants, ekf.ALL).posterior
            log_weight = partial(_weight, observation, predicted, constants, weight)
        cloud, log_evidence = particle_filter.step(
            cloud, observation, control, constants, rng, log_weight=log_weight, **options
        )
        moments = Gaussian(*regularized.moments(cloud.states, cloud.weights, mask))
        yield ekf.Outcome(moments, log_evidence if weight is None else np.nan, np.nan, 0)


def _weight(observation, gaussian, constants, repairs, states):
    return source_log_weight(observation, states, gaussian, constants, repairs)


def without(name):
    return partial(source, replace(ekf.ALL, **{name: False}))


#: Indented: one repair, or one repair undone.
KALMAN = {
    "(a) as written": partial(source, ekf.Repairs()),
    "(a) with ρ_xy,2": partial(source, OWN),
    "    + θ in H": partial(source, replace(OWN, yaw=True)),
    "    + σ_a in G": partial(source, replace(OWN, altitude=True)),
    "    + σ_a, shared": partial(source, replace(OWN, altitude=True, correlations=True)),
    "    + P' for P": partial(source, replace(OWN, predicted=True)),
    "    + gusts in Q": partial(source, replace(OWN, gusts=True)),
    "(a) all repaired": partial(source, ekf.ALL),
    "    but ρ_xy,1": without("range_of_its_own"),
    "    but no θ in H": without("yaw"),
    "    but no σ_a in G": without("altitude"),
    "    but σ_a unshared": without("correlations"),
    "    but P for P'": without("predicted"),
    "    but no gusts": without("gusts"),
    "(b) raw": raw,
}
#: Indented: one repair after the other.
PARTICLES = {
    "(c) source's weight": partial(particles, {"regularise": False, "gusts": False}, WeightRepairs()),
    "    + v of each": partial(particles, {"regularise": False, "gusts": False}, PLAIN),
    "    + gusts": partial(particles, {"regularise": False}, PLAIN),
    "(c) likelihood": partial(particles, {"regularise": False}, None),
    "(c) regularised, source": partial(particles, {}, WeightRepairs()),
    "    + each its own v": partial(particles, {}, PLAIN),
    "    + vᵀ Σ⁻¹ v": partial(particles, {}, replace(PLAIN, scaled=True)),
    "    + ½": partial(particles, {}, replace(PLAIN, scaled=True, half=True)),
    "    + Σ = G R Gᵀ": partial(particles, {}, WHOLE),
    "(c) regularised": partial(particles, {}, None),
}


class Row(NamedTuple):
    """One filter on one run, step by step, each of shape (T,); NaN from where the filter was lost."""

    position: np.ndarray
    yaw: np.ndarray
    nees: np.ndarray
    nees_pose: np.ndarray
    nis: np.ndarray
    rows: np.ndarray
    log_evidence: np.ndarray


def measure(filter_, constants, hidden, index):
    """Follow one run; squares of errors (m², rad²), NEES, NIS and log-evidence of each step."""
    run = World(constants, hidden).simulate(np.random.default_rng([1, index]))
    result = np.full((run.steps, len(Row._fields)), np.nan)
    with np.errstate(all="ignore"):
        try:
            steps = filter_(run, constants, np.random.default_rng([2, index]))
            for k, (gaussian, log_evidence, nis, rows) in enumerate(steps):
                error = run.truth[k + 1] - gaussian.mean
                error[list(ANGLES)] = wrap(error[list(ANGLES)])
                if not np.linalg.norm(error[:3]) < LOST:
                    break
                result[k] = (
                    error[:3] @ error[:3],
                    error[YAW] ** 2,
                    _square(error, gaussian.covariance),
                    _square(error[POSE], gaussian.covariance[np.ix_(POSE, POSE)]),
                    nis,
                    rows,
                    log_evidence,
                )
        except (np.linalg.LinAlgError, ValueError):
            pass
    return Row(*result.T)


def _square(error, covariance):
    # A cloud of copies has a covariance of lower rank: its square is as large as rounding lets it be.
    return error @ np.linalg.solve(covariance + 1e-12 * np.eye(len(error)), error)


def beacon(console: Console, runs):
    """Four worlds for the Kalman filters with and without the source's shortcuts; one for the particle filters."""
    _one_update(console, 10 * runs)
    for title, world in WORLDS.items():
        filters = KALMAN if title in ONE_BY_ONE else {name: KALMAN[name] for name in KALMAN if name[0] == "("}
        _table(console, f"{title}: Kalman filters, {runs} runs", filters, world, runs)
    fewer = max(runs // 10, 2)
    world = WORLDS["the defaults, no outages"]
    _table(
        console,
        f"the defaults: particle filters, {COUNT} particles, {fewer} runs",
        PARTICLES | {"(b) raw": raw},
        world,
        fewer,
    )


def _one_update(console, trials):
    """The sheet's case: one reading of one beacon 7 m away, position known to 0.3 m."""
    innovations = {
        "(a) with ρ_xy,2": partial(ekf.source_innovation, repairs=OWN),
        "    + θ in H": partial(ekf.source_innovation, repairs=replace(OWN, yaw=True)),
        "(a) all repaired": partial(ekf.source_innovation, repairs=ekf.ALL),
        "(b) raw": ekf.raw_innovation,
    }
    degrees, columns = (2.0, 5.0, 10.0, 15.0), [X, Y, YAW]
    table = Table("yaw known to", *(f"{each:g}°" for each in degrees), title=f"NEES of x, y, θ: {trials} updates")
    for name, innovation in innovations.items():
        cells = []
        for each in degrees:
            rng, total = np.random.default_rng(3), 0.0
            constants = replace(Constants(), start_sigma=(0.3, 1e-3, float(np.radians(each)), 1e-3, 1e-3))
            prior = models.prior(constants)
            for state in models.sample_prior(trials, constants, rng):
                z = np.full(11, np.inf)
                z[:9] = models.observe(state[None], constants)[0] + constants.sigma_z * rng.standard_normal(9)
                z[[1, 2, 3, 5, 6, 7]] = np.inf
                posterior, _ = extended_kalman.update(prior, *innovation(prior, z, constants)[:3], ANGLES)
                error = (state - posterior.mean)[columns]
                error[2] = wrap(error[2])
                total += _square(error, posterior.covariance[np.ix_(columns, columns)])
            cells.append(_number(total / trials))
        table.add_row(name, *cells)
    low, high = chi2.ppf([0.025, 0.975], 3 * trials) / trials
    console.print(table)
    console.print(f"3 when consistent; 95 % bounds {low:.2f} to {high:.2f}.\n")


def _table(console, title, filters, world, runs):
    names = list(filters)
    tasks = [(filters[name], *world, i) for name in names for i in range(runs)]
    measured = _measure_all(tasks, title)
    table = Table(
        "", "lost", "position", "yaw", "NEES", "inside", "pose", "inside", "NIS", "inside", "log p", title=title
    )
    for j, name in enumerate(names):
        table.add_row(name, *_summary(measured[j * runs : (j + 1) * runs]))
    console.print(table)
    lost = chi2.ppf([0.025, 0.975], 12 * runs) / runs, chi2.ppf([0.025, 0.975], 4 * runs) / runs
    console.print(
        f"RMSE in m and degrees, from step {SETTLED} on where there are more, over runs that are not lost (a position "
        f"{LOST:g} m off, or a covariance that is none). NEES of all 12 dimensions (95 % bounds of a step's mean over "
        f"{runs} runs: {lost[0][0]:.2f} to {lost[0][1]:.2f}) and of position and yaw ({lost[1][0]:.2f} to "
        f"{lost[1][1]:.2f}); NIS per row of the innovation (1); inside: share of steps whose mean over the runs lies "
        "in the bounds. log p: log-evidence of a step, in metres and radians.\n"
    )


def _summary(measured):
    kept = [row for row in measured if np.isfinite(row.position).all()]
    lost = f"{len(measured) - len(kept)}"
    if not kept:
        return (lost, *["-"] * 9)
    rows = Row(*np.stack([np.stack(row) for row in kept], axis=1))
    start = SETTLED if rows.position.shape[1] > SETTLED else 0
    late = Row(*(field[:, start:] for field in rows))
    n = len(kept)
    nis, degrees = late.nis.sum(axis=0), late.rows.sum(axis=0)
    has_nis = bool(degrees.all())
    return (
        lost,
        f"{np.sqrt(late.position.mean()):.4f}",
        f"{np.degrees(np.sqrt(late.yaw.mean())):.2f}",
        _number(late.nees.mean()),
        _inside(late.nees.sum(axis=0), 12 * n),
        _number(late.nees_pose.mean()),
        _inside(late.nees_pose.sum(axis=0), 4 * n),
        _number(nis.sum() / degrees.sum()) if has_nis else "",
        _inside(nis, degrees) if has_nis else "",
        f"{late.log_evidence.mean():.2f}" if np.isfinite(late.log_evidence).all() else "",
    )


def _inside(sums, degrees):
    low, high = chi2.ppf(0.025, degrees), chi2.ppf(0.975, degrees)
    return f"{100 * np.mean((low < sums) & (sums < high)):.0f} %"


def _number(value):
    return f"{value:.2f}" if value < 1e4 else f"{value:.0e}"


def _measure_all(tasks, title):
    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()]
    with Progress(*columns) as progress, ProcessPoolExecutor(os.cpu_count()) as pool:
        futures = [pool.submit(measure, *task) for task in tasks]
        bar = progress.add_task(title, total=len(futures))
        for _ in as_completed(futures):
            progress.advance(bar)
    return [future.result() for future in futures]
