"""Pictures of the quadrotor among its beacons. Metres and seconds. The truth is black, what is estimated has colour."""

import sys

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Rectangle
from scipy.stats import chi2

from course_lib.beacon.constants import ALTITUDE, ATTITUDE, BEARINGS, RANGES, YAW, Constants
from course_lib.filters import Gaussian, Particles
from course_lib.plotting import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILLION,
    animation,
    representatives,
    save_animation,
    subplots,
)
from course_lib.recording import replay

#: One for each beacon: range and bearing of a beacon have its colour, and its number stands beside it.
BEACON_COLOURS = (BLUE, ORANGE, GREEN, VERMILLION)
#: Columns of the horizontal and of the vertical coordinate of a view, and their names.
ABOVE, SIDE = (0, 1), (0, 2)
#: What of a Gaussian its ellipse holds.
INSIDE = 0.95


def views(constants, figsize=(5.4, 7.0)):
    """A figure with the room from above and, below it, from the side, on a common x axis.

    Parameters
    ----------
    constants : Constants
    figsize : tuple of float

    Returns
    -------
    figure : matplotlib.figure.Figure
    axes : ndarray of matplotlib.axes.Axes, shape (2,)
        Above, side.
    """
    figure, axes = subplots(
        2, 1, figsize=figsize, sharex=True, height_ratios=[1.1 * constants.R, constants.h + 0.1 * constants.R]
    )
    for panel, view in zip(axes, (ABOVE, SIDE), strict=True):
        room(panel, constants, view)
        panel.label_outer()
    return figure, axes


def room(axes, constants, view=ABOVE):
    """Draw the walls and the beacons, and the boxes where `constants` has any.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    constants : Constants or Scene
    view : tuple of int
        `ABOVE` or `SIDE`.
    """
    half, height = constants.R / 2, constants.h
    low, high = ((-half, half), (-half, half)) if view == ABOVE else ((-half, half), (0.0, height))
    axes.grid(False)
    axes.add_patch(Rectangle((low[0], high[0]), constants.R, high[1] - high[0], fill=False, edgecolor=BLACK, lw=1.5))
    for i, beacon in enumerate(constants.beacons):
        # From the side beacons 3 and 4 stand before 2 and 1.
        if view == SIDE and i > 1:
            continue
        x, y = beacon[list(view)]
        axes.plot(x, y, "s", color=BEACON_COLOURS[i], markersize=8, zorder=4, clip_on=False)
        name = f"{i + 1}" if view == ABOVE else ("1, 4", "2, 3")[i]
        shift = -11 * np.sign([x, y]) if view == ABOVE else (-14 * np.sign(x), 9)
        axes.annotate(name, (x, y), xytext=shift, textcoords="offset points", ha="center", va="center", zorder=4)
    boxes(axes, getattr(constants, "obstacles", ()), view)
    margin = 0.05 * constants.R
    axes.set(
        xlim=(low[0] - margin, low[1] + margin),
        ylim=(high[0] - margin, high[1] + margin),
        aspect="equal",
        xlabel="x in m",
        ylabel=f"{'xyz'[view[1]]} in m",
    )


def boxes(axes, obstacles, view=ABOVE):
    """Draw boxes (x₀, y₀, z₀, x₁, y₁, z₁).

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    obstacles : iterable of six float each
    view : tuple of int
    """
    for box in obstacles:
        low, high = np.array(box[:3])[list(view)], np.array(box[3:])[list(view)]
        style = {"facecolor": "#bbbbbb", "edgecolor": BLACK, "linewidth": 0.8, "hatch": "///", "alpha": 0.6}
        axes.add_patch(Rectangle(low, *(high - low), **style))


def way(axes, states, view=ABOVE, color=BLACK, label=None, style="-"):
    """Draw the way of states (T, 12), or of positions (T, 3).

    Returns
    -------
    matplotlib.lines.Line2D
    """
    return axes.plot(*states[:, view].T, style, color=color, linewidth=1.4, label=label)[0]


def vehicle(axes, state, view=ABOVE, color=BLACK, size=0.35):
    """Draw a vehicle: from above an arrow head along its yaw, from the side a bar along its pitch.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    state : ndarray, shape (12,)
    view : tuple of int
    color : str
    size : float
        In metres.

    Returns
    -------
    matplotlib.lines.Line2D
    """
    line = axes.plot([], [], color=color, linewidth=2.2, zorder=5)[0]
    _pose(line, state, view, size)
    return line


def readings(axes, state, observation, constants):
    """Draw, from above, what the four beacons say: an arc of the range around each, a ray of the bearing to each.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    state : ndarray, shape (12,)
        Where rays begin, and the yaw that bearings count from.
    observation : ndarray, shape (11,)
        What is missing is not drawn.
    constants : Constants

    Returns
    -------
    list of matplotlib.lines.Line2D
        Four arcs, four rays.
    """
    arcs = [axes.plot([], [], "--", color=colour, linewidth=1.3)[0] for colour in BEACON_COLOURS]
    rays = [axes.plot([], [], ":", color=colour, linewidth=1.3)[0] for colour in BEACON_COLOURS]
    _show_readings(arcs + rays, state, observation, constants)
    return arcs + rays


