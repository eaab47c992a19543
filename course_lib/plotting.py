"""Pictures that everyone can read: colours for the colour-blind, words for those who see none, no display needed."""

import base64
import html
import io
import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cycler import cycler
from IPython.display import HTML
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

#: The eight colours of M. Okabe and K. Ito, *Color universal design*, 2008: distinct for every kind of colour vision.
BLACK, ORANGE, SKY_BLUE, GREEN, YELLOW, BLUE, VERMILLION, PURPLE = PALETTE = (
    "#000000",
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#F0E442",
    "#0072B2",
    "#D55E00",
    "#CC79A7",
)

#: What every figure of the course shares.
STYLE = {
    "axes.prop_cycle": cycler(color=[BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY_BLUE, BLACK]),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "font.size": 10,
    "figure.constrained_layout.use": True,
}


def subplots(*arguments, **keywords):
    """`matplotlib.pyplot.subplots` in the course's style; parameters and return are its own."""
    with plt.rc_context(STYLE):
        return plt.subplots(*arguments, **keywords)


def figure(picture, alt, dpi=100):
    """A figure for a notebook that keeps its description, and is closed.

    Matplotlib's own output in a notebook has no alternative text.

    Parameters
    ----------
    picture : matplotlib.figure.Figure
    alt : str
        What one sees, for a reader who does not: the finding, not the decoration.
    dpi : int
        Pixels per inch.

    Returns
    -------
    IPython.display.HTML

    Raises
    ------
    ValueError
        The description is empty.
    """
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=dpi)
    plt.close(picture)
    return _embed(buffer.getvalue(), "png", alt)


def animation(picture, draw, frames, alt, frames_per_second=10, dpi=72):
    """An animated GIF of a figure for a notebook: works offline, needs no script, and is closed.

    Readers who asked their system for less motion see the last frame.

    Parameters
    ----------
    picture : matplotlib.figure.Figure
    draw : callable
        `draw(frame)` changes the figure to show one frame.
    frames : iterable
        What `draw` is called with, in turn.
    alt : str
        As in `figure`.
    frames_per_second : float
    dpi : int
        Pixels per inch.

    Returns
    -------
    IPython.display.HTML
    """
    picture.set_dpi(dpi)
    canvas = FigureCanvasAgg(picture)
    images = []
    for frame in frames:
        draw(frame)
        canvas.draw()
        # The first frame fixes the layout: axes that moved with every label would be dizzying, and slow.
        picture.set_layout_engine("none")
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3]))
    plt.close(picture)
    # One palette for all frames: nothing flickers, and equal pixels compress to nothing.
    palette = images[-1].quantize(128, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    # Pillow looks colours up with few bits, and takes an almost white one for white.
    colours = np.reshape(palette.getpalette(), (-1, 3))
    colours[colours.min(axis=1) > 240] = 255
    palette.putpalette(colours.ravel().tolist())
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    moving, still = io.BytesIO(), io.BytesIO()
    duration = round(1000 / frames_per_second)
    images[0].save(moving, "GIF", save_all=True, append_images=images[1:], duration=duration, loop=0)
    images[-1].save(still, "PNG", optimize=True)
    return _embed(moving.getvalue(), "gif", alt, still.getvalue())


def save_animation(page, path):
    """Write what `animation` returned to a GIF file."""
    encoded = re.search(r"data:image/gif;base64,([^\"]+)", page.data)[1]
    Path(path).write_bytes(base64.b64decode(encoded))


def representatives(particles, size):
    """At most `size` states in which each particle appears in proportion to its weight, without chance.

    Parameters
    ----------
    particles : Particles
        states (N, d).
    size : int

    Returns
    -------
    ndarray, shape (min(size, N), d)
    """
    cumulative = np.cumsum(particles.weights)
    size = min(size, len(cumulative))
    positions = (np.arange(size) + 0.5) / size * cumulative[-1]
    return particles.states[np.searchsorted(cumulative, positions)]


def _embed(data, kind, alt, still=None):
    if not alt.strip():
        raise ValueError("a figure needs alt text: say in a sentence what it shows")
    source = "" if still is None else f'<source media="(prefers-reduced-motion: reduce)" srcset="{_url(still, "png")}">'
    image = f'<img src="{_url(data, kind)}" alt="{html.escape(" ".join(alt.split()))}" style="max-width: 100%">'
    return HTML(f"<picture>{source}{image}</picture>" if source else image)


def _url(data, kind):
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
