"""The class in a terminal."""

from rich import box
from rich.table import Table
from rich.text import Text

from grader.intake.names import one_line
from grader.reports.calibration import calibrations
from grader.reports.overview import (
    comparison,
    failures,
    figure,
    headline,
    insecure,
    isolations,
    measured,
    ratio,
    spread,
    standing,
    worst_variant,
)
from grader.result import COVERAGE

_MARKS = {"overconfident": "↓", "overcautious": "↑", "": ""}
_STYLES = {"refused": "red", "failing": "yellow", "ok": ""}
_LONGEST_NOTE = 160


def table(results):
    """One row per submission, in the order given.

    Parameters
    ----------
    results : list of Result
        Of one assignment.

    Returns
    -------
    rich.table.Table
        Points, their confidence interval and the episodes they rest on; the first criterion of the first variant
        and its ratio to the reference's, of the others the ratio; coverage; CPU time as a ratio; the variant that
        lost most; whether all went well. Below it, what went wrong.
    """
    first = headline(results)
    calibrated, timed = measured(results)
    criteria = first.criteria if first else []
    rows = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, caption_justify="left", caption_style="")
    rows.add_column("submission", overflow="fold", max_width=26)
    rows.add_column("\n".join(_points_title(results)), justify="right", no_wrap=True)
    rows.add_column("runs", justify="right", no_wrap=True)
    for i, criterion in enumerate(criteria):
        words = [*criterion.metric.split(), "and / ref." if i == 0 else "/ ref."]
        rows.add_column(Text("\n".join(words)), justify="right", no_wrap=True)
    if calibrated:
        rows.add_column("\n".join(COVERAGE.split(maxsplit=1)), justify="right", no_wrap=True)
    if timed:
        rows.add_column("CPU\n/ ref.", justify="right", no_wrap=True)
    if first:
        rows.add_column("lost most\nin", overflow="fold", min_width=13, max_width=13)
    rows.add_column("state", no_wrap=True)
    for result in results:
        cells = [one_line(result.submission), _points(result), str(result.episodes or "–")]
        if first:
            cells += _criteria(result, len(criteria))
            cells += [_coverage(result)] * calibrated
            cells += [ratio(result.speed.ratio if result.speed else None, 1.0)] * timed
            worst = worst_variant(result)
            cells.append(f"{worst.name} {worst.points - worst.max_points:+.1f}" if worst else "–")
        cells.append(_state(result))
        # Text, not str: names and messages may hold what rich takes for markup.
        rows.add_row(*map(Text, cells), style=_STYLES[standing(result)])
    notes = [
        f"{one_line(result.submission)}: {one_line(result.message, _LONGEST_NOTE)}"
        for result in results
        if result.message
    ]
    rows.caption = Text("\n".join(notes)) if notes else None
    return rows


def summary(results, landmarks):
    """The class in a few lines: how many, median and spread of the points, what others achieved, what could be trusted.

    Parameters
    ----------
    results : list of Result
    landmarks : dict
        The assignment's.

    Returns
    -------
    rich.text.Text
    """
    refused = sum(result.status == "refused" for result in results)
    words = [_count(len(results), "submission")]
    words += [f"{refused} refused"] if refused else []
    words += [f"{failing} with failures"] if (failing := sum(standing(r) == "failing" for r in results)) else []
    line = ", ".join(words)
    if points := spread(results):
        least, lower, median, upper, most = points
        line += (
            f"; of {results[0].max_points:g} points: median {median:.1f}, "
            f"middle half {lower:.1f} to {upper:.1f}, all {least:.1f} to {most:.1f}"
        )
        line += " (graded ones)" if refused else ""
    if others := comparison(landmarks):
        line += f"\nFor comparison: {others}"
    if any(_coverage(result)[-1:] in ("↓", "↑") for result in results):
        line += f"\n{COVERAGE}: ↓ overconfident, ↑ overcautious, beyond what luck and the reference would explain"
    text = Text(line)
    for isolation in isolations(results):
        text.append(f"\nIsolation: {isolation}", style="bold red" if insecure(isolation) else "")
    return text


def _points_title(results):
    """What the points are of, and how sure their interval is."""
    yield "points"
    if results:
        yield f"of {results[0].max_points:g}"
    if confidences := {result.confidence for result in results if result.interval}:
        yield f"({100 * min(confidences):g} % sure)"


def _points(result):
    return f"{result.points:.1f}" + (" ({:.0f}–{:.0f})".format(*result.interval) if result.interval else "")


def _criteria(result, width):
    """Cells of the first variant's criteria."""
    if not result.variants:
        return ["–"] * width
    first, *others = result.variants[0].criteria
    value = "–" if first.value is None else f"{figure(first.value)} {ratio(first.value, first.reference)}"
    return [value] + [ratio(c.value, c.reference) for c in others]


def _coverage(result):
    """How often the truth lay in the 90 % region, and a mark when that is no luck."""
    found = [c for c in calibrations(result.variants, result.dimension) if c.metric == COVERAGE]
    return f"{found[0].figure}{_MARKS[found[0].verdict]}" if found else "–"


def _state(result):
    """Whether everything went well, in words."""
    state = standing(result)
    if state == "failing":
        failed = len(failures(result))
        return f"{failed} failed" if failed else "not timed"
    return state


def _count(number, noun):
    return f"{number} {noun}" + ("" if number == 1 else "s")
