"""Figures keep their words, animations move, colours can be told apart."""

import base64
import io
import re

import matplotlib.colors
import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from course_lib import plotting


def images(output):
    """Embedded images of a notebook output: kind -> bytes."""
    return {
        kind: base64.b64decode(data) for kind, data in re.findall(r'"data:image/(\w+);base64,([^"]+)"', output.data)
    }


@pytest.fixture
def picture():
    figure, axes = plotting.subplots(figsize=(2, 2))
    axes.plot([0, 1], [0, 1])
    return figure


def test_figure_is_a_png_with_alt_text_and_is_closed(picture):
    output = plotting.figure(picture, alt="A line from\n   one corner to the other.")
    assert 'alt="A line from one corner to the other."' in output.data
    assert Image.open(io.BytesIO(images(output)["png"])).size == (200, 200)
    assert not plt.fignum_exists(picture.number)


def test_alt_text_cannot_break_out_of_its_attribute(picture):
    output = plotting.figure(picture, alt='5 < 6 & "quoted" is <b>not</b> markup')
    assert "<b>" not in output.data
    assert "&quot;quoted&quot;" in output.data


@pytest.mark.parametrize("alt", ["", " \n"])
def test_figure_without_words_is_refused(picture, alt):
    with pytest.raises(ValueError, match="alt text"):
        plotting.figure(picture, alt=alt)


def test_figure_is_the_same_twice():
    def draw():
        figure, axes = plotting.subplots()
        axes.plot([0, 1], [1, 0])
        return plotting.figure(figure, alt="A line.").data

    assert draw() == draw()


def test_animation_is_a_gif_that_moves_and_a_still(picture):
    (line,) = picture.axes[0].get_lines()
    output = plotting.animation(
        picture, lambda k: line.set_ydata([0, k / 5]), range(6), alt="A line that rises.", frames_per_second=5
    )
    moving, still = (Image.open(io.BytesIO(images(output)[kind])) for kind in ("gif", "png"))
    assert moving.n_frames == 6
    assert moving.info["duration"] == 200
    moving.seek(5)
    assert np.array_equal(np.asarray(moving.convert("RGB")), np.asarray(still.convert("RGB")))
    assert "prefers-reduced-motion" in output.data and 'alt="A line that rises."' in output.data
    assert not plt.fignum_exists(picture.number)


def luminance(colour):
    """Relative luminance of WCAG 2."""
    channels = np.array(matplotlib.colors.to_rgb(colour))
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def test_palette_is_okabe_and_itos():
    assert len(set(plotting.PALETTE)) == 8
    # Three that differ in lightness alone, so that they stay apart in print and for every kind of colour vision.
    lightness = [luminance(c) for c in (plotting.BLACK, plotting.BLUE, plotting.ORANGE)]
    assert lightness == sorted(lightness) and min(np.diff(lightness)) > 0.1
