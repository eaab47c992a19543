"""Every command an instructor types."""

import sys
import tempfile
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from grader import doctor as examination
from grader.assignment import PUBLIC_SECRET
from grader.assignments import assignments, load
from grader.grading.executors import local_pool
from grader.grading.grade import WIDTH, most_episodes, refused
from grader.grading.secret import SecretError, fingerprint, new_secret, read_secret
from grader.intake import collect
from grader.intake.names import file_name
from grader.reports import html, terminal
from grader.sandbox import isolation
from grader.sandbox.program import SandboxError, StudentError

app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)
secrets = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)
app.add_typer(secrets, name="secret", help="Make and name the file that chooses hidden episodes.")
# Piped into a file, there is no width to ask for.
console = Console(width=None if sys.stdout.isatty() else 120, emoji=False)
errors = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)

#: Of a progress bar.
COLUMNS = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
#: Exit codes: all submissions graded; some refused; nothing done.
SOME_REFUSED, NOTHING_DONE = 1, 2


@app.callback()
def _commands():
    """Grade a class's programs, and make the course's notebooks."""


@app.command()
def grade(
    submissions: Annotated[list[Path], typer.Argument(help="Files (.py, .ipynb), zips or folders of them.")],
    assignment: Annotated[
        str | None,
        typer.Option("--assignment", "-a", help="Which assignment they answer; `grader assignments` lists them."),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for report.html and results/.")] = Path(
        "grades"
    ),
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Processes; by default one per core.")] = None,
    secret: Annotated[
        Path | None,
        typer.Option(
            help="File that chooses the episodes (made by `grader secret new`); without it anyone can repeat them."
        ),
    ] = None,
    width: Annotated[
        float, typer.Option(help="Points: episodes end when the interval of the points for errors is narrower.")
    ] = WIDTH,
    max_episodes: Annotated[
        int | None,
        typer.Option(help="Episodes end after this many anyway; by default after two of the assignment's rounds."),
    ] = None,
    allow_unsandboxed: Annotated[
        bool,
        typer.Option(
            "--allow-unsandboxed", help="Grade even where nothing can shut submissions in: people you know only."
        ),
    ] = False,
):
    """Grade submissions: print the table, write one JSON record each and an HTML report."""
    chosen = _choose(assignment)
    key = _secret(secret)
    cap = _cap(chosen, width, max_episodes)
    tier = _tier(allow_unsandboxed)
    try:
        programs, refusals = collect.gather(submissions, chosen)
    except RuntimeError as error:
        _stop(str(error))
    for refusal in refusals:
        errors.print(f"{refusal.path}: {refusal.reason}", style="red", markup=False)
    if not programs:
        raise typer.Exit(NOTHING_DONE)
    _writable(output)
    results = [refused(refusal, chosen, key) for refusal in refusals]
    for result in results:
        _store(result, output)
    results += _run(programs, chosen, key, jobs, tier, width, cap, output)
    results.sort(key=lambda result: (-result.points, result.submission))
    console.print(terminal.table(results))
    console.print(terminal.summary(results, chosen.landmarks))
    with _storing(output):
        html.write(results, output / "report.html", chosen.title, date.today().isoformat(), chosen.landmarks)
    console.print(f"Report: {output / 'report.html'}", soft_wrap=True, markup=False)
    if any(result.status == "refused" for result in results):
        raise typer.Exit(SOME_REFUSED)


@app.command("assignments")
def list_assignments():
    """List the assignments there are, and what each asks for."""
    found, broken = load()
    for name, assignment in sorted(found.items()):
        asked = f"def {assignment.entry_point}({', '.join(assignment.parameters)})"
        worth = f"{len(assignment.variants)} variants, {assignment.points:g} points"
        lines = f"{name}\n    {assignment.title}\n    {asked}\n    {worth}"
        console.print(lines, markup=False, highlight=False, soft_wrap=True)
    _warn(broken)


@secrets.command("new")
def secret_new(
    file: Annotated[Path, typer.Argument(help="A file that does not exist yet, outside of anything students see.")],
):
    """Write a new random secret to FILE and print its fingerprint."""
    try:
        key = new_secret(file)
    except SecretError as error:
        _stop(str(error))
    console.print(f"Written: {file}, fingerprint {fingerprint(key)}", soft_wrap=True, markup=False, highlight=False)
    console.print(
        f"Keep it, and keep it from students: grade with --secret {file}; without it no grade can be repeated.",
        soft_wrap=True,
        markup=False,
        highlight=False,
    )


@secrets.command("show")
def secret_show(file: Annotated[Path, typer.Argument(help="The file of a secret.")]):
    """Print the fingerprint of the secret in FILE, as records and reports name it."""
    try:
        console.print(fingerprint(read_secret(file)), markup=False, highlight=False)
    except SecretError as error:
        _stop(str(error))


@app.command()
def release(
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit 1 when a product is stale.")] = False,
):
    """Make both notebooks of each lesson from its source in solutions/."""
    # Only here: it imports the notebook tools, which grading does not need.
    from grader.lessons import release as products

    root = Path.cwd()
    if not (root / "solutions").is_dir():
        _stop(f"no folder solutions/ in {root}: run this at the top of the course")
    try:
        if check:
            stale = products.stale(root)
            for line in stale:
                errors.print(line, style="red", markup=False)
            raise typer.Exit(1 if stale else 0)
        with Progress(*COLUMNS, console=console) as progress:
            task = progress.add_task("reading the lessons", total=None)
            written = products.release(
                root,
                progress=lambda name, cell, cells: progress.update(
                    task, description=f"executing {name}", completed=cell - 1, total=cells
                ),
            )
            progress.update(task, completed=progress.tasks[task].total)
    except (OSError, products.ReleaseError) as error:
        _stop(str(error))
    for path in written:
        console.print(f"Written: {path.relative_to(root)}", markup=False)


