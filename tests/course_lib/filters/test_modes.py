"""The heaviest cluster of a cloud: against a twin, across the seam, and where a mean would be wrong."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course_lib.angles import circular_mean, wrap
from course_lib.filters import Particles, equally_weighted, mean, modes, normalise

WIDTHS = (0.25, 0.25, np.radians(15.0))


def twin(particles, widths, angles, least):
    """Bins in a dict, joined by a search from each: the cluster of every particle as sets of indices."""
    around = {c: int(np.ceil(2 * np.pi / widths[c] - 1e-9)) for c in angles}
    held, members = {}, {}
    for i, (state, weight) in enumerate(zip(particles.states, particles.weights, strict=True)):
        key = tuple(
            int(np.floor(x / (2 * np.pi / around[c]))) % around[c] if c in around else int(np.floor(x / widths[c]))
            for c, x in enumerate(state)
        )
        held[key] = held.get(key, 0.0) + weight
        members.setdefault(key, []).append(i)
    enough = least * max(held.values())
    left, clusters = {key for key in held if held[key] >= enough}, []
    while left:
        waiting, cluster = [left.pop()], []
        while waiting:
            key = waiting.pop()
            cluster += members[key]
            for step in product((-1, 0, 1), repeat=len(key)):
                near = tuple((b + s) % around.get(c, 10**9) if c in around else b + s for c, (b, s) in
                             enumerate(zip(key, step, strict=True)))  # fmt: skip
                if near in left:
                    left.remove(near)
                    waiting.append(near)
        clusters.append(sorted(cluster))
    return sorted(clusters)


@given(
    st.integers(0, 10**6),
    st.integers(1, 120),
    st.floats(0.05, 2.0),
    st.sampled_from([(), (2,), (0, 1, 2)]),
    st.sampled_from([0.0, 0.3]),
)
def test_clusters_match_their_twin(seed, n, spread, angles, least):
    rng = np.random.default_rng(seed)
    states = rng.normal(0.0, spread, (n, 3)) + rng.choice([0.0, 3.0], (n, 1))
    particles = Particles(states, normalise(rng.standard_normal(n))[0])
    clusters = twin(particles, WIDTHS, angles, 0.0)
    labels = modes.components(states, WIDTHS, angles)
    assert [list(np.flatnonzero(labels == k)) for k in range(labels.max() + 1)] == clusters

    best = max(twin(particles, WIDTHS, angles, least), key=lambda cluster: particles.weights[cluster].sum())
    mode = modes.heaviest(particles, WIDTHS, angles, least)
    np.testing.assert_array_equal(np.flatnonzero(mode.members), best)
    assert mode.weight == pytest.approx(particles.weights[best].sum())
    expected = particles.weights[best] @ states[best] / particles.weights[best].sum()
    for c in angles:
        expected[c] = circular_mean(states[best, c], particles.weights[best])
        expected[c] = mode.mean[c] + wrap(expected[c] - mode.mean[c])
    np.testing.assert_allclose(mode.mean, expected, atol=1e-9)


def test_between_two_places_the_heavier_and_not_the_middle():
    rng = np.random.default_rng(20)
    left, right = rng.normal([0.0, 0.0, 1.0], 0.05, (400, 3)), rng.normal([4.0, 0.0, -1.0], 0.05, (600, 3))
    particles = equally_weighted(np.vstack([left, right]))
    mode = modes.heaviest(particles, WIDTHS, (2,))
    assert mode.mean == pytest.approx([4.0, 0.0, -1.0], abs=0.02) and mode.weight == pytest.approx(0.6, abs=0.01)
    assert mean(particles, (2,))[0] == pytest.approx(2.4, abs=0.02)
    # It is weight that counts, and not the number of particles.
    log_weights = np.log(np.r_[np.full(400, 2.0), np.full(600, 1.0)] / 1400.0)
    assert modes.heaviest(Particles(particles.states, log_weights), WIDTHS, (2,)).mean[0] == pytest.approx(
        0.0, abs=0.02
    )


def test_a_cluster_across_the_seam_is_one():
    rng = np.random.default_rng(21)
    headings = wrap(np.pi + rng.uniform(-0.2, 0.2, 500))
    states = np.column_stack([np.zeros((500, 2)), headings])
    mode = modes.heaviest(equally_weighted(states), WIDTHS, (2,))
    assert mode.members.all() and abs(wrap(mode.mean[2] - np.pi)) < 0.03
    # Without the circle it is two, each with about half of it.
    assert 0.4 < modes.heaviest(equally_weighted(states), WIDTHS).weight < 0.6


def test_opposite_headings_at_one_place_are_two_clusters():
    states = np.zeros((100, 3))
    states[40:, 2] = np.pi / 2
    mode = modes.heaviest(equally_weighted(states), WIDTHS, (2,))
    assert mode.mean == pytest.approx([0.0, 0.0, np.pi / 2]) and mode.weight == pytest.approx(0.6)


def test_few_injected_particles_do_not_bridge_the_room():
    rng = np.random.default_rng(22)
    n, truth = 1000, np.array([1.0, 2.0, 3.1])
    errors = {0.0: [], 0.05: []}
    for _ in range(20):
        anywhere = np.column_stack([rng.uniform(0.0, 5.0, (n, 2)), rng.uniform(-np.pi, np.pi, n)])
        states = np.where(rng.random((n, 1)) < 0.7, anywhere, truth + rng.normal(0.0, 0.03, (n, 3)))
        for least, found in errors.items():
            mode = modes.heaviest(equally_weighted(states), WIDTHS, (2,), least)
            found.append(np.hypot(*(mode.mean - truth)[:2]))
    assert max(errors[0.05]) < 0.01 < max(errors[0.0])


@pytest.mark.filterwarnings("error")
def test_clouds_of_one_particle_and_of_one_that_counts():
    mode = modes.heaviest(equally_weighted([[1.0, 2.0, -3.0]]), WIDTHS, (2,))
    assert mode.mean == pytest.approx([1.0, 2.0, -3.0]) and mode.weight == 1.0 and mode.members.all()
    states = np.arange(30.0).reshape(10, 3)
    log_weights = np.full(10, -np.inf)
    log_weights[7] = 0.0
    mode = modes.heaviest(Particles(states, log_weights), WIDTHS, (2,))
    assert mode.mean == pytest.approx([*states[7, :2], wrap(states[7, 2])]) and mode.weight == 1.0


def test_bins_as_wide_as_the_circle_join_every_heading():
    states = np.column_stack([np.zeros((4, 2)), [-3.0, -1.0, 1.0, 3.0]])
    for width in (2 * np.pi, np.pi, 100.0):
        assert modes.heaviest(equally_weighted(states), (1.0, 1.0, width), (2,)).members.all()


def test_what_has_no_bins_is_refused():
    with pytest.raises(ValueError, match="positive width of bin for each column"):
        modes.heaviest(equally_weighted(np.zeros((3, 3))), (1.0, -1.0, 1.0))
    with pytest.raises(ValueError, match="positive width of bin for each column"):
        modes.components(np.empty((0, 3)), WIDTHS)
    with pytest.raises(ValueError, match="must be finite"):
        modes.heaviest(equally_weighted([[np.inf, 0.0, 0.0]]), WIDTHS)
