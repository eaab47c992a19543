"""The arithmetic of grades, and the declarations that use it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grader.assignment import Criterion, episode_seed
from grader.assignments import assignments

CRITERION = Criterion("error", points=10.0, full=1.5, none=3.0)


@pytest.mark.parametrize(
    ("ratio", "share"), [(0.5, 1.0), (1.5, 1.0), (2.25, 0.5), (3.0, 0.0), (30.0, 0.0), (np.inf, 0.0), (np.nan, 0.0)]
)
def test_share_falls_from_full_to_none(ratio, share):
    assert CRITERION.score(0.3 * ratio, 0.3) == pytest.approx(share, abs=1e-12)


@given(st.floats(0.0, 1e6), st.floats(0.0, 1e6), st.floats(1e-3, 10.0))
def test_a_larger_error_never_earns_more(a, b, reference):
    smaller, larger = sorted([a, b])
    assert CRITERION.score(smaller, reference) >= CRITERION.score(larger, reference)


def test_seeds_repeat_and_differ_in_every_word():
    base = (b"secret", "vacuum", "default", 0, "world")
    others = [
        (b"Secret", "vacuum", "default", 0, "world"),
        (b"secret", "beacon", "default", 0, "world"),
        (b"secret", "vacuum", "fast", 0, "world"),
        (b"secret", "vacuum", "default", 1, "world"),
        (b"secret", "vacuum", "default", 0, "estimator"),
    ]
    assert episode_seed(*base) == episode_seed(*base) < 2**128
    assert len({episode_seed(*words) for words in [base, *others]}) == 6


@pytest.mark.parametrize("assignment", assignments().values(), ids=lambda assignment: assignment.name)
def test_declarations_are_sound(assignment):
    assert assignment.points == pytest.approx(100.0)
    names = [variant.name for variant in assignment.variants]
    assert len(set(names)) == len(names)
    assert assignment.variant(assignment.speed.variant).episodes >= 1
    # A noisy machine must not fail what is as fast as the reference.
    assert assignment.speed.none > assignment.speed.full >= 2.0
    for variant in assignment.variants:
        assert variant.episodes >= 1
        run = assignment.simulate(variant, np.random.default_rng(0))
        for criterion in variant.criteria:
            assert criterion.none > criterion.full > 1.0
            assert np.isfinite(run.controls).all()