@app.command()
def doctor():
    """Say how well this machine can shut submissions in, why not better, and how steadily it measures time."""
    sound = True
    for tier in isolation.probe():
        mark, style = ("yes", "green") if tier.available else ("no", "yellow")
        console.print(f"tier {tier.number}  {mark:3}  {tier.title}", style=style, highlight=False, soft_wrap=True)
        if not tier.available:
            console.print(f"{'':13}why not: {tier.reason}\n{'':13}remedy: {tier.remedy}", markup=False, soft_wrap=True)
    used = isolation.strongest()
    advice = "" if used else "; it refuses to, but with --allow-unsandboxed"
    console.print(f"\n`grader grade` uses tier {used}{advice}.\n", highlight=False)
    for name, value in examination.facts().items():
        console.print(f"{name}: {value}", highlight=False, markup=False, soft_wrap=True)
    timed = next(assignment for assignment in assignments().values() if assignment.speed).under(PUBLIC_SECRET)
    with Progress(*COLUMNS, console=console, transient=True) as progress:
        tiers = [tier.number for tier in isolation.probe() if tier.available and tier.number > 0]
        task = progress.add_task("trying to break out", total=len(tiers) + 1)
        lines = []
        try:
            for tier in tiers:
                escapes = examination.attempt(tier, timed)
                tried = sum(least <= tier for least in examination.ATTEMPTS.values())
                sound = sound and not escapes
                found = f"SUCCEEDED: {', '.join(escapes)}" if escapes else f"all {tried} attempts to break out failed"
                lines.append(f"tier {tier}: {found}")
                progress.advance(task)
            progress.update(task, description="timing the reference")
            ratios = examination.time_reference(timed, used)
        except (SandboxError, StudentError) as error:
            _stop(f"a tier that seemed available does not work: {error}")
    console.print("\n" + "\n".join(lines), highlight=False, markup=False)
    shown = ", ".join(f"{ratio:.3f}" for ratio in ratios)
    console.print(f"\nCPU time of the reference to itself, in pairs of fresh processes: {shown}", highlight=False)
    if not sound:
        raise typer.Exit(1)


def main():
    """The `grader` command."""
    try:
        app()
    except KeyboardInterrupt:
        errors.print("stopped; what was graded is kept", style="red")
        sys.exit(130)


def _run(programs, assignment, secret, jobs, tier, width, cap, output):
    """Grade with progress bars, storing each result as soon as it is there."""
    results = []
    try:
        with (
            Progress(*COLUMNS, TimeRemainingColumn(), console=console) as progress,
            local_pool(assignment, secret, jobs, tier) as pool,
        ):
            references = pool.references(
                cap, lambda episodes: progress.track(episodes, cap, description="reference's episodes")
            )
            graded = pool.grade(programs, references, width)
            for submission, result in progress.track(graded, len(programs), description="submissions         "):
                _store(result, output)
                results.append(result)
                if not console.is_terminal:
                    console.print(f"{submission.name}: {result.points:.1f} of {result.max_points:g}", markup=False)
    except (SandboxError, RuntimeError, BrokenProcessPool) as error:
        _stop(f"grading stopped after {len(results)} of {len(programs)} submissions, whose results are kept: {error}")
    return results


def _cap(assignment, width, episodes):
    """The cap, of options that make sense."""
    if not width > 0.0:
        _stop(f"--width {width:g}: an interval is wider than 0 points")
    if episodes is None:
        return most_episodes(assignment)
    if episodes < len(assignment.variants):
        _stop(
            f"--max-episodes {episodes}: {assignment.name} has {len(assignment.variants)} variants, "
            "each of which needs an episode"
        )
    return episodes


def _choose(name):
    available, broken = load()
    _warn(broken)
    if name is None and len(available) == 1 and not broken:
        return next(iter(available.values()))
    if name not in available:
        problem = "which assignment?" if name is None else f"there is no assignment {name}:"
        choice = ", ".join(f"{each} ({available[each].title})" for each in sorted(available))
        _stop(f"{problem} --assignment is one of {choice}")
    return available[name]


def _warn(lines):
    for line in lines:
        errors.print(line, style="yellow", markup=False)


def _tier(allow_unsandboxed):
    """The strongest tier of isolation; without any, grading has to be allowed."""
    tier = isolation.strongest()
    if tier == 0 and not allow_unsandboxed:
        first = isolation.probe()[1]
        _stop(
            f"nothing here can shut submissions in ({first.reason}): `grader doctor` says more. "
            "To grade people you know all the same: --allow-unsandboxed"
        )
    return tier


def _secret(path):
    try:
        return PUBLIC_SECRET if path is None else read_secret(path)
    except SecretError as error:
        _stop(str(error))


def _writable(output):
    """Find out before grading, not after, that results have nowhere to go."""
    with _storing(output):
        (output / "results").mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=output / "results"):
            pass


def _store(result, output):
    path = output / "results" / f"{file_name(result.submission)}.json"
    partial = path.with_suffix(".partial")
    with _storing(output):
        # Half a surrogate pair, from a name that was no text, is written as JSON escapes it.
        partial.write_text(result.to_json(), encoding="utf-8", errors="backslashreplace")
        partial.replace(path)


@contextmanager
def _storing(output):
    try:
        yield
    except OSError as error:
        _stop(f"cannot write to {output}: {error.strerror or error}; name another folder with --output")


def _stop(line):
    errors.print(line, style="red", markup=False)
    raise typer.Exit(NOTHING_DONE)
