"""What the checks of noise, bounces, prior and motion try, and the faults they know by name.

Statistical checks draw from fixed seeds and fail a right function with a probability of at most 1e-8.
"""

import itertools

import numpy as np
from scipy.stats import kstest

from course_lib.angles import wrap
from course_lib.vacuum import models
from course_lib.vacuum.constants import Constants
from grader.lessons import expect

RARE = 1e-9
OTHER_ROOM = Constants(L=3.0, Ts=0.2, v_bar=0.5, w_bar=0.4, s_bar=0.25, length=2.0)


def bounce_noise(function):
    """Against F, at both ends, in the middle, for every shape and at v̄ = 0."""
    p = np.array([0.0, 0.004, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0])
    for v_bar in (1.0, 0.5):
        call = f"bounce_noise(p, v_bar={v_bar})"
        with np.errstate(invalid="ignore"):
            got = function(p, v_bar)
        if isinstance(got, np.ndarray) and got.shape == p.shape and np.isnan(got[p < 0.5].astype(float)).all():
            raise AssertionError(
                f"{call} is nan for p < 1/2: NumPy does not take negative numbers to the power 1/3; use np.cbrt"
            )
        got = expect.array(got, p.shape, call)
        faults = [
            (v_bar * (2 * p - 1), "This is uniform noise: the cube root is missing, or takes only a part of 2p - 1."),
            (2 * p - 1, "This is uniform noise: the cube root is missing, or takes only a part of 2p - 1."),
            (np.cbrt(v_bar * (2 * p - 1)), "v_bar belongs in front of the cube root."),
            (np.cbrt(2 * p - 1), "The result does not depend on v_bar."),
            (np.cbrt(v_bar**3 * 2 * p) - v_bar, "The cube root must take all of 2p - 1."),
            (v_bar * np.cbrt(p), "The noise is never negative: f(v) has a half on either side of 0."),
            (v_bar * np.cbrt(1 - 2 * p), "The sign is wrong: F grows with v, and so does its inverse with p."),
            (v_bar * (2 * p - 1) ** 3, "This is the cube: the inverse takes the cube root."),
        ]
        expect.close(got, v_bar * np.cbrt(2 * p - 1), call, faults, example=lambda i: f"p = {p[i]}")
    expect.close(expect.array(function(p, 0.0), p.shape, "bounce_noise(p, 0.0)"), np.zeros(8), "bounce_noise(p, 0.0)")
    square = p.reshape(2, 4)
    expect.close(
        expect.array(function(square, 1.0), (2, 4), "bounce_noise(p of shape (2, 4), 1.0)"),
        np.cbrt(2 * square - 1),
        "bounce_noise(p of shape (2, 4), 1.0)",
    )


def bounce(function):
    """Mirror reflection at noise 0, the sheet's rule otherwise, at four walls and from either side."""
    walls = {0.0: "x = 0", np.pi / 2: "y = 0", np.pi: "the wall opposite x = 0", -np.pi / 2: "the wall opposite y = 0"}
    # Angles to the inward normal of a robot that drives into the wall, from either side; head-on has no side.
    off_normal = np.array([-3.1, -2.6, -2.0, -1.6, 1.6, 2.0, 2.6, 3.1])
    side, acute = np.sign(off_normal), np.abs(off_normal) - np.pi / 2
    for size in (0.0, 0.5, 1.0):
        for normal, wall in walls.items():
            heading = wrap(normal + off_normal)
            noise = size * np.array([1.0, -1.0, 0.3, -0.7, 1.0, -1.0, -0.3, 0.7])
            call = f"bounce off {wall} (normal = {normal:.4g})"
            got = expect.array(function(heading, normal, noise), heading.shape, call)
            mirrored = normal + side * (np.pi / 2 - acute)
            expected = normal + side * (np.pi / 2 - acute * (1 + noise))
            faults = [
                (heading, "The robot drives on into the wall: the heading is unchanged."),
                (heading + np.pi, "The robot turns back: a reflection keeps the direction along the wall."),
                (-expected, "The sign of the heading is wrong."),
                (normal - side * (np.pi / 2 - acute * (1 + noise)), "The robot leaves to the side it came from."),
                (mirrored, "The noise is not used: α⁺ = α⁻ (1 + v)."),
                (
                    normal + side * (np.pi / 2 - acute) * (1 + noise),
                    "The noise scales the angle to the wall, not the one to its normal.",
                ),
                (normal + side * (np.pi / 2 - acute * (1 - noise)), "α⁺ = α⁻ (1 + v), not α⁻ (1 - v)."),
                (mirrored + noise, "The noise is added: it scales the angle, α⁺ = α⁻ (1 + v)."),
                (normal + (np.pi / 2 - acute * (1 + noise)), "Right for robots that come from one side only."),
                (normal - (np.pi / 2 - acute * (1 + noise)), "Right for robots that come from one side only."),
            ]
            # On the circle first, so that a heading that is merely not wrapped gets its own message.
            expect.close(
                got,
                wrap(expected),
                call,
                faults,
                example=lambda i, h=heading, v=noise: f"heading = {h[i]:.3f}, noise = {v[i]:.2f}",
                angles=True,
            )
            outside = (got < -np.pi - 1e-12) | (got > np.pi + 1e-12)
            assert not outside.any(), f"{call}: {got[outside][0]:.4g} is not wrapped to [-π, π)"
    normals = np.repeat(list(walls), 2)
    heading = wrap(normals + np.tile([2.0, -2.6], 4))
    got = expect.array(function(heading, normals, np.full(8, 0.2)), (8,), "bounce with one normal per robot")
    side = np.tile([1.0, -1.0], 4)
    expected = normals + side * (np.pi / 2 - (np.tile([2.0, 2.6], 4) - np.pi / 2) * 1.2)
    expect.close(got, wrap(expected), "bounce with one normal per robot", angles=True)


