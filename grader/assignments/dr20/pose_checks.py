"""What the checks of the mean pose and of the heaviest cluster try, and the faults they know by name."""

import numpy as np

from course_lib.angles import wrap
from course_lib.filters import Particles, mean
from grader.lessons import expect

#: How far a mode may be off, in metres and radians: clusterings that cut a cluster's edges differ a little.
NEAR, NEARLY = 0.02, 0.05


def heading(function):
    """The mean of clouds on both sides of the seam at ±π, and anywhere."""
    rng = np.random.default_rng(11)
    for centre in (np.pi, 0.3, -2.0, 2.5):
        n = 60
        states = np.array([2.0, 1.0, centre]) + np.array([0.3, 0.2, 0.5]) * rng.standard_normal((n, 3))
        states[:, 2] = wrap(states[:, 2])
        weights = rng.dirichlet(np.full(n, 0.5))
        call = f"mean_pose of {n} particles about the heading {centre:.4g}"
        got = expect.array(function(states, weights), (3,), call)
        expected = mean(Particles(states, np.log(weights)), (2,))
        cos, sin = np.cos(states[:, 2]), np.sin(states[:, 2])
        half = expected.copy()
        half[2] = np.arctan((weights @ sin) / (weights @ cos))
        exchanged = np.append(expected[:2], np.arctan2(weights @ cos, weights @ sin))
        loose = np.append(expected[:2], np.arctan2(sin.mean(), cos.mean()))
        unweighted = np.append(states[:, :2].mean(axis=0), loose[2])
        sum_of_pose = np.append(states[:, :2].sum(axis=0), expected[2])
        shifted = np.append(expected[:2], weights @ np.mod(states[:, 2], 2 * np.pi))
        faults = [
            (np.append(expected[:2], weights @ states[:, 2]), "The arithmetic mean of headings: 179° and -179° are 2° "
             "apart, and their mean is 180°, not 0. Average the directions (cos θ, sin θ)."),
            (np.append(expected[:2], states[:, 2].mean()), "The arithmetic mean of headings, and without the weights."),
            (shifted, "The seam is only moved to 0: average the directions (cos θ, sin θ)."),
            (states.mean(axis=0), "The arithmetic mean, and without the weights."),
            (unweighted, "The weights are not used."),
            (loose, "The weights are not used for the heading."),
            (np.append(states[:, :2].mean(axis=0), expected[2]), "The weights are not used for the position."),
            (states[np.argmax(weights)], "This is the heaviest particle, not the mean."),
            (exchanged, "np.arctan2 takes the sine first."),
            (half, "np.arctan knows only half of the circle: use np.arctan2."),
            (np.append(expected[:2], np.degrees(expected[2])), "Headings are in radians."),
            (sum_of_pose, "The positions are summed and not weighed."),
        ]  # fmt: skip
        apart = got.copy()
        apart[2] = expected[2] + wrap(got[2] - expected[2])
        if np.allclose(apart, expected, rtol=1e-9, atol=1e-9):
            assert abs(got[2]) <= np.pi + 1e-9, f"{call}: the heading {got[2]:.4f} is not wrapped to [-π, π)"
            continue
        named = [text for wrong, text in faults if np.allclose(got, wrong, rtol=1e-9, atol=1e-9)]
        raise AssertionError("\n".join([*named[:1], f"{call}\nexpected {_pose(expected)}, got {_pose(got)}"]))


def _pose(pose):
    return "({:.4f}, {:.4f}), heading {:.4f}".format(*pose)


def mode(function):
    """Clouds of clusters, of which the heaviest is known."""
    for what, clusters in [
        ("two clusters", [(200, 0.6, (1.0, 1.0, 0.5)), (200, 0.4, (3.6, 3.8, -1.0))]),
        ("a few heavy particles and many light ones", [(300, 0.3, (3.6, 0.6, 1.0)), (80, 0.7, (0.6, 3.6, -0.7))]),
        (
            "a cluster that looks across θ = ±π and a lighter one",
            [(200, 0.55, (1.5, 3.2, np.pi)), (200, 0.45, (4.2, 0.8, 0.4))],
        ),
        ("two headings at one place", [(200, 0.4, (2.6, 4.2, -0.4)), (200, 0.6, (2.6, 4.2, 2.2))]),
    ]:
        _find(function, what, clusters)


