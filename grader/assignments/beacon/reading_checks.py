"""What the checks of the observation's Jacobian and of the innovation try, and the faults they know by name."""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import models
from course_lib.beacon.constants import BEARINGS, MEASURED, Constants
from grader.assignments.beacon.expect import OTHER, READINGS, STATE, room, same, states
from grader.lessons import expect


def observation_jacobian(function):
    """Entry by entry, in all four quarters of the room."""
    for constants in (Constants(), OTHER):
        for state in states(8, constants, np.random.default_rng(3)):
            call = f"observation_jacobian(state at ({state[0]:.2f}, {state[1]:.2f}, {state[2]:.2f}), constants) "
            call += room(constants)
            got = expect.array(function(state, constants), (MEASURED, 12), call)
            same(
                got,
                models.observation_jacobian(state, constants),
                call,
                _jacobian_faults(state, constants),
                entry=lambda at: f"∂{READINGS[at[0]]}/∂{STATE[at[1]]}",
                tolerance=1e-5,
            )


def _jacobian_faults(state, constants):
    right = models.observation_jacobian(state, constants)
    ranges, bearings = np.arange(4), np.arange(4, 8)
    offset = constants.beacons - state[:3]
    level = np.hypot(offset[:, 0], offset[:, 1])
    slant = np.linalg.norm(offset, axis=1)

    def changed(*changes):
        H = right.copy()
        for rows, columns, values in changes:
            H[rows, columns] = values
        return H

    yield (
        changed((bearings, 5, 0.0)),
        "The θ column is missing: α counts from the heading, so ∂α/∂θ = -1. Without it yaw is never corrected.",
    )
    yield changed((bearings, 5, 1.0)), "The sign of ∂α/∂θ: turn left, and the beacon moves to your right."
    yield (
        changed((slice(0, 4), slice(0, 3), -right[:4, :3])),
        "The sign of ∂ρ/∂(x, y, z): towards the beacon ρ shrinks.",
    )
    yield (
        changed((slice(0, 4), slice(0, 2), -np.abs(right[:4, :2])), (BEARINGS, slice(0, 2), _magnitudes(right))),
        "The signs at the far corners are those of beacon 1: keep the signs of b - p.",
    )
    yield (
        changed((slice(0, 4), slice(0, 2), -np.abs(right[:4, :2]))),
        "∂ρ/∂(x, y) at the far corners has the signs of beacon 1: keep those of b - p.",
    )
    turned = -right[4:8, :2]
    yield changed((BEARINGS, slice(0, 2), turned)), "The sign of ∂α/∂(x, y)."
    yield (
        changed((BEARINGS, slice(0, 2), turned), (bearings, 5, 1.0)),
        "All signs of the bearings' rows: this is the derivative of -α.",
    )
    yield changed((BEARINGS, slice(0, 2), right[4:8, [1, 0]])), "∂α/∂x and ∂α/∂y are swapped."
    yield (
        changed((slice(0, 4), 2, 0.0)),
        "∂ρ/∂z is missing: ρ is the slant range.",
    )
    yield (
        changed((slice(0, 4), slice(0, 2), -offset[:, :2] / level[:, None]), (slice(0, 4), 2, 0.0)),
        "These are derivatives of ρ_xy: the reading is the slant range ρ.",
    )
    yield (
        changed((slice(0, 4), slice(0, 3), -offset / level[:, None])),
        "∂ρ/∂p = -(b - p)/ρ: divide by the slant range, not by ρ_xy.",
    )
    yield (
        changed((BEARINGS, slice(0, 2), right[4:8, :2] * (level / slant)[:, None] ** 2)),
        "∂α/∂(x, y) has ρ_xy² below: the bearing is horizontal.",
    )
    yield (
        changed((BEARINGS, slice(0, 2), right[4:8, :2] * level[:, None])),
        "∂α/∂(x, y) has the square of ρ_xy below.",
    )
    yield changed((8, 2, 0.0)), "The altitude's row is missing: ∂a/∂z = 1."
    yield changed((8, 2, -1.0)), "The sign of ∂a/∂z: this is h/2 - a; the reading is a."
    yield changed((bearings, 5, -np.pi / 180)), "Angles are in radians."
    yield changed((bearings, 5, 0.0), (bearings, 3, -1.0)), "The heading θ is column YAW; this one is the roll φ."
    yield right[[0, 4, 1, 5, 2, 6, 3, 7, 8]], "The rows' order is ρ₁...ρ₄, α₁...α₄, a."
    yield -right, "This is the derivative of minus the reading."
    positions = np.zeros((MEASURED, 12))
    positions[ranges * 2, 0] = positions[ranges * 2 + 1, 1] = positions[8, 2] = 1.0
    yield positions, "This is the source's H, of positions: here the readings are ρ, α and a themselves."
    if constants != Constants():
        yield (
            models.observation_jacobian(state, Constants()),
            "R and h are those of the default room: read them from `constants`.",
        )


def _magnitudes(H):
    """Rows of the bearings with the signs of beacon 1."""
    return np.abs(H[4:8, :2]) * [1, -1]


