"""The class in one HTML file that needs nothing else: no network, no other file."""

import base64
import hashlib
import os
import tempfile
from pathlib import Path

import jinja2
import numpy as np

from grader.reports import overview
from grader.reports.calibration import FALSE_ALARM, calibrations
from grader.result import COVERAGE, NEES

#: Bars of the histogram.
BINS = 10
# Farther out than any room, so that a diverging cloud cannot overflow a picture's arithmetic.
_FAR = 1e6


def write(results, path, title, when, landmarks):
    """Write the report, whole or not at all.

    Parameters
    ----------
    results : list of Result
        Of one assignment, in the order in which they are to be shown.
    path : str or Path
    title : str
        The assignment's.
    when : str
        The date the report bears.
    landmarks : dict
        The assignment's, shown for comparison.

    Raises
    ------
    OSError
        The file cannot be written; an older report is left as it was.
    """
    path = Path(path)
    text = render(results, title, when, landmarks)
    handle, partial = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".partial")
    try:
        # A name of a file may hold what is no character.
        with open(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
        # A temporary file is its owner's alone; a report is as readable as any new file.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(partial, 0o666 & ~mask)
        os.replace(partial, path)
    except BaseException:
        os.unlink(partial)
        raise


def render(results, title, when, landmarks):
    """The report's text; parameters as in `write`."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("grader.reports", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"average": np.mean, "figure": overview.figure, "fingerprint": _fingerprint, "zip": zip}
    environment.globals |= {
        "calibrations": calibrations,
        "ending": ending,
        "extent": extent,
        "episode_ratios": episode_ratios,
        "failure_lines": failure_lines,
        "failures": overview.failures,
        "insecure": overview.insecure,
        "interval": overview.interval,
        "others": other_metrics,
        "ratio": overview.ratio,
        "scale": scale,
        "start_frame": start_frame,
        "standing": overview.standing,
        "worst_variant": overview.worst_variant,
        "curves": curves,
        "pack": pack,
    }
    calibrated, timed = overview.measured(results)
    return environment.get_template("report.html").render(
        results=results,
        title=title,
        when=when,
        comparison=overview.comparison(landmarks),
        first=overview.headline(results),
        spread=overview.spread(results),
        bins=histogram(results),
        environment=overview.common_environment(results) or {},
        isolations=overview.isolations(results),
        calibrated=calibrated,
        timed=timed,
        coverage=COVERAGE,
        false_alarm=FALSE_ALARM,
    )


def histogram(results):
    """How many results lie in each of `BINS` equal intervals of the points: a list of (graded, refused)."""
    bins = [[0, 0] for _ in range(BINS)]
    for result in results:
        share = result.points / result.max_points if result.max_points else 0.0
        bins[min(int(share * BINS), BINS - 1)][result.status == "refused"] += 1
    return bins


def scale(full, none, ratios, width):
    """Where marks lie on a scale of ratios to the reference that shows both thresholds.

    Parameters
    ----------
    full, none : float
        As in `grader.assignment.Criterion`.
    ratios : list of float
    width : float
        Of the scale; marks beyond its ends are drawn at them.

    Returns
    -------
    dict of str to float or list of float
        Positions of the "reference", of "full" and "none", and of the "marks".
    """
    span = none - full
    low, high = max(0.0, min(1.0, full) - 0.5 * span), none + 0.35 * span

    def position(value):
        return round(width * min(max((value - low) / (high - low), 0.0), 1.0), 1)

    return {
        "reference": position(1.0),
        "full": position(full),
        "none": position(none),
        "marks": [position(value) for value in ratios],
    }


def episode_ratios(variant, metric):
    """The metric's ratios to the reference's, of the episodes that finished."""
    finished = [episode for episode in variant.episodes if metric in episode.values]
    return [episode.values[metric] / episode.reference[metric] for episode in finished if episode.reference[metric]]


def failure_lines(variant):
    """(status, message, "episodes 0, 2") for each way in which episodes of a variant failed."""
    groups = {}
    for episode in variant.episodes:
        if episode.status != "ok":
            groups.setdefault((episode.status, episode.message), []).append(str(episode.index))
    return [
        (status, message, ("episode " if len(indices) == 1 else "episodes ") + ", ".join(indices))
        for (status, message), indices in groups.items()
    ]


def start_frame(trace):
    """Index of the frame to show first: where the error was largest, or where a planner's way ended."""
    if not trace.frames[0]["particles"]:
        return len(trace.error) - 1
    return max(range(len(trace.frames)), key=lambda i: trace.error[trace.frames[i]["step"]])


def ending(result, trace):
    """The line that says how the drawn episode failed, if it did: a list of one, or of none."""
    drawn = [variant for variant in result.variants if variant.name == trace.variant]
    episodes = [episode for variant in drawn for episode in variant.episodes if episode.index == trace.episode]
    return [episode.message for episode in episodes if episode.message]


def extent(room):
    """Sides of a room."""
    x0, y0, x1, y1 = room
    return x1 - x0, y1 - y0


def other_metrics(variant):
    """What was measured beside criteria and calibration: (metric, mean of finished episodes or None, reference's)."""
    graded = {COVERAGE, NEES, *(criterion.metric for criterion in variant.criteria)}
    names = dict.fromkeys(name for episode in variant.episodes for name in episode.reference if name not in graded)
    rows = []
    for name in names:
        values = [episode.values[name] for episode in variant.episodes if name in episode.values]
        reference = [episode.reference[name] for episode in variant.episodes]
        rows.append((name, float(np.mean(values)) if values else None, float(np.mean(reference))))
    return rows


def curves(trace, width, height):
    """Errors over time as SVG paths in a box whose origin is at its top left.

    Returns
    -------
    dict
        "error" and "reference" paths, "top" the value at the box's upper edge, "clipped" whether errors go beyond it.
    """
    steps = max(len(trace.reference_error) - 1, len(trace.error) - 1, 1)
    highest, reference = max(trace.error, default=0.0), max(trace.reference_error, default=1.0)
    # A lost filter must not flatten the reference to a line.
    top = _round_up(min(max(highest, reference), 12.0 * reference))

    def path(values):
        points = [f"{width * k / steps:.1f},{height * (1.0 - min(v / top, 1.0)):.1f}" for k, v in enumerate(values)]
        return "M" + "L".join(points) if points else ""

    return {
        "error": path(trace.error),
        "reference": path(trace.reference_error),
        "top": top,
        "clipped": highest > top,
        "steps": steps,
    }


def pack(trace):
    """What the page's script draws of a trace, small: a class of 300 is to fit a browser.

    Returns
    -------
    dict
        Each cloud is [base64 of one byte per coordinate, x and y in turn; its x and y range, to which the bytes refer].
    """
    return {
        "room": trace.picture["room"],
        "sensors": trace.picture["sensors"],
        "obstacles": trace.picture.get("obstacles", []),
        "rings": trace.picture.get("rings", []),
        "goal": trace.picture.get("goal"),
        "truth": trace.truth,
        "error": trace.error,
        "reference": trace.reference_error,
        "frames": [[frame["step"], [_pack_cloud(cloud) for cloud in frame["particles"]]] for frame in trace.frames],
    }


def _pack_cloud(cloud):
    points = np.clip(np.asarray(cloud, dtype=float).reshape(-1, 2), -_FAR, _FAR)
    if not len(points):
        return ["", [0.0, 0.0, 0.0, 0.0]]
    low, high = points.min(axis=0), points.max(axis=0)
    levels = np.round(255.0 * (points - low) / np.maximum(high - low, 1e-9)).astype(np.uint8)
    return [base64.b64encode(levels.tobytes()).decode(), np.column_stack([low, high]).ravel().round(3).tolist()]


def _round_up(value):
    """The next of 1, 2, 4, 6, 8 or 10 times a power of ten: half of it is a round number too."""
    if not value > 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 4.0, 6.0, 8.0, 10.0) if step * power >= value * 0.9999))


def _fingerprint(script):
    """What a content security policy calls a script, so that no other one can run in the report."""
    return "sha256-" + base64.b64encode(hashlib.sha256(str(script).encode()).digest()).decode()
