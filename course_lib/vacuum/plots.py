"""Pictures of the two vacuum robots. All lengths in metres, times in seconds; robot A is blue, robot B vermillion."""

import sys

import numpy as np

from course_lib.plotting import BLACK, BLUE, VERMILLION, animation, representatives, save_animation, subplots
from course_lib.recording import replay
from course_lib.vacuum.constants import Constants

#: Per robot: name, colour, marker of its cloud. The marker tells the robots apart where the colour does not.
ROBOTS = (("A", BLUE, "o"), ("B", VERMILLION, "^"))


def room(axes, constants):
    """Draw the walls and the sensors, and give the axes their titles.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    constants : Constants
    """
    width, height = constants.room
    axes.grid(False)
    axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color=BLACK, linewidth=1.5)
    for i, (x, y) in enumerate(constants.sensors):
        name, colour, _ = ROBOTS[i // 2]
        axes.plot(x, y, "s", color=colour, markersize=9, zorder=3, clip_on=False)
        outwards = np.sign([x - width / 2, y - height / 2])
        axes.annotate(
            f"S{i + 1} ({name})",
            (x, y),
            xytext=(0, 9 * outwards[1]),
            textcoords="offset points",
            ha="right" if outwards[0] > 0 else "left",
            va="bottom" if outwards[1] > 0 else "top",
        )
    margin = 0.12 * height
    axes.set(
        xlim=(-margin, width + margin),
        ylim=(-margin, height + margin),
        aspect="equal",
        xlabel="x in m",
        ylabel="y in m",
    )


def trajectories(axes, truth, constants):
    """Draw the room and both robots' ways through it.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    truth : ndarray, shape (T + 1, 6)
        True states at times 0, 1, ..., T.
    constants : Constants
    """
    room(axes, constants)
    for robot, (name, colour, marker) in enumerate(ROBOTS):
        x, y = truth[:, 3 * robot : 3 * robot + 2].T
        axes.plot(x, y, color=colour, linewidth=1, alpha=0.6)
        axes.plot(x[-1], y[-1], marker, color=colour, markersize=9, markeredgecolor=BLACK, label=f"robot {name}")


def clouds(axes, particles, truth, constants, size=400, dot=3):
    """Draw the room, both robots' particles, and the robots themselves.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    particles : Particles
        States (N, 6).
    truth : ndarray, shape (6,)
    constants : Constants
    size : int
        How many particles are drawn, each in proportion to its weight, so that density shows weight.
    dot : float
        Size of a particle in points.

    Returns
    -------
    list of matplotlib.lines.Line2D
        Particles of A, robot A, particles of B, robot B.
    """
    room(axes, constants)
    lines = []
    for name, colour, marker in ROBOTS:
        cloud = {"color": colour, "markersize": dot, "alpha": 0.35, "markeredgewidth": 0}
        lines += axes.plot([], [], marker, label=f"particles of {name}", **cloud)
        lines += axes.plot([], [], marker, label=f"robot {name}", **_true_robot(colour))
    _show(lines, particles, truth, size)
    return lines


def errors(axes, series, Ts):
    """Draw position errors over time.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    series : dict of str to ndarray, shape (T + 1,)
        Name to errors in metres at times 0, 1, ..., T.
    Ts : float
        Sampling time in seconds.
    """
    for (name, values), style in zip(series.items(), ["-", "--", ":", "-."], strict=False):
        axes.plot(np.arange(len(values)) * Ts, values, style, label=name)
    axes.set(xlabel="time in s", ylabel="error in m", ylim=(0, None))
    axes.legend()


def animate_run(run, constants, alt, every=2, trail=20):
    """Animate what happens: the robots, the last of their ways, and the circles that readings say they are on.

    Parameters
    ----------
    run : Run
    constants : Constants
    alt : str
        Description for those who do not see it.
    every : int
        Steps from frame to frame.
    trail : int
        Steps of the way behind each robot.

    Returns
    -------
    IPython.display.HTML
    """
    picture, axes = subplots(figsize=(5.2, 5.2))
    room(axes, constants)
    ways, robots, circles = [], [], []
    for _, colour, marker in ROBOTS:
        ways += axes.plot([], [], color=colour, linewidth=2, alpha=0.6)
        robots += axes.plot([], [], marker, **_true_robot(colour))
    angle = np.linspace(0, 2 * np.pi, 200)
    for i in range(4):
        circles += axes.plot([], [], "--", color=ROBOTS[i // 2][1], linewidth=1.2)
    width, height = constants.room

    def draw(k):
        past = run.truth[max(0, k - trail) : k + 1]
        for robot in (0, 1):
            x, y = past[:, 3 * robot : 3 * robot + 2].T
            ways[robot].set_data(x, y)
            robots[robot].set_data(x[-1:], y[-1:])
        # A reading is shown until the next frame.
        recent = run.observations[max(0, k - every) : k]
        for circle, sensor, readings in zip(circles, constants.sensors, recent.T, strict=True):
            heard = readings[np.isfinite(readings)]
            x, y = sensor[:, None] + (heard[-1] if heard.size else np.nan) * np.array([np.cos(angle), np.sin(angle)])
            inside = (x >= 0) & (x <= width) & (y >= 0) & (y <= height)
            circle.set_data(np.where(inside, x, np.nan), np.where(inside, y, np.nan))
        axes.set_title(f"{k * constants.Ts:4.1f} s")

    return animation(picture, draw, range(0, run.steps + 1, every), alt)


def animate_clouds(run, posteriors, constants, alt, every=2, size=250):
    """Animate what the filter knows: both clouds and the robots they follow.

    Parameters
    ----------
    run : Run
    posteriors : sequence of Particles
        At times 0, 1, ..., T.
    constants : Constants
    alt : str
        Description for those who do not see it.
    every : int
        Steps from frame to frame.
    size : int
        How many particles are drawn, as in `clouds`.

    Returns
    -------
    IPython.display.HTML
    """
    picture, axes = subplots(figsize=(5.2, 5.2))
    lines = clouds(axes, posteriors[0], run.truth[0], constants, size)

    def draw(k):
        _show(lines, posteriors[k], run.truth[k], size)
        axes.set_title(f"{k * constants.Ts:4.1f} s")

    return animation(picture, draw, range(0, run.steps + 1, every), alt)


def _show(lines, particles, truth, size):
    """Give the lines of `clouds` their data."""
    chosen = representatives(particles, size)
    for robot in (0, 1):
        columns = [3 * robot, 3 * robot + 1]
        lines[2 * robot].set_data(*chosen[:, columns].T)
        lines[2 * robot + 1].set_data(*truth[columns, None])


def _true_robot(colour):
    return {"color": colour, "markersize": 11, "markeredgecolor": BLACK, "markeredgewidth": 1.5, "zorder": 4}


def _portrait(path):
    """Write the animated GIF of the reference filter at work that the README shows."""
    # Only here: students have the pictures and not the reference.
    from course_lib.vacuum.reference import Estimator
    from course_lib.vacuum.world import World

    constants = Constants()
    run = World(constants).simulate(np.random.default_rng(3))
    returned = replay(Estimator, run, constants, np.random.default_rng(4))
    posteriors = [getattr(step, "posterior", step) for step in returned]
    page = animate_clouds(run, posteriors, constants, "two robots and their clouds")
    save_animation(page, path)


if __name__ == "__main__":
    _portrait(sys.argv[1])
