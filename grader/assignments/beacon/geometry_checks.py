"""What the checks of question 1 try, the geometry of one beacon and of an obstacle, and the faults they know."""

import warnings

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import models
from course_lib.beacon.constants import MEASURED, Constants
from grader.assignments.beacon.expect import OTHER, room, same, states
from grader.lessons import expect

#: Signs of the four corners, beacon by beacon.
CORNERS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def horizontal_range(function):
    """Against Pythagoras, where the root's argument is negative too, for every shape."""
    note = None
    for h in (4.0, 3.0):
        rho = np.array([5.0, 3.0, 2.5, 1.5, 1.2, 0.8, 7.0, 0.0])
        a = np.array([0.5, 2.6, 1.9, 0.6, 0.4 * h, h - 0.3, -0.1, h / 2])
        up = h / 2 - a
        expected = np.sqrt(np.maximum(rho**2 - up**2, 0.0))
        short = rho <= np.abs(up)
        call = f"horizontal_range(rho, a, h={h:g})"
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            got = function(rho, a, h)
        if caught:
            note = "Right, though it warns: take the larger of 0 and the difference before the root, not after."
        if _all_nan(got, rho < np.abs(up)):
            i = np.argmax(rho < np.abs(up))
            raise AssertionError(
                "The root has no guard: a noisy range may be shorter than the way up to the beacon. Return 0 there.\n"
                f"{call}: rho = {rho[i]:g}, a = {a[i]:g}: got nan"
            )
        got = expect.array(_without_missing(got, short), rho.shape, call)
        with np.errstate(invalid="ignore"):
            guarded = [
                (np.sqrt(np.maximum(rho**2 - a**2, 0.0)), "The beacon is at half height: it is h/2 - a above you."),
                (np.sqrt(np.maximum(rho**2 - (h - a) ** 2, 0.0)), "The beacon is at half height, h/2, not at h."),
                (np.sqrt(np.maximum(rho**2 - (h / 2 + a) ** 2, 0.0)), "The way up is the difference h/2 - a."),
                (np.sqrt(rho**2 + up**2), "ρ is the longest side of the triangle: subtract the square of the other."),
                (np.maximum(rho**2 - up**2, 0.0), "This is the square: take its root."),
                (np.maximum(rho - np.abs(up), 0.0), "Subtract squares, then take the root."),
                (np.sqrt(np.abs(rho**2 - up**2)), "Where the difference is negative return 0, not its absolute root."),
                (np.sqrt(np.maximum(rho**2 - np.abs(up), 0.0)), "h/2 - a is not squared."),
                (rho, "This is the range itself: project it into the horizontal plane."),
            ]
        expect.close(got, expected, call, guarded, example=lambda i, r=rho, a=a: f"rho = {r[i]:g}, a = {a[i]:g}")
    expect.close(
        expect.array(function(5.0, 1.0, 4.0), (), "horizontal_range(5.0, 1.0, 4.0)"),
        np.sqrt(24.0),
        "horizontal_range(5.0, 1.0, 4.0)",
    )
    rho = np.array([[2.0, 3.0, 4.0], [5.0, 6.0, 7.0]])
    call = "horizontal_range(rho of shape (2, 3), 1.0, 4.0)"
    expect.close(expect.array(function(rho, 1.0, 4.0), (2, 3), call), np.sqrt(rho**2 - 1.0), call)
    return note


def _all_nan(got, where):
    try:
        return bool(np.isnan(np.asarray(got, dtype=float)[where]).all())
    except (TypeError, ValueError, IndexError):
        return False


def _without_missing(got, short):
    """0 where the answer to a range that is too short is `inf`: the course's sign for what is not there."""
    if isinstance(got, np.ndarray) and got.ndim and got.dtype.kind == "f" and len(got) == len(short):
        return np.where(short.reshape(-1, *[1] * (got.ndim - 1)) & np.isposinf(got), 0.0, got)
    return got


def corner_position(function):
    """Each corner, with readings as they come: bearings of every direction, a range that is too short among them."""
    n = 40
    for constants in (Constants(), OTHER):
        rng = np.random.default_rng(1)
        truth = states(n, constants, rng)
        z = models.observe(truth, constants) + constants.sigma_z * rng.standard_normal((n, MEASURED))
        theta, a = truth[:, 5], z[:, 8]
        for beacon in range(4):
            rho, alpha = z[:, beacon].copy(), wrap(z[:, 4 + beacon])
            rho[0] = 0.9 * abs(constants.h / 2 - a[0])
            call = f"corner_position({beacon}, rho, alpha, a, theta, constants) {room(constants)}"
            got = function(beacon, rho, alpha, a, theta, constants)
            missing = isinstance(got, np.ndarray) and got.shape == (n, 3) and np.isposinf(got[0].astype(float)).all()
            expected = _seen_from(beacon, rho, alpha, a, theta, constants)
            got = expect.array(np.vstack([expected[:1], got[1:]]) if missing else got, (n, 3), call)
            same(
                got,
                expected,
                call,
                _corner_faults(beacon, rho, alpha, a, theta, constants),
                entry=lambda at, r=rho, b=alpha, a=a, t=theta: (
                    f"rho = {r[at[0]]:.3f}, alpha = {b[at[0]]:.3f}, a = {a[at[0]]:.3f}, theta = {t[at[0]]:.3f}: "
                    f"{'xyz'[at[1]]}"
                ),
            )
            call = f"corner_position({beacon}, four numbers, constants)"
            one = [float(values[1]) for values in (rho, alpha, a, theta)]
            got = expect.array(function(beacon, *one, constants), (3,), call)
            same(got, _seen_from(beacon, *one, constants), call)