def innovation(function):
    """With a bearing on each side of the seam, readings of all kinds missing, ranges larger than π."""
    for constants in (Constants(), OTHER):
        rng = np.random.default_rng(4)
        for n, state in enumerate(states(30, constants, rng)):
            predicted = models.observe(state[None], constants)[0]
            observation = np.append(predicted + 2 * constants.sigma_z * rng.standard_normal(MEASURED), [np.inf, np.inf])
            if n == 5:
                # Far off, as a filter is that has lost track.
                observation[:4] += [4.0, -5.0, 0.0, 6.0]
            if n < 4:
                # Beacon n is straight behind: its reading lies beyond the seam.
                state[5] = wrap(state[5] + predicted[4 + n] - np.pi + 0.01)
                predicted = models.observe(state[None], constants)[0]
                observation[BEARINGS] = predicted[BEARINGS] + constants.sigma_alpha
                observation[4 + n] = wrap(predicted[4 + n] + 0.05)
            observation[BEARINGS] = wrap(observation[BEARINGS])
            observation[:8][rng.random(8) < (0.2 if n > 10 else 0.0)] = np.inf
            missing = np.flatnonzero(np.isinf(observation[:MEASURED]))
            call = f"innovation(observation, state, constants) {room(constants)}"
            got = _with_gaps(function(observation, state, constants), missing, call)
            v = models.innovation(observation, predicted)
            same(
                got,
                v,
                call,
                _innovation_faults(observation, predicted, state, constants, v),
                entry=lambda at, z=observation, p=predicted: (
                    f"{READINGS[at[0]]}, read as {z[at[0]]:.4f} where {p[at[0]]:.4f} is expected"
                ),
                angles=range(4, 8),
            )
            turned = np.flatnonzero(np.abs(got[BEARINGS]) > np.pi + 1e-9)
            if len(turned):
                at = 4 + turned[0]
                raise AssertionError(
                    "The difference of two bearings is not wrapped: a beacon straight behind seems to have gone around."
                    f"\n{call}\n{READINGS[at]}, read as {observation[at]:.4f} where {predicted[at]:.4f} is expected: "
                    f"expected {v[at]:.4f}, got {got[at]:.4f}"
                )


def _with_gaps(value, missing, call):
    """The value as an array (9,), NaN where a reading is missing and nowhere else."""
    assert value is not None, f"{call} returns None: is there a `return`?"
    array = np.asarray(value) if not isinstance(value, list | tuple) else np.array(value, dtype=object)
    assert array.shape != (11,), (
        f"{call}: expected shape (9,), got (11,): the obstacle's r and β say nothing about the beacons"
    )
    filled = np.isin(np.arange(MEASURED), missing)
    if array.shape == (MEASURED,) and array.dtype.kind == "f":
        for wrong, words in ((np.isinf, "inf"), (lambda v: v == 0, "0"), (np.isfinite, "a number")):
            if filled.any() and wrong(array[filled]).any():
                raise AssertionError(
                    f"A missing reading (inf) gives an innovation of {words}: it says nothing, so return NaN there.\n"
                    f"{call}: {', '.join(READINGS[i] for i in missing)} missing"
                )
        lost = np.isnan(array) & ~filled
        assert not lost.any(), f"{call}: NaN for {READINGS[np.argmax(lost)]}, which is there"
        array = np.where(filled, 0.0, array)
    result = expect.array(array, (MEASURED,), call)
    return np.where(filled, np.nan, result)


def _innovation_faults(observation, predicted, state, constants, v):
    yield -v, "The sign: observed minus predicted."
    yield wrap(v), "Only bearings are angles: ranges and altitude must not be wrapped."
    behind = v.copy()
    behind[BEARINGS] -= state[5]
    yield behind, "θ is missing in the predicted bearing: atan2(b_y - y, b_x - x) - θ."
    forward = v.copy()
    forward[BEARINGS] -= 2 * state[5]
    yield forward, "The sign of θ in the predicted bearing: atan2(b_y - y, b_x - x) - θ."
    z = observation[:MEASURED]
    yield np.where(np.isfinite(z), z, np.nan), "This is the observation: subtract what is expected at `state`."
    level = v.copy()
    offset = constants.beacons - state[:3]
    level[:4] = v[:4] + predicted[:4] - np.hypot(offset[:, 0], offset[:, 1])
    yield level, "The expected range is the slant range: the beacon is at half height."
    floor = v.copy()
    floor[:4] = v[:4] + predicted[:4] - np.hypot(np.hypot(offset[:, 0], offset[:, 1]), state[2])
    yield floor, "The beacon is at half height: h/2 - z above the vehicle."
    degrees = v.copy()
    degrees[BEARINGS] = np.degrees(v[BEARINGS])
    yield degrees, "Bearings are in radians."
    if constants != Constants():
        yield (
            models.innovation(observation, models.observe(state[None], Constants())[0]),
            "R and h are those of the default room: read them from `constants`.",
        )