def ellipse(axes, gaussian, view=ABOVE, color=PURPLE, label=None, style="-"):
    """Draw the ellipse that holds 95 % of a Gaussian's position.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    gaussian : Gaussian
        Of states, or of positions.
    view : tuple of int
    color, label, style : str

    Returns
    -------
    matplotlib.lines.Line2D
    """
    return axes.plot(*_outline(gaussian, view), style, color=color, linewidth=1.6, label=label, zorder=3)[0]


def cloud(axes, particles, view=ABOVE, color=SKY_BLUE, size=400, label=None):
    """Draw particles, each in proportion to its weight.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    particles : Particles
    view : tuple of int
    color : str
    size : int
        How many are drawn.
    label : str, optional

    Returns
    -------
    matplotlib.lines.Line2D
    """
    x, y = representatives(particles, size)[:, view].T
    return axes.plot(x, y, "o", color=color, markersize=2.5, alpha=0.5, markeredgewidth=0, label=label)[0]


def over_time(axes, series, Ts, ylabel, log=False):
    """Draw numbers over time.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    series : dict of str to ndarray, shape (T,)
        Name to numbers at times Ts, 2 Ts, ..., T Ts.
    Ts : float
        In seconds.
    ylabel : str
    log : bool
        A logarithmic scale.
    """
    for (name, values), style in zip(series.items(), ["-", "--", "-.", ":"], strict=False):
        axes.plot((1 + np.arange(len(values))) * Ts, values, style, linewidth=1.3, label=name)
    axes.set(xlabel="time in s", ylabel=ylabel)
    if log:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, None)
    axes.legend(fontsize=9)


def consistency(axes, series, degrees, runs, Ts, ylabel="mean NEES"):
    """Draw normalised errors squared, averaged over runs, with the bounds that the average has in 95 % of cases.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    series : dict of str to ndarray, shape (T,)
        Averages at times Ts, 2 Ts, ..., T Ts.
    degrees : int
        Of freedom, of one run.
    runs : int
        That were averaged.
    Ts : float
    ylabel : str
    """
    low, high = bounds(degrees, runs)
    axes.axhspan(low, high, color="#dddddd", zorder=0, label="where 95 % should be")
    over_time(axes, series, Ts, ylabel, log=True)


def bounds(degrees, runs):
    """Between which 95 % of averages lie, of `runs` chi-square numbers with so many degrees of freedom each."""
    return chi2.ppf([0.025, 0.975], degrees * runs) / runs


def tree(axes, edges, view=ABOVE, color=SKY_BLUE):
    """Draw the edges of a tree of motions.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    edges : iterable of ndarray, shape (m, 12) or (m, 3)
        The ways of the edges.
    view : tuple of int
    color : str
    """
    lines = [np.asarray(edge)[:, view] for edge in edges]
    axes.add_collection(LineCollection(lines, colors=color, linewidths=0.7, zorder=2))