def _seen_from(
    beacon, rho, alpha, a, theta, constants, corner=None, sign=-1.0, project=True, swap=False, angle=None, z=None
):
    """The vehicle's position by one beacon, or what a fault makes of it."""
    ground = np.sqrt(np.maximum(rho**2 - (constants.h / 2 - a) ** 2, 0.0)) if project else rho
    corner = constants.R / 2 * CORNERS[beacon] if corner is None else corner
    angle = theta + alpha if angle is None else angle
    along = (np.sin(angle), np.cos(angle)) if swap else (np.cos(angle), np.sin(angle))
    x, y = corner[0] + sign * ground * along[0], corner[1] + sign * ground * along[1]
    return np.stack([x, y, a if z is None else z + 0.0 * a], axis=-1)


def _corner_faults(beacon, rho, alpha, a, theta, constants):
    def fault(**change):
        return _seen_from(beacon, rho, alpha, a, theta, constants, **change)

    half, own = constants.R / 2, CORNERS[beacon]
    yield fault(project=False), "The slant range ρ is used: project it first, ρ_xy = horizontal_range(ρ, a, h)."
    yield fault(sign=1.0), "The vehicle is ρ_xy away from the corner against the bearing: subtract."
    yield (
        fault(angle=alpha),
        "θ is missing: the bearing counts from the vehicle's heading, so θ + α points to the beacon.",
    )
    yield fault(angle=theta), "The bearing α is missing: θ + α points to the beacon."
    yield fault(angle=theta - alpha), "The sign of the bearing: it is counter-clockwise, θ + α."
    yield fault(angle=alpha - theta), "The sign of the heading: θ + α points to the beacon."
    yield fault(swap=True), "cos and sin are swapped: x goes with the cosine."
    yield fault(angle=np.radians(theta + alpha)), "Angles are in radians already."
    yield fault(angle=np.degrees(theta + alpha)), "np.cos and np.sin take radians."
    yield fault(corner=2 * half * own), "The corners are at ±R/2: the origin is at the room's centre."
    for i, signs in enumerate(CORNERS):
        if i != beacon:
            yield (
                fault(corner=half * signs),
                f"The sign of the corner: beacon {beacon} (the source's {beacon + 1}) is at ({own[0]:+d}, {own[1]:+d}) "
                f"times R/2, this is ({signs[0]:+d}, {signs[1]:+d}).",
            )
    yield fault(corner=np.zeros(2)), "The corner is missing: start at the beacon's ±R/2."
    yield fault(z=constants.h / 2), "z is the vehicle's altitude a, not the beacon's."
    yield fault(z=0.0), "z is the altitude a."
    if constants != Constants():
        yield (
            _seen_from(beacon, rho, alpha, a, theta, Constants()),
            "R and h are those of the default room: read them from `constants`.",
        )


def obstacle_point(function):
    """Points around vehicles of every heading and tilt."""
    rng = np.random.default_rng(2)
    for state in states(12, Constants(), rng):
        r, beta = rng.uniform(0.3, 3.0), rng.uniform(-np.pi, np.pi)
        call = f"obstacle_point(state, r={r:.3f}, beta={beta:.3f}) at θ = {state[5]:.3f}"
        got = expect.array(function(state, r, beta), (3,), call)
        theta = state[5]

        def point(angle, r=r, origin=state[:3], swap=False):
            along = np.array([np.cos(angle), np.sin(angle), 0.0])
            return origin + r * (along[[1, 0, 2]] if swap else along)

        same(
            got,
            point(theta + beta),
            call,
            [
                (point(beta), "The heading θ is missing: β counts from it."),
                (point(theta), "The bearing β is missing."),
                (point(theta - beta), "The sign of the bearing: θ + β."),
                (point(beta - theta), "The sign of the heading: θ + β."),
                (point(theta + beta, -r), "The obstacle lies in the direction of the bearing: add."),
                (point(theta + beta, swap=True), "cos and sin are swapped: x goes with the cosine."),
                (point(theta + beta, origin=np.zeros(3)), "The vehicle's position is missing."),
                (point(theta + beta) * [1, 1, 0], "z is the vehicle's: the sensor looks level."),
                (point(state[3] + beta), "This is the roll φ; the heading θ is column YAW of the state."),
                (point(state[4] + beta), "This is the pitch ϑ; the heading θ is column YAW of the state."),
                (point(np.radians(theta + beta)), "Angles are in radians already."),
                (point(np.degrees(theta + beta)), "np.cos and np.sin take radians."),
            ],
            entry=lambda at: "xyz"[at[0]],
        )
