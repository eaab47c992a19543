"""Pictures of the DR20 and of what a filter makes of its scans. Metres and seconds; the truth is black."""

import sys

import numpy as np

from course_lib.dr20.constants import HEADING, Constants, Hidden, X, Y
from course_lib.geometry import polygons
from course_lib.plotting import BLACK, BLUE, ORANGE, VERMILLION, animation, representatives, save_animation, subplots
from course_lib.recording import replay

#: Length of a particle's tick, in metres.
TICK = 0.12


def room(axes, constants):
    """Draw the map, and give the axes their titles.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    constants : Constants
    """
    axes.grid(False)
    rings = [np.asarray(ring, dtype=float) for ring in (constants.room, *constants.obstacles)]
    # By the even-odd rule a ring within an odd number of others is solid, and a hole in that is free again.
    depths = [
        sum(bool(polygons.inside(ring[:1], polygons.walls([other]))[0]) for other in rings if other is not ring)
        for ring in rings
    ]
    for depth, ring in sorted(zip(depths, rings, strict=True), key=lambda pair: pair[0]):
        face = {"facecolor": "#cccccc", "hatch": "///"} if depth % 2 else {"facecolor": "white"}
        axes.fill(*ring.T, edgecolor=BLACK, linewidth=1.2, zorder=0.5, **face)
    x0, y0, x1, y1 = constants.bounds
    margin = 0.04 * max(x1 - x0, y1 - y0)
    axes.set(
        xlim=(x0 - margin, x1 + margin),
        ylim=(y0 - margin, y1 + margin),
        aspect="equal",
        xlabel="x in m",
        ylabel="y in m",
    )


def robot(axes, pose, constants, color=BLACK, label=None, width=2.0):
    """Draw a robot: a disc with a hand that points ahead.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    pose : array_like, shape (3,)
    constants : Constants
    color, label : str
    width : float
        Of the stroke, in points.

    Returns
    -------
    matplotlib.lines.Line2D
    """
    return axes.plot(*_disc(pose, constants), color=color, linewidth=width, zorder=4, label=label)[0]


def scan(axes, pose, observation, constants):
    """Draw what the beams say: rays as long as the readings, from a pose. What is missing is not drawn.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    pose : array_like, shape (3,)
    observation : array_like, shape (B,)
    constants : Constants

    Returns
    -------
    matplotlib.lines.Line2D
    """
    x, y = _rays(pose, observation, constants)
    return axes.plot(x, y, "-", color=ORANGE, linewidth=1.2, marker=".", markevery=(1, 3), markersize=6, zorder=3)[0]


def cloud(axes, particles, size=400, label=None):
    """Draw particles, each in proportion to its weight: ticks that point ahead.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    particles : Particles
        States (N, 3).
    size : int
        How many are drawn.
    label : str, optional

    Returns
    -------
    matplotlib.lines.Line2D
    """
    x, y = _ticks(particles, size)
    style = {"color": BLUE, "linewidth": 0.8, "alpha": 0.6, "markevery": (0, 3), "markeredgewidth": 0}
    return axes.plot(x, y, "-", marker="o", markersize=2.6, label=label, zorder=5, **style)[0]


