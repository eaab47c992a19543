"""The class in a terminal."""

from rich import box
from rich.table import Table
from rich.text import Text

from grader.reports.overview import failures, figure, headline, ratio, spread, standing, worst_variant

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
        Points; the first criterion of the first variant beside the reference's, the others as ratios to it; the
        variant that lost most; CPU time as a ratio; what went wrong, in words.
    """
    first = headline(results)
    criteria = first.criteria if first else []
    notes = any(_note(result) for result in results)
    rows = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    rows.add_column("submission", overflow="fold", ratio=None, max_width=28)
    rows.add_column("points", justify="right", no_wrap=True)
    for i, criterion in enumerate(criteria):
        rows.add_column(Text(criterion.metric + ("\n(reference)" if i == 0 else "")), justify="right", no_wrap=True)
    if first:
        rows.add_column("lost most in", overflow="fold")
        rows.add_column("CPU", justify="right", no_wrap=True)
    if notes:
        rows.add_column("what went wrong", overflow="fold", min_width=20)
    for result in results:
        cells = [result.submission, f"{result.points:.1f} / {result.max_points:g}"]
        if first:
            cells += _criteria(result, len(criteria))
            worst = worst_variant(result)
            cells.append(f"{worst.name} {worst.points:.1f}/{worst.max_points:g}" if worst else "–")
            cells.append(ratio(result.speed.ratio, 1.0) if result.speed else "–")
        if notes:
            cells.append(_note(result))
        # Text, not str: names and messages may hold what rich takes for markup.
        rows.add_row(*map(Text, cells), style=_STYLES[standing(result)])
    return rows


def summary(results):
    """The class in one line: how many, median and spread of the points.

    Parameters
    ----------
    results : list of Result

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
    return Text(line)


def _criteria(result, width):
    """Cells of the first variant's criteria."""
    if not result.variants:
        return ["–"] * width
    first, *others = result.variants[0].criteria
    return [f"{figure(first.value)} ({figure(first.reference)})"] + [ratio(c.value, c.reference) for c in others]


def _note(result):
    note = result.message if len(result.message) <= _LONGEST_NOTE else result.message[: _LONGEST_NOTE - 1] + "…"
    if result.status == "refused":
        return f"refused: {note}"
    if note or standing(result) == "ok":
        return note
    return f"{_count(len(failures(result)), 'episode')} failed" if failures(result) else "not timed"


def _count(number, noun):
    return f"{number} {noun}" + ("" if number == 1 else "s")