def sample_prior(function):
    """Corners, their combinations, headings: where they may be, and how often."""
    n = 4000
    for constants in (Constants(), OTHER_ROOM):
        room = "the room of {:g} m x {:g} m".format(*constants.room)
        call = f"sample_prior({n}, constants, rng) in {room}"
        states = expect.array(function(n, constants, np.random.default_rng(1)), (n, 6), call)
        corner = np.empty((n, 2), dtype=int)
        for robot, name in enumerate("AB"):
            position = states[:, 3 * robot : 3 * robot + 2]
            apart = np.linalg.norm(position[:, None] - constants.sensors, axis=-1)
            corner[:, robot] = np.argmin(apart, axis=1)
            away = (apart.min(axis=1) > 1e-9) | (corner[:, robot] // 2 != robot)
            if away.any():
                sensors = constants.sensors[2 * robot : 2 * robot + 2].tolist()
                raise AssertionError(
                    f"{call}: robot {name} starts in the corner of S{2 * robot + 1} or S{2 * robot + 2}\n"
                    f"expected {tuple(sensors[0])} or {tuple(sensors[1])}, got {tuple(position[away][0].tolist())}"
                )
        counts = np.bincount(2 * corner[:, 0] + corner[:, 1] - 2, minlength=4)
        pairs = ", ".join(
            f"S{a} and S{b}: {c}" for (a, b), c in zip(itertools.product((1, 2), (3, 4)), counts, strict=True)
        )
        assert (counts > 0).all(), f"Not all four combinations of corners occur; draw A's and B's separately\n{pairs}"
        # Counts are binomial(n, 1/4): 6.5 standard deviations, two-sided, four times: 4e-10.
        assert (np.abs(counts - n / 4) < 6.5 * np.sqrt(n * 3 / 16)).all(), (
            f"The combinations of corners are not equally likely; of {n}\n{pairs}"
        )
        headings = states[:, [2, 5]]
        assert (np.abs(headings) <= np.pi + 1e-9).all(), (
            f"{call}: headings belong in [-π, π], got {headings.flat[np.argmax(np.abs(headings))]:.4g}"
        )
        into = np.array([np.pi / 2, -np.pi, -np.pi / 2, 0.0])[corner]
        quarter = (headings - into) / (np.pi / 2)
        out = (quarter < -1e-9) | (quarter > 1 + 1e-9)
        if out.any():
            i, robot = np.argwhere(out)[0]
            raise AssertionError(
                f"{call}: robot {'AB'[robot]} in the corner of S{corner[i, robot] + 1} drives out of the room\n"
                f"expected a heading in [{into[i, robot]:.4g}, {into[i, robot] + np.pi / 2:.4g}], "
                f"got {headings[i, robot]:.4g}"
            )
        for robot, name in enumerate("AB"):
            assert kstest(quarter[:, robot], "uniform").pvalue > RARE, (
                f"{call}: the headings of robot {name} are not uniform over the quarter of a circle they may have"
            )
        # Of independent uniforms, the correlation is normal with standard deviation n^(-1/2): 6.3 of these.
        assert abs(np.corrcoef(quarter.T)[0, 1]) < 0.1, "The headings of A and B depend on each other; draw both"
    expect.repeats(lambda rng: function(50, Constants(), rng), "sample_prior")


def drive(function):
    """Straight on; mirror images of the room at v̄ = 0; the law of the noise; never outside."""
    rng = np.random.default_rng(2)
    n = 400
    for room in (Constants(v_bar=0.0), Constants(L=3.0, length=2.0, v_bar=0.0)):
        x, y = rng.uniform(0.0, room.room[:, None], size=(2, n))
        heading = rng.uniform(-np.pi, np.pi, n)
        distance = rng.uniform(0.0, 2.5 * room.L, n)
        end_x, end_y, end_heading, bounces = _unfolded(x, y, heading, distance, room)
        where = "in a room of {:g} m x {:g} m, v̄ = 0".format(*room.room)
        got_x, got_y, got_heading = _driven(function, x, y, heading, distance, room, f"drive {where}")
        far_x, far_y = x + distance * np.cos(heading), y + distance * np.sin(heading)
        wall_x, wall_y = _first_wall(x, y, heading, distance, room)
        for count, words in enumerate(["without a bounce", "with one bounce", "with several bounces"]):
            rows = np.minimum(bounces, 2) == count
            positions = [np.column_stack([a, b])[rows] for a, b in [(got_x, got_y), (end_x, end_y)]]
            faults = [
                (x + 1j * y, "The robots do not move."),
                (x + distance * np.sin(heading) + 1j * (y + distance * np.cos(heading)), "cos and sin are swapped."),
                (far_x + 1j * far_y, "The robots drive through the walls."),
                (
                    np.clip(far_x, 0, room.room[0]) + 1j * np.clip(far_y, 0, room.room[1]),
                    "Positions are clamped to the room: what is left to drive after a bounce is lost.",
                ),
                (wall_x + 1j * wall_y, "The robots stop at the wall: what is left to drive after a bounce is lost."),
            ]
            if count == 2:
                faults.append((None, "Right for one bounce; bounce again until nothing is left to drive."))

            start, end, got = np.column_stack([x, y, heading, distance])[rows], positions[1], positions[0]

            def example(i, start=start, end=end, got=got):
                return "from ({:.3f}, {:.3f}), heading {:.3f}, {:.3f} m\n".format(
                    *start[i]
                ) + "expected ({:.3f}, {:.3f}), got ({:.3f}, {:.3f})".format(*end[i], *got[i])

            _same_positions(*positions, f"drive {words} {where}", faults, rows, example)
            turned = np.abs(wrap(got_heading - end_heading)[rows]) > 1e-6
            if turned.any():
                k = np.flatnonzero(rows)[np.argmax(turned)]
                raise AssertionError(
                    f"drive {words} {where}: the heading after it is wrong\nfrom heading {heading[k]:.3f}: "
                    f"expected {end_heading[k]:.3f}, got {got_heading[k]:.3f}"
                )
    _law_of_the_noise(function)
    for room in (Constants(), OTHER_ROOM):
        x, y = rng.uniform(0.0, room.room[:, None], size=(2, 2000))
        heading = rng.uniform(-np.pi, np.pi, 2000)
        distance = np.full(2000, 3.0 * room.L)
        ours = np.column_stack([x, y, heading])
        _driven(function, x, y, heading, distance, room, f"drive {3 * room.L:g} m with v̄ = {room.v_bar}")
        near = np.linspace(0.02, 0.3, 2000) * room.L
        x, y, heading, distance = near, near[::-1].copy(), np.full(2000, -2.2), np.full(2000, 1.5 * room.L)
        ours = np.column_stack([x, y, heading])
        got = _driven(function, x, y, heading, distance, room, f"drive into a corner with v̄ = {room.v_bar}")
        models.drive(ours, 0, distance, *room.room, room.v_bar, np.random.default_rng(12))
        for name, a, b in zip("xy", got, ours.T, strict=False):
            assert kstest(a, b).pvalue > RARE, (
                f"drive with several bounces near a corner, v̄ = {room.v_bar}: {name} is not distributed as it should; "
                "is fresh noise drawn at every bounce?"
            )


def _driven(function, x, y, heading, distance, constants, call):
    """Outcome of a drive, as arrays that lie in the room."""
    result = function(x, y, heading, distance, constants, np.random.default_rng(11))
    assert isinstance(result, (tuple, list, np.ndarray)) and len(result) == 3, (
        f"{call}: expected the three arrays x, y, heading, got {type(result).__name__}"
    )
    arrays = [
        expect.array(a, x.shape, f"{name} after {call}") for name, a in zip(("x", "y", "heading"), result, strict=True)
    ]
    if constants.v_bar:
        for name, values, side in zip("xy", arrays, constants.room, strict=False):
            out = (values < -1e-9) | (values > side + 1e-9)
            assert not out.any(), (
                f"{call}: {out.sum()} of {len(x)} robots leave the room, one to {name} = {values[out][0]:.3f}"
            )
    assert (np.abs(arrays[2]) <= np.pi + 1e-9).all(), (
        f"{call}: headings belong in [-π, π], got {max(arrays[2], key=abs):.3f}"
    )
    return arrays


def _unfolded(x, y, heading, distance, constants):
    """Where mirror walls send a robot: a straight line through mirror images of the room, folded back."""
    ends, bounces, directions = [], 0, []
    for start, direction, side in [
        (x, np.cos(heading), constants.room[0]),
        (y, np.sin(heading), constants.room[1]),
    ]:
        image = np.floor((start + distance * direction) / side).astype(int)
        inside = start + distance * direction - image * side
        ends.append(np.where(image % 2, side - inside, inside))
        directions.append(np.where(image % 2, -direction, direction))
        bounces = bounces + np.abs(image)
    return *ends, np.arctan2(directions[1], directions[0]), bounces


def _first_wall(x, y, heading, distance, constants):
    """Where a robot is that stops at the first wall."""
    dx, dy = np.cos(heading), np.sin(heading)
    to_x = np.where(dx > 0, constants.room[0] - x, -x) / dx
    to_y = np.where(dy > 0, constants.room[1] - y, -y) / dy
    way = np.minimum(distance, np.minimum(to_x, to_y))
    return x + way * dx, y + way * dy


def _same_positions(got, expected, call, faults, rows, example):
    apart = np.linalg.norm(got - expected, axis=1)
    off = apart > 1e-6
    if not off.any():
        return
    message = f"{call}: {example(np.argmax(apart))}"
    complex_got = got[:, 0] + 1j * got[:, 1]
    for wrong, name in faults:
        # A fault need not explain every robot: one that takes a wrong way meets other walls.
        if wrong is None or np.mean(np.abs(complex_got - wrong[rows])[off] < 1e-6) > 0.5:
            raise AssertionError(f"{name}\n{message}")
    raise AssertionError(message)


def _law_of_the_noise(function):
    """One bounce off each of two walls, from which the noise can be read back."""
    n, constants = 4000, Constants(v_bar=1.0)
    for turn, words in ((0.0, "the wall y = 0"), (-np.pi / 2, "the wall x = 0")):
        middle, near, heading = np.full(n, 2.5), np.full(n, 0.05), np.full(n, -0.7 + turn)
        x, y = (middle, near) if turn == 0.0 else (near, middle)
        call = f"drive with one bounce off {words}, v̄ = 1"

        def leave(rng, x=x, y=y, heading=heading):
            return function(x, y, heading, np.full(n, 0.1), constants, rng)

        expect.repeats(leave, "drive")
        _, _, after = _driven(function, x, y, heading, np.full(n, 0.1), constants, call)
        # α⁻ = 0.7, and either wall lies along the direction `turn`: a robot leaves at turn + 0.7 (1 + v).
        noise = wrap(after - turn) / 0.7 - 1.0
        assert np.ptp(noise) > 1e-6, (
            f"{call}: all {n} robots leave at the same angle; draw one noise for each bounce, `rng.random(number)`"
        )
        if kstest(noise, lambda v: np.clip((v**3 + 1) / 2, 0, 1)).pvalue < RARE:
            uniform = kstest(noise, lambda v: np.clip((v + 1) / 2, 0, 1)).pvalue > 1e-3
            raise AssertionError(
                f"{call}: the noise is not distributed as c v²{', but uniform' if uniform else ''}; "
                f"share with |v| < 1/2: expected 0.125, got {np.mean(np.abs(noise) < 0.5):.3f}"
            )