def way(axes, poses, broken=1.0):
    """Draw the way of poses; where it jumps, the line is broken.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    poses : ndarray, shape (T, 3)
    broken : float
        Metres between two poses that make a jump.

    Returns
    -------
    matplotlib.lines.Line2D
    """
    jumps = np.flatnonzero(np.hypot(*np.diff(poses[:, : Y + 1], axis=0).T) > broken) + 1
    x, y = np.insert(poses[:, : Y + 1], jumps, np.nan, axis=0).T
    return axes.plot(x, y, color=BLACK, linewidth=1.5, zorder=3)[0]


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
        A logarithmic scale; one that begins at zero otherwise.
    """
    for (name, values), style in zip(series.items(), ["-", "--", "-.", ":"], strict=False):
        axes.plot((1 + np.arange(len(values))) * Ts, values, style, linewidth=1.3, label=name)
    axes.set(xlabel="time in s", ylabel=ylabel)
    if log:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, None)
    axes.legend(fontsize=9)


def headings(axes, series, Ts):
    """Draw headings over time in degrees, without a stroke across the picture where one passes ±180°.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    series : dict of str to ndarray, shape (T,)
        Name to radians in [-π, π) at times Ts, 2 Ts, ..., T Ts.
    Ts : float
        In seconds.
    """
    for (name, values), style in zip(series.items(), ["-", "--", "-.", ":"], strict=False):
        turns = np.flatnonzero(np.abs(np.diff(values)) > 1.5 * np.pi) + 1
        times = (1.0 + np.arange(len(values))) * Ts
        axes.plot(np.insert(times, turns, np.nan), np.insert(np.degrees(values), turns, np.nan), style, label=name)
    axes.set(xlabel="time in s", ylabel="heading in °", ylim=(-185, 185), yticks=range(-180, 181, 90))
    axes.legend(fontsize=9)


def averages(axes, slow, fast, share, Ts):
    """Draw the running averages of augmented MCL, and beneath them what they have it inject.

    Parameters
    ----------
    axes : sequence of two matplotlib.axes.Axes
        For the averages and for the share.
    slow, fast, share : ndarray, shape (T,)
        w_slow, w_fast and the injected share of the particles at times Ts, 2 Ts, ..., T Ts.
    Ts : float
        In seconds.
    """
    times = (1 + np.arange(len(slow))) * Ts
    axes[0].plot(times, slow, "-", color=BLUE, linewidth=1.5, label="w_slow")
    axes[0].plot(times, fast, "--", color=VERMILLION, linewidth=1.2, label="w_fast")
    axes[0].set(ylim=(0, None), ylabel="mean weight")
    axes[0].legend(fontsize=8, loc="upper left")
    axes[1].fill_between(times, 100.0 * np.asarray(share), step="mid", color=VERMILLION, alpha=0.5, linewidth=0)
    axes[1].set(ylim=(0, 100), ylabel="injected %", xlabel="time in s")


def animate_run(
    run, constants, alt, posteriors=None, estimates=None, traces=None, every=2, size=250, trail=40, rate=10
):
    """Animate a run: the robot and its scan, and what a filter makes of it.

    Parameters
    ----------
    run : Run
    constants : Constants
    alt : str
        Description for those who do not see it.
    posteriors : sequence of Particles, optional
        At times 0, 1, ..., T.
    estimates : ndarray, shape (T + 1, 3), optional
        A pose for each, drawn beside the true one.
    traces : tuple of three ndarray, shape (T,), optional
        w_slow, w_fast and the injected share, drawn beneath as in `averages`.
    every : int
        Steps from frame to frame.
    size : int
        How many particles are drawn.
    trail : int
        Steps of the way behind the robot.
    rate : float
        Frames per second.

    Returns
    -------
    IPython.display.HTML
    """
    if traces is None:
        picture, axes = subplots(figsize=(4.8, 4.9))
    else:
        picture, (axes, *strips) = subplots(3, 1, figsize=(4.8, 7.2), height_ratios=[4.6, 1.1, 0.9])
        averages(strips, *traces, constants.Ts)
        now = [strip.axvline(0.0, color=BLACK, linewidth=1) for strip in strips]
        for strip in strips:
            strip.set_xlim(0.0, run.steps * constants.Ts)
        strips[0].label_outer()
    room(axes, constants)
    behind = way(axes, run.truth[:1])
    rays = scan(axes, run.truth[0], np.full(len(constants.bearings), np.inf), constants)
    particles = None if posteriors is None else cloud(axes, posteriors[0], size=size, label="particles")
    guess = None if estimates is None else robot(axes, estimates[0], constants, VERMILLION, "estimate", 4.5)
    body = robot(axes, run.truth[0], constants, label="robot")
    if posteriors is not None:
        picture.legend(*axes.get_legend_handles_labels(), ncols=3, loc="outside upper center", fontsize=8)

    def draw(k):
        past = run.truth[max(0, k - trail) : k + 1, : Y + 1]
        # A kidnapped robot leaves no trace.
        carried = np.flatnonzero(np.hypot(*np.diff(past, axis=0).T) > 1.0)
        behind.set_data(*past[carried[-1] + 1 if carried.size else 0 :].T)
        body.set_data(*_disc(run.truth[k], constants))
        if k:
            rays.set_data(*_rays(run.truth[k], run.observations[k - 1], constants))
        if particles is not None:
            particles.set_data(*_ticks(posteriors[k], size))
        if guess is not None:
            guess.set_data(*_disc(estimates[k], constants))
        if traces is not None:
            for line in now:
                line.set_xdata([k * constants.Ts] * 2)
        axes.set_title(f"{k * constants.Ts:4.1f} s", fontsize=10)

    return animation(picture, draw, range(0, run.steps + 1, every), alt, rate)


def _disc(pose, constants):
    # Around, then to the centre, and ahead over the edge.
    angle = np.concatenate([np.linspace(0.0, 2.0 * np.pi, 25), [0.0, 0.0]]) + pose[HEADING]
    radius = constants.radius * np.concatenate([np.ones(25), [0.0, 1.6]])
    return pose[X] + radius * np.cos(angle), pose[Y] + radius * np.sin(angle)


def _rays(pose, observation, constants):
    heading, direction = pose[HEADING], pose[HEADING] + np.asarray(constants.bearings)
    read = np.where(np.isfinite(observation), observation, np.nan)
    start = np.array([[pose[X]], [pose[Y]]]) + constants.mount * np.array([[np.cos(heading)], [np.sin(heading)]])
    start = np.where(np.isnan(read), np.nan, start)
    ends = start + read * np.array([np.cos(direction), np.sin(direction)])
    return np.stack([start, ends, np.full_like(ends, np.nan)], axis=-1).reshape(2, -1)


def _ticks(particles, size):
    x, y, heading = representatives(particles, size).T
    gap = np.full_like(x, np.nan)
    return (
        np.stack([x, x + TICK * np.cos(heading), gap], axis=-1).ravel(),
        np.stack([y, y + TICK * np.sin(heading), gap], axis=-1).ravel(),
    )


def _portrait(path):
    """Write the animated GIF of the reference filter at work that the README shows."""
    # Only here: students have the pictures and not the reference.
    from course_lib.dr20.mcl import pose
    from course_lib.dr20.reference import Estimator
    from course_lib.dr20.world import World

    constants = Constants(kidnap_rate=0.1)
    run = World(constants, Hidden(steps=140, kidnaps=1)).simulate(np.random.default_rng(6))
    posteriors = [step.posterior for step in replay(Estimator, run, constants, np.random.default_rng(4))]
    estimates = np.array([pose(posterior) for posterior in posteriors])
    page = animate_run(run, constants, "a robot, its scan and its particles", posteriors, estimates, rate=6)
    save_animation(page, path)


if __name__ == "__main__":
    _portrait(sys.argv[1])
