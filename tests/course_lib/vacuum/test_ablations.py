"""What the lesson says of filters with a part taken away."""

import numpy as np
import pytest

from course_lib.recording import replay
from course_lib.vacuum.ablations import bootstrap_filter
from course_lib.vacuum.constants import Constants, Hidden
from course_lib.vacuum.world import World


@pytest.fixture
def run():
    return World(hidden=Hidden(steps=60)).simulate(np.random.default_rng(1))


def different(posterior):
    return len(np.unique(posterior.states[:, [2, 5]], axis=0))


def test_without_roughening_copies_stay_copies(run):
    # Headings before the first resampling differ all; with fixed seeds this is deterministic.
    counts = {
        K: [different(p) for p in replay(bootstrap_filter(200, K), run, Constants(), np.random.default_rng(0))]
        for K in (0.0, 0.1)
    }
    assert min(counts[0.0]) < 20
    assert min(counts[0.1]) > 190


def test_answers_to_zero_weights():
    previous = bootstrap_filter(50)(None, None, None, Constants(), np.random.default_rng(0))
    impossible = np.array([100.0, np.inf, np.inf, np.inf])
    kept, redrawn = (
        bootstrap_filter(50, when_all_zero=answer)(
            previous, impossible, np.array([1.0, 1.0]), Constants(), np.random.default_rng(1)
        ).states
        for answer in ("keep", "redraw")
    )
    # 0.1 m from the corners they start in, or anywhere.
    corners = Constants().sensors[:2]
    far = [np.linalg.norm(states[:, None, :2] - corners, axis=2).min(axis=1).max() for states in (kept, redrawn)]
    assert far[0] < 0.11 and far[1] > 1.0
