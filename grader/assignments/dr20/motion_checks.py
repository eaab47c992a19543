"""What the check of the motion model tries, and the faults it knows by name.

Noise is drawn from fixed seeds; the limits fail a right function with a probability of at most 1e-8.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import kstest

from course_lib.angles import wrap
from course_lib.dr20 import maps, models
from course_lib.dr20.constants import Constants
from course_lib.geometry import polygons
from grader.lessons import expect

RARE = 1e-9
#: A room in which no number is a default.
OTHER = Constants(
    room=maps.ATTIC,
    obstacles=maps.CHIMNEYS,
    bearings=(-2.0, -1.1, -0.4, 0.1, 0.7, 1.6, 2.5),
    mount=0.1,
    radius=0.2,
    Ts=0.2,
    sigma_v=0.05,
    sigma_omega=0.1,
    sigma=0.08,
    r_max=2.5,
    p_short=0.1,
    rate_short=2.0,
    p_miss=0.06,
    p_random=0.04,
    near=(2.8, 1.2),
    within=0.5,
)
#: Draws of the noise: their standard deviation is known to 1 %, and limits are 7 times that.
DRAWS = 5000


def words(constants):
    """Words for a room."""
    return "in the course's room" if constants.room == maps.ROOM else "in another room, with other numbers"


def motion(function):
    """Without noise, far from walls and at them; then the noise."""
    for constants in (Constants(), OTHER):
        _on_an_arc(function, constants)
        _at_walls(function, constants)
    for constants in (Constants(), OTHER):
        _noise(function, constants)
    states = models.prior(50, OTHER, np.random.default_rng(1))
    expect.repeats(lambda rng: function(states, np.array([0.4, 0.3]), OTHER, rng), "transition")


def _called(function, states, control, constants, call, seed=2):
    with np.errstate(all="ignore"):
        result = function(states, np.array(control), constants, np.random.default_rng(seed))
    return expect.array(result, states.shape, call)


def _wrapped(got, call):
    off = np.abs(got[:, 2]) > np.pi + 1e-9
    assert not off.any(), f"{call}: the heading {got[off][0, 2]:.4f} is not wrapped to [-π, π)"


def _example(states, expected, got):
    def example(i):
        poses = "; ".join("({:.4f}, {:.4f}), {:.4f}".format(*pose[i]) for pose in (states, expected, got))
        return f"from, expected and got (x, y), heading: {poses}"

    return example


def _arc(states, v, omega, T, along="chord", turn=1.0):
    """Where an arc ends, or what is taken for it."""
    half = 0.5 * omega * T
    direction = states[:, 2] + {"old": 0.0, "new": 2.0 * half}.get(along, half)
    way = v * T * (np.sinc(half / np.pi) if along == "chord" else 1.0)
    return np.column_stack(
        [states[:, 0] + way * np.cos(direction), states[:, 1] + way * np.sin(direction), states[:, 2] + turn * 2 * half]
    )


def _hall(constants):
    """The same robot where no wall is near."""
    return replace(constants, room=maps.box(-90.0, -90.0, 90.0, 90.0), obstacles=())


def _on_an_arc(function, constants):
    quiet = replace(_hall(constants), sigma_v=0.0, sigma_omega=0.0)
    states = models.anywhere(40, constants, np.random.default_rng(3))
    T = constants.Ts
    for v, omega in [(0.5, 1.5), (0.6, -0.8), (0.5, 0.0), (0.0, 1.0), (-0.4, 0.9)]:
        call = f"transition far from walls, without noise, v = {v:g}, ω = {omega:g}, T_s = {T:g}"
        with np.errstate(all="ignore"):
            raw = function(states, np.array([v, omega]), quiet, np.random.default_rng(2))
        if omega == 0.0 and np.shape(raw) == states.shape and np.isnan(np.asarray(raw, dtype=float)).any():
            raise AssertionError(
                f"ω = 0 divides by zero: sin(a)/a is 1 there, as np.sinc(a / np.pi) has it.\n{call}: got nan"
            )
        got = expect.array(raw, states.shape, call)
        expected = _arc(states, v, omega, T)
        swapped = _arc(states, v, omega, T)
        swapped[:, :2] = states[:, :2] + (swapped - states)[:, 1::-1]
        y_without_T = np.column_stack([expected[:, 0], states[:, 1] + (expected - states)[:, 1] / T, expected[:, 2]])
        degrees = _arc(states, v, omega, T)
        turned = np.radians(states[:, 2] + 0.5 * omega * T)
        degrees[:, :2] = states[:, :2] + v * T * np.column_stack([np.cos(turned), np.sin(turned)])
        faults = [
            (states, "The robots do not move."),
            (_arc(states, v, omega, 1.0), "The time step is missing: v and ω act for T_s."),
            (_arc(states, v * T, omega, 1.0), "The time step is missing: the heading turns by ω T_s."),
            (_arc(states, v / T, omega, T), "The time step is missing: the way is v T_s."),
            (_arc(states, v / T, omega, T, "old"), "The time step is missing: the way is v T_s."),
            (_arc(states, v, omega, T, turn=1 / T), "The time step is missing: the heading turns by ω T_s."),
            (_arc(states, v, omega, T, "old", 1 / T), "The time step is missing: the heading turns by ω T_s."),
            (y_without_T, "The time step is missing in y, as it is in the source's assignment."),
            (_arc(states, v, omega, T, turn=0.0), "The heading does not turn: add ω T_s."),
            (_arc(states, v, omega, T, "old", 0.0), "The heading does not turn: add ω T_s."),
            (_arc(states, v, -omega, T), "The robot turns to the wrong side: positive ω is counter-clockwise."),
            (_arc(states, v, omega, T, "old"), "Straight on along the old heading: the arc's chord is along θ + ωT/2."),
            (_arc(states, v, omega, T, "new"), "Along the new heading: the chord of the arc is along θ + ωT/2."),
            (_arc(states, v, omega, T, "half"), "The arc has length vT; its chord is shorter, by sin(ωT/2) / (ωT/2)."),
            (_arc(states, abs(v), omega, T), "A negative speed drives backwards."),
            (_arc(states, max(v, 0.0), omega, T), "A negative speed drives backwards: `reach` wants the way as a "
             "positive number, and the direction turned round."),
            (swapped, "cos and sin are swapped."),
            (degrees, "Headings are in radians."),
        ]  # fmt: skip
        expect.close(got, expected, call, faults, example=_example(states, expected, got), angles=True)
        _wrapped(got, call)


def _at_walls(function, constants):
    """Robots that touch a wall or nearly do, with every heading."""
    quiet = replace(constants, sigma_v=0.0, sigma_omega=0.0)
    states = models.anywhere(6000, constants, np.random.default_rng(4))
    room = polygons.clearance(np.ascontiguousarray(states[:, :2]), constants.walls) - constants.radius
    states = states[room < 0.3 * constants.Ts][:200]
    for v, turned in [
        (2.0, ""),
        (-2.0, ", and of a negative speed it wants the way positive and the direction turned"),
    ]:
        call = f"transition near walls, without noise, v = {v:g}, {words(constants)}"
        omega = 0.7
        got = _called(function, states, (v, omega), quiet, call)
        expected = models.transition(states, (v, omega), quiet, np.random.default_rng(0))
        through = _arc(states, v, omega, constants.Ts)
        blocked = np.abs(expected[:, :2] - through[:, :2]).max(axis=1) > 1e-12
        refused = np.where(
            models.free(through, constants)[:, None], through, np.column_stack([states[:, :2], through[:, 2]])
        )
        stuck = np.where(blocked[:, None], np.column_stack([states[:, :2], through[:, 2]]), through)
        point = models.transition(states, (v, omega), replace(quiet, radius=0.0, mount=0.0), np.random.default_rng(0))
        faults = [
            (through, f"The robots drive through the walls: go no farther than `reach` says{turned}."),
            (refused, "A blocked robot stops at contact: it goes as far as `reach` says, and here not at all."),
            (stuck, "A blocked robot stops at contact: it goes as far as `reach` says, and here not at all."),
            (point, "The robot is a disc: `reach` wants `constants.radius`."),
            (np.where(blocked[:, None], np.column_stack([expected[:, :2], states[:, 2]]), expected),
             "A blocked robot's heading goes on turning."),
        ]  # fmt: skip
        expect.close(got, expected, call, faults, example=_example(states, expected, got), angles=True)
        _wrapped(got, call)


def _noise(function, constants):
    """Read both noises back from where robots get to in a room without walls nearby."""
    constants = _hall(constants)
    T, v, omega = constants.Ts, 0.5, 0.4
    states = np.zeros((DRAWS, 3))
    states[:, 2] = np.linspace(-3.1, 3.1, DRAWS)
    call = f"transition of {DRAWS} robots, T_s = {T:g}, σ_v = {constants.sigma_v:g}, σ_ω = {constants.sigma_omega:.3g}"
    got = _called(function, states, (v, omega), constants, call, seed=5)
    turned = wrap(got[:, 2] - states[:, 2])
    direction = states[:, 2] + 0.5 * turned
    way = got[:, 0] * np.cos(direction) + got[:, 1] * np.sin(direction)
    aside = got[:, 1] * np.cos(direction) - got[:, 0] * np.sin(direction)
    assert np.abs(aside).max() < 1e-9, (
        f"The noise is on v and ω: the robot drives an arc with what it executes. Here it leaves the arc, by as "
        f"much as {np.abs(aside).max():.3g} m.\n{call}"
    )
    speeds, rates = way / (T * np.sinc(0.5 * turned / np.pi)), turned / T
    sigma_v, sigma_omega = constants.sigma_v, constants.sigma_omega
    for name, noise, sigma, other in [
        ("v", speeds - v, sigma_v, sigma_omega),
        ("ω", rates - omega, sigma_omega, sigma_v),
    ]:
        target = "way" if name == "v" else "heading"
        faults = [
            (0.0, f"{name} has no noise that differs from particle to particle: draw N numbers."),
            (1 / T, f"The noise on the {target} is too large: σ_{name} is that of {name}, which is multiplied by T_s."),
            (1 / np.sqrt(T), f"σ_{name} is drawn anew in each step and multiplied by T_s, not by its root."),
            (T, f"T_s acts twice: σ_{name} is that of {name}, not per time."),
            (np.sqrt(T), f"σ_{name} is the noise of {name} in a step: it is not multiplied by the root of T_s."),
            (sigma, f"σ_{name} is a standard deviation: it is squared here."),
            (sigma**-0.5, f"σ_{name} is the standard deviation, not the variance."),
            (other / sigma, "σ_v and σ_ω are swapped."),
            (180 / np.pi, f"σ_{name} is in radians: convert nothing."),
            (np.pi / 180, f"σ_{name} is in radians: convert nothing."),
            ((v if name == "v" else omega), f"The noise does not grow with {name}: add σ_{name} ε."),
            (1 / np.sqrt(3), "The noise is uniform: it is normal."),
        ]  # fmt: skip
        deviation = noise.std()
        table = f"{call}\nstandard deviation of the executed {name}: expected {sigma:.4g}, got {deviation:.4g}"
        if abs(deviation / sigma - 1) > 0.07:
            named = [text for ratio, text in faults if np.isclose(deviation, ratio * sigma, rtol=0.07, atol=1e-12)]
            raise AssertionError("\n".join([*named[:1], table]))
        assert abs(noise.mean()) < 6.5 * sigma / np.sqrt(DRAWS), (
            f"{call}: the noise of {name} has the mean {noise.mean():.3g}, expected 0"
        )
        assert kstest(noise / sigma, "norm").pvalue > RARE, f"{call}: the noise of {name} is not normal"
    related = abs(np.corrcoef(speeds, rates)[0, 1])
    assert related < 0.1, f"v and ω get the same noise (correlation {related:.2f}): draw one for each.\n{call}"
    _wrapped(got, call)
