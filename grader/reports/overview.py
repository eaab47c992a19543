"""What every view of a class says of it: the few figures one looks at first."""

import statistics

from grader.result import COVERAGE


def headline(results):
    """The variant whose criteria stand for the whole: the assignment's first; None when everything was refused."""
    return next((result.variants[0] for result in results if result.variants), None)


def worst_variant(result):
    """The variant in which most points were lost, None when none were."""
    lossy = [variant for variant in result.variants if variant.points < variant.max_points - 1e-9]
    return max(lossy, key=lambda variant: variant.max_points - variant.points, default=None)


def measured(results):
    """Whether these tell of calibration, and of CPU time: of planners they do not."""
    episodes = [episode for result in results for variant in result.variants for episode in variant.episodes]
    calibrated = any(COVERAGE in episode.reference or COVERAGE in episode.values for episode in episodes)
    return calibrated, any(result.speed for result in results)


def failures(result):
    """Episodes that were not finished, as (variant, episode)."""
    return [(variant, episode) for variant in result.variants for episode in variant.episodes if episode.status != "ok"]


def standing(result):
    """One word for a result: "refused", "failing" when something did not finish, or "ok"."""
    if result.status == "refused":
        return "refused"
    # Without a time something failed, or time earns nothing here.
    timed = result.speed is None or result.speed.status == "ok"
    return "ok" if timed and not failures(result) else "failing"


def spread(results):
    """(least, lower quartile, median, upper quartile, most) of the graded points; None when nothing was graded."""
    points = sorted(result.points for result in results if result.status == "graded")
    if not points:
        return None
    quartiles = statistics.quantiles(points, n=4, method="inclusive") if len(points) > 1 else points * 3
    return points[0], *quartiles, points[-1]


def isolations(results):
    """Under what isolation programs were run: distinct descriptions, weakest tier first."""
    graded = [result.environment for result in results if result.status == "graded"]
    return sorted({environment["isolation"] for environment in graded if "isolation" in environment})


def common_environment(results):
    """What all records say of their environment beside the isolation; None when they differ."""
    known = [{key: value for key, value in result.environment.items() if key != "isolation"} for result in results]
    return known[0] if known and all(one == known[0] for one in known) else None


def insecure(isolation):
    """Whether this isolation is no security boundary at all."""
    return isolation.startswith("tier 0")


def comparison(landmarks):
    """What others achieved in the exercise as it is, in a line; empty when an assignment has no such figures."""
    return "; ".join(
        f"{metric} of {words} {value:g}" for metric, figures in landmarks.items() for value, words in figures
    )


def interval(result):
    """Between what numbers the points of infinitely many episodes lie, as `91.3–98.0`."""
    low, high = result.interval
    return f"{low:.1f}–{high:.1f}"


def figure(value):
    """A number with three significant digits; a dash for none."""
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 and abs(value) < 1e6 else f"{value:#.3g}"


def ratio(value, reference):
    """How many times the reference's, as `×1.23`; a dash for none."""
    return "–" if value is None or not reference else f"×{figure(value / reference)}"