def _find(function, what, clusters):
    rng = np.random.default_rng(12)
    parts, masses = [], []
    for n, mass, centre in clusters:
        # A disc of 0.12 m and ±0.2 rad, heavier towards one side: with weights its mean is elsewhere.
        radius, angle = 0.12 * np.sqrt(rng.random(n)), rng.uniform(-np.pi, np.pi, n)
        off = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(-0.2, 0.2, n)])
        share = np.exp(25.0 * off[:, 0] + 5.0 * off[:, 2])
        parts.append(np.asarray(centre) + off)
        masses.append(mass * 0.96 * share / share.sum())
    strays = np.column_stack([rng.uniform(0, 5, (20, 2)), rng.uniform(-np.pi, np.pi, 20)])
    sizes = [len(part) for part in (*parts, strays)]
    label, order = np.repeat(np.arange(len(sizes)), sizes), rng.permutation(sum(sizes))
    states = np.vstack([*parts, strays])[order]
    states[:, 2] = wrap(states[:, 2])
    weights = np.concatenate([*masses, np.full(20, 0.04 / 20)])[order]
    weights, label = weights / weights.sum(), label[order]
    call = f"modal_pose of {what}, {len(states)} particles"
    got = expect.array(function(states, weights), (3,), call)

    def average(members, w=weights):
        return mean(Particles(states[members], np.log(w[members] / w[members].sum())), (2,))

    heavy = np.argmax([mass for _, mass, _ in clusters])
    large = np.argmax([n for n, _, _ in clusters])
    expected, equal = average(label == heavy), np.ones(len(states))
    if _near(got, expected):
        assert abs(got[2]) <= np.pi + 1e-9, f"{call}: the heading {got[2]:.4f} is not wrapped to [-π, π)"
        return
    all_of_them = np.ones(len(states), dtype=bool)
    plain = np.append(expected[:2], weights[label == heavy] @ states[label == heavy, 2] / weights[label == heavy].sum())
    here = np.hypot(*(states[:, :2] - expected[:2]).T) < 0.5
    faults = [
        (states[np.argmax(weights)], "This is the heaviest particle: the cluster's mean is asked for."),
        (average(all_of_them), "This is the mean of all particles: between two clusters there is nothing."),
        (weights @ states, "This is the mean of all particles: between two clusters there is nothing."),
        (states.mean(axis=0), "This is the mean of all particles, and the weights are not used."),
        (average(here), "Particles at one place that look elsewhere are another cluster: the heading counts too."),
        (np.append(average(here)[:2], weights[here] @ states[here, 2] / weights[here].sum()),
         "Particles at one place that look elsewhere are another cluster: the heading counts too."),
        (plain, "The arithmetic mean of headings: across the seam at ±π it points the other way."),
        (average(label == heavy, equal), "The heaviest cluster, but its mean is without the weights."),
    ]  # fmt: skip
    named = [text for wrong, text in faults if _near(got, wrong, 1e-6)]
    elsewhere = np.hypot(*(got - expected)[:2]) > 0.5 or abs(wrap(got[2] - expected[2])) > 0.5
    if not elsewhere:
        reason = (
            "The right cluster, but not all of it, or more than it: particles within 0.3 m and 0.5 rad belong to it."
        )
    elif "±π" in what:
        reason = "A cluster that looks across θ = ±π is one cluster: compare headings by `wrap` of their difference."
    elif large != heavy:
        reason = "The cluster of most particles is not the heaviest: weights count, not heads."
    else:
        reason = "The lighter cluster, or none."
    named.append(reason)
    raise AssertionError("\n".join([*named[:1], f"{call}\nexpected {_pose(expected)}, got {_pose(got)}"]))


def _near(got, pose, size=1.0):
    return np.hypot(*(got - pose)[:2]) <= size * NEAR and abs(wrap(got[2] - pose[2])) <= size * NEARLY