def goal(axes, centre, radius, view=ABOVE):
    """Draw the ball that is to be reached."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    x, y = np.asarray(centre)[list(view)]
    axes.plot(x + radius * np.cos(angle), y + radius * np.sin(angle), color=GREEN, linewidth=2)
    axes.plot(x, y, "*", color=GREEN, markersize=9)


def animate_run(run, constants, alt, posteriors=None, every=4, trail=40, size=200):
    """Animate a flight: the vehicle from above and from the side, its readings, and what a filter makes of them.

    Parameters
    ----------
    run : Run
    constants : Constants
    alt : str
        Description for those who do not see it.
    posteriors : sequence of Gaussian or Particles, optional
        At times 0, 1, ..., T; without them only what happens is shown.
    every : int
        Steps from frame to frame.
    trail : int
        Steps of the way behind the vehicle.
    size : int
        How many particles are drawn.

    Returns
    -------
    IPython.display.HTML
    """
    picture, axes = views(constants, figsize=(4.8, 6.4))
    both = list(zip(axes, (ABOVE, SIDE), strict=True))
    ways = [way(panel, run.truth[:1], view) for panel, view in both]
    vehicles = [vehicle(panel, run.truth[0], view) for panel, view in both]
    lines = readings(axes[0], run.truth[0], np.full(9, np.inf), constants)
    known = []
    if posteriors is not None:
        drawn = ellipse if isinstance(posteriors[0], Gaussian) else cloud
        known = [drawn(panel, posteriors[0], view) for panel, view in both]

    def draw(k):
        past = run.truth[max(0, k - trail) : k + 1]
        for line, body, (_, view) in zip(ways, vehicles, both, strict=True):
            line.set_data(*past[:, view].T)
            _pose(body, run.truth[k], view, 0.35)
        if k:
            _show_readings(lines, run.truth[k], run.observations[k - 1], constants)
        for line, (_, view) in zip(known, both, strict=False):
            posterior = posteriors[k]
            if isinstance(posterior, Particles):
                line.set_data(*representatives(posterior, size)[:, view].T)
            else:
                line.set_data(*_outline(posterior, view))
        axes[0].set_title(f"{k * constants.Ts:4.1f} s")

    return animation(picture, draw, range(0, run.steps + 1, every), alt)


def animate_flight(scene, states, centre, radius, alt, plan=None, beliefs=None, every=2):
    """Animate a flight through boxes to a goal.

    Parameters
    ----------
    scene : Scene
        Constants with `obstacles`.
    states : ndarray, shape (T + 1, 12)
        As flown.
    centre, radius
        As in `goal`.
    alt : str
    plan : ndarray, shape (m, 12) or (m, 3), optional
        The way that was meant.
    beliefs : sequence of Gaussian, optional
        At times 0, 1, ..., T.
    every : int
        Steps from frame to frame.

    Returns
    -------
    IPython.display.HTML
    """
    picture, axes = views(scene, figsize=(4.8, 6.4))
    both = list(zip(axes, (ABOVE, SIDE), strict=True))
    for panel, view in both:
        goal(panel, centre, radius, view)
        if plan is not None:
            way(panel, plan, view, BLUE, style="--")
    ways = [way(panel, states[:1], view) for panel, view in both]
    vehicles = [vehicle(panel, states[0], view) for panel, view in both]
    ellipses = [] if beliefs is None else [ellipse(panel, beliefs[0], view) for panel, view in both]

    def draw(k):
        for line, body, (_, view) in zip(ways, vehicles, both, strict=True):
            line.set_data(*states[: k + 1][:, view].T)
            _pose(body, states[k], view, 0.35)
        for line, (_, view) in zip(ellipses, both, strict=False):
            line.set_data(*_outline(beliefs[k], view))
        axes[0].set_title(f"{k * scene.Ts:4.1f} s")

    frames = [*range(0, len(states) - 1, every), len(states) - 1]
    return animation(picture, draw, frames, alt)


def _pose(line, state, view, size):
    centre = state[list(view)]
    if view == ABOVE:
        # An arrow head, so that it shows where ahead is.
        outline = size * np.array([[-0.7, 0.6], [1.0, 0.0], [-0.7, -0.6], [-0.3, 0.0], [-0.7, 0.6]])
        turn = state[YAW]
    else:
        outline, turn = size * np.array([[-1.0, 0.0], [1.0, 0.0]]), _slope(state)
    c, s = np.cos(turn), np.sin(turn)
    line.set_data(*(centre + outline @ np.array([[c, s], [-s, c]])).T)


def _slope(state):
    """The angle that a level disc on the vehicle makes with the x axis when it is seen from the side."""
    roll, pitch, yaw = state[ATTITUDE]
    thrust = np.array(
        [
            np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll),
            np.cos(pitch) * np.cos(roll),
        ]
    )
    return -np.arctan2(thrust[0], thrust[1])


def _show_readings(lines, state, observation, constants):
    angle = np.linspace(-np.pi, np.pi, 240)
    half = constants.R / 2
    below = constants.h / 2 - (observation[ALTITUDE] if np.isfinite(observation[ALTITUDE]) else state[2])
    for i, beacon in enumerate(constants.beacons):
        rho, alpha = observation[RANGES][i], observation[BEARINGS][i]
        radius = np.sqrt(max(rho**2 - below**2, 0.0)) if np.isfinite(rho) else np.nan
        arc = beacon[:2, None] + radius * np.array([np.cos(angle), np.sin(angle)])
        lines[i].set_data(*np.where((np.abs(arc) <= half).all(axis=0), arc, np.nan))
        direction = state[YAW] + alpha if np.isfinite(alpha) else np.nan
        length = np.linalg.norm(beacon[:2] - state[:2])
        ray = state[:2, None] + np.array([[np.cos(direction)], [np.sin(direction)]]) * [0.0, length]
        lines[4 + i].set_data(*ray)


def _outline(gaussian, view):
    columns = list(view)
    variances, axes = np.linalg.eigh(gaussian.covariance[np.ix_(columns, columns)])
    angle = np.linspace(0.0, 2.0 * np.pi, 80)
    circle = np.sqrt(chi2.ppf(INSIDE, 2)) * np.array([np.cos(angle), np.sin(angle)])
    return gaussian.mean[columns][:, None] + axes @ (np.sqrt(np.maximum(variances, 0.0))[:, None] * circle)


def _portrait(path):
    """Write the animated GIF of the reference filter at work that the README shows."""
    # Only here: students have the pictures and not the reference.
    from course_lib.beacon.reference import Estimator
    from course_lib.beacon.world import World

    constants = Constants()
    run = World(constants).simulate(np.random.default_rng(3))
    returned = replay(Estimator, run, constants, np.random.default_rng(4))
    posteriors = [getattr(step, "posterior", step) for step in returned]
    page = animate_run(run, constants, "a quadrotor among four beacons and the filter's ellipse", posteriors)
    save_animation(page, path)


if __name__ == "__main__":
    _portrait(sys.argv[1])
