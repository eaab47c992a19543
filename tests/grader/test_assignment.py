"""The arithmetic of grades, and the declarations that use it."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from course_lib.vacuum.constants import Constants, Hidden
from grader import assignments as declarations
from grader.assignment import PUBLIC_SECRET, Criterion, LogUniform, Uniform, Variant, episode_seed
from grader.assignments import assignments, load
from grader.grading.evaluate import program, recorded_run

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


def test_seeds_have_128_bits():
    seeds = [episode_seed(b"secret", "vacuum", "default", episode, "world") for episode in range(2000)]
    # Each bit is set in half of the seeds; off by six standard deviations in one of 128 bits with probability 3e-7.
    shares = np.mean([[(seed >> bit) & 1 for bit in range(128)] for seed in seeds], axis=0)
    assert np.all(np.abs(shares - 0.5) < 6.0 * 0.5 / np.sqrt(2000))


def test_every_world_can_be_imported():
    assert load()[1] == []


def test_a_world_that_cannot_be_imported_leaves_the_others(monkeypatch):
    def fail(name):
        raise SyntaxError("invalid syntax") if ".collapsed." in name else ImportError(f"no {name}")

    names = [SimpleNamespace(name="collapsed"), SimpleNamespace(name="ruin")]
    monkeypatch.setattr(declarations.pkgutil, "iter_modules", lambda path: names)
    monkeypatch.setattr(declarations.importlib, "import_module", fail)
    assert load() == (
        {},
        [
            "the assignments of collapsed cannot be loaded: SyntaxError: invalid syntax",
            "the assignments of ruin cannot be loaded: ImportError: no grader.assignments.ruin.declaration",
        ],
    )


@pytest.mark.parametrize("assignment", assignments().values(), ids=lambda assignment: assignment.name)
def test_declarations_are_sound(assignment):
    assert assignment.points == pytest.approx(100.0)
    names = [variant.name for variant in assignment.variants]
    assert len(set(names)) == len(names)
    if assignment.speed:
        assert assignment.variant(assignment.speed.variant).episodes >= 1
        # A noisy machine must not fail what is as fast as the reference.
        assert assignment.speed.none > assignment.speed.full >= 2.0
    for variant in assignment.under(PUBLIC_SECRET).variants:
        assert variant.episodes >= 1 and not variant.ranges
        for criterion in variant.criteria:
            assert criterion.none > criterion.full > 1.0
        simulated = assignment.simulate(variant, np.random.default_rng(0))
        if assignment.answer == "posterior":
            assert np.isfinite(simulated.controls).all()
            drawing = assignment.picture(variant)
        else:
            belief, state = simulated.inputs()
            assert np.isfinite(state).all() and not simulated.over
            drawing = assignment.picture(simulated)
        x0, y0, x1, y1 = drawing["room"]
        assert x0 < x1 and y0 < y1 and drawing["unit"]


# Streams

VACUUM = assignments()["vacuum"]


def changed(variant="default", **constants):
    """A variant of the same name, and so of the same seeds, with other constants or hidden numbers."""
    base = VACUUM.variant(variant)
    fields = {"constants": Constants(**constants), "hidden": base.hidden}
    return Variant(base.name, base.title, **fields, episodes=base.episodes, criteria=base.criteria)


def test_truth_and_sensor_noise_have_separate_streams():
    run = recorded_run(VACUUM, VACUUM.variant("default"), 0, b"a secret")
    # Other noise, drawn otherwise and as often: the robots do not notice.
    other = recorded_run(VACUUM, changed(w_bar=0.3, s_bar=0.5), 0, b"a secret")
    np.testing.assert_array_equal(run.truth, other.truth)
    np.testing.assert_array_equal(run.controls, other.controls)
    assert not np.array_equal(run.observations, other.observations)


def test_the_students_generator_is_unrelated_to_the_worlds():
    variant = VACUUM.variant("default")
    run = recorded_run(VACUUM, variant, 0, b"a secret")
    given = program(VACUUM, variant, 0, b"a secret", "source").seed
    assert given != episode_seed(b"a secret", "vacuum", "default", 0, "world")
    assert given != program(VACUUM, variant, 0, b"a secret").seed
    imitated = VACUUM.simulate(variant, np.random.default_rng(given))
    assert not np.isclose(imitated.truth[0], run.truth[0]).any(where=[False, False, True] * 2)
    assert not np.isclose(imitated.controls, run.controls).any()


# What the secret draws

DRAWN = [variant for variant in VACUUM.variants if variant.ranges]


def drawn(secret):
    return {(variant.name, *item) for variant in VACUUM.under(secret).variants for item in variant.drawn.items()}


def test_the_same_secret_draws_the_same_and_another_draws_other_numbers():
    first, other = drawn(b"a secret"), drawn(b"another secret")
    assert first == drawn(b"a secret") and len(first) == sum(len(variant.ranges) for variant in DRAWN)
    assert not first & other


@given(st.binary(min_size=16, max_size=16))
def test_drawn_numbers_lie_in_their_ranges_and_reach_the_world(secret):
    for declared, variant in zip(VACUUM.variants, VACUUM.under(secret).variants, strict=True):
        assert not variant.ranges and variant.drawn.keys() == declared.ranges.keys()
        for name, value in variant.drawn.items():
            assert declared.ranges[name].low <= value <= declared.ranges[name].high
            assert getattr(variant.constants, name, getattr(variant.hidden, name, None)) == value
            assert len(re.sub(r"\D", "", repr(value)).strip("0")) <= 3
        if not declared.ranges:
            assert variant is declared


def test_fields_are_drawn_apart():
    base = changed("drawn room")
    narrow = Variant(
        "drawn room", "", Constants(), Hidden(), 1, (), ranges={"w_bar": Uniform(1, 2), "L": Uniform(6.0, 10.0)}
    )
    assert base.under(b"a secret", "vacuum") is base
    here = narrow.under(b"a secret", "vacuum").drawn
    # The room does not depend on what else is drawn; another variant or assignment has another one.
    assert here["L"] == VACUUM.under(b"a secret").variant("drawn room").drawn["L"]
    assert here["L"] != narrow.under(b"a secret", "hoover").drawn["L"]
    # Not the same uniform number twice.
    assert (here["L"] - 6.0) / 4.0 != pytest.approx(here["w_bar"] - 1.0, abs=0.01)


def test_ranges_are_uniform_as_they_say():
    # Fixed seed; with fresh ones a false alarm has the probability 1e-6. Rounding is far finer than the test.
    rng = np.random.default_rng(51)
    linear = [Uniform(2.0, 4.0)(rng) for _ in range(2000)]
    ratios = [math.log2(LogUniform(0.5, 4.0)(rng)) for _ in range(2000)]
    assert kstest(linear, "uniform", args=(2.0, 2.0)).pvalue > 1e-6
    assert kstest(ratios, "uniform", args=(-1.0, 3.0)).pvalue > 1e-6


def test_what_a_student_reads_of_a_drawn_variant_names_no_number():
    for variant in VACUUM.under(b"a secret").variants:
        if variant.drawn:
            assert not re.search(r"\d", variant.name + variant.title)


def test_a_declaration_without_its_numbers_is_not_graded():
    with pytest.raises(ValueError, match="ranges, not numbers"):
        recorded_run(VACUUM, DRAWN[0], 0, b"a secret")
