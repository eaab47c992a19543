"""What the checks of one ray and of whole scans try, and the faults they know by name."""

from dataclasses import replace

import numpy as np

from course_lib.dr20 import models
from course_lib.dr20.constants import Constants
from course_lib.geometry import raycast
from grader.assignments.dr20.motion_checks import OTHER, words
from grader.lessons import expect


def _hits(x, y, angle, walls, behind="not", ends=True, choose=np.min):
    """Distance along rays by cross products, or what is taken for it; x, y, angle (...) against walls (S, 4)."""
    px, py = walls[:, 0] - x[..., None], walls[:, 1] - y[..., None]
    ex, ey = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    ux, uy = np.cos(angle)[..., None], np.sin(angle)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (px * ey - py * ex) / (ux * ey - uy * ex)
        s = (px * uy - py * ux) / (ux * ey - uy * ex)
        met = (s >= 0) & (s <= 1) if ends else np.isfinite(t)
        if behind == "not":
            met &= t >= 0
        t = np.abs(t) if behind == "as ahead" else t
    if choose is np.max:
        farthest = np.where(met, t, -np.inf).max(axis=-1)
        return np.where(met.any(axis=-1), farthest, np.inf)
    return np.where(met, t, np.inf).min(axis=-1)


def _ray_faults(x, y, angle, walls):
    """What faulty rays give, and their names."""
    yield _hits(x, y, angle, walls, "as ahead"), "Walls behind count: a wall is met only where t ≥ 0."
    yield _hits(x, y, angle, walls, "as negative"), "Walls behind count: a wall is met only where t ≥ 0."
    yield _hits(x, y, angle + np.pi, walls), "The ray goes backwards: it starts at (x, y) and goes along +(cos, sin)."
    yield -_hits(x, y, angle + np.pi, walls), "The sign: a wall ahead is at a positive distance."
    yield (
        _hits(x, y, angle, walls, ends=False),
        "Walls are taken as endless lines: the ray must meet them between their ends.",
    )
    yield _hits(x, y, angle, walls, "as ahead", False), "Walls are taken as endless lines, and those behind count."
    yield (
        _hits(x, y, angle, walls, choose=np.max),
        "The farthest wall on the ray is taken: the beam stops at the nearest.",
    )
    yield _hits(x, y, np.radians(angle), walls), "Angles are in radians: convert nothing."
    yield _hits(x, y, np.degrees(angle), walls), "Angles are in radians: convert nothing."
    yield _hits(x, y, np.pi / 2 - angle, walls), "cos and sin are swapped: angles count from the x-axis."
    yield _hits(x, y, -angle, walls), "The sign of the angle: counter-clockwise is positive."


def ray(function):
    """Rays in two rooms, and among walls that do not close: there some meet nothing."""
    rng = np.random.default_rng(6)
    apart = np.column_stack([rng.uniform(-3, 3, (6, 4))])
    for walls, room in [(Constants().walls, Constants()), (OTHER.walls, OTHER), (apart, None)]:
        poses = models.anywhere(60, room, rng) if room else rng.uniform(-3, 3, (60, 3))
        # Straight along the axes too: parallel to walls.
        poses[:6, 2] = [0.0, np.pi / 2, np.pi, -np.pi / 2, 0.0, np.pi]
        x, y, angle = poses.T
        call = f"ray(x, y, angle, walls of shape {walls.shape})"
        with np.errstate(all="ignore"):
            values = [function(float(a), float(b), float(c), walls) for a, b, c in poses]
        for value, pose in zip(values, poses, strict=True):
            one = "ray({:.3f}, {:.3f}, {:.3f}, walls)".format(*pose)
            number = (
                expect.array(np.nan if _is_nan(value) else value, (), one, kind="l") if not _is_nan(value) else None
            )
            assert number is not None, (
                f"{one}: got nan; a wall parallel to the ray divides by zero: it is not met, and where no wall is, the "
                "range is inf"
            )
        got = np.array([float(value) for value in values])
        expected = raycast.cast(poses[:, :2], angle[:, None], walls)[:, 0]
        nothing = np.isinf(expected) & np.isfinite(got)
        if nothing.any() and np.allclose(got[~nothing], expected[~nothing]):
            raise AssertionError(f"{call}: expected inf where there is no wall, got {got[nothing][0]:g}")

        def example(i, poses=poses):
            return "x = {:.3f}, y = {:.3f}, angle = {:.3f}".format(*poses[i])

        expect.close(got, expected, call, _ray_faults(x, y, angle, walls), example=example)


def _is_nan(value):
    try:
        return bool(np.isnan(value))
    except (TypeError, ValueError):
        return False


def scan(function):
    """All beams of many robots, where beams, mount and walls are not the default ones too."""
    # The default beams are symmetric and start at the axle: the others tell more.
    for constants in (OTHER, Constants()):
        states = models.anywhere(200, constants, np.random.default_rng(7))
        bearings = np.asarray(constants.bearings)
        shape = (len(states), len(bearings))
        call = f"distances(states {states.shape}, constants) {words(constants)}"
        with np.errstate(all="ignore"):
            got = function(states, constants)
        if isinstance(got, np.ndarray) and got.shape == shape and got.dtype.kind == "f" and np.isnan(got).any():
            raise AssertionError(
                f"{call}: got nan; a wall parallel to a ray divides by zero: it is not met, and where no wall is, the "
                "range is inf"
            )
        assert not (isinstance(got, np.ndarray) and got.shape == shape[::-1]), (
            f"{call}: expected shape {shape}, a row for each robot; got {shape[::-1]}"
        )
        got = expect.array(got, shape, call, kind="l")
        expected = models.distances(states, constants)

        def example(i, states=states):
            return "robot at ({:.3f}, {:.3f}), heading {:.3f}".format(*states[i])

        expect.close(got, expected, call, _scan_faults(states, constants, expected), example=example)


def _scan_faults(states, constants, expected):
    """What faulty scans give, and their names."""
    bearings = np.asarray(constants.bearings)
    x, y, heading = states.T

    def scanned(angles, ahead=constants.mount, along=None, walls=constants.walls, **change):
        along = heading[:, None] if along is None else along
        start = x[:, None] + ahead * np.cos(along), y[:, None] + ahead * np.sin(along)
        start = [np.broadcast_to(part, angles.shape) for part in start]
        return _hits(*start, angles, walls, **change)

    angles = heading[:, None] + bearings
    if constants.mount:
        yield scanned(angles, 0.0), "The mount is ignored: beams start `constants.mount` ahead of the axle's centre."
        yield scanned(angles, -constants.mount), "The mount is ahead of the axle's centre, not behind it."
        yield scanned(angles, along=angles), "The mount is ahead along the heading, not along each beam."
        yield scanned(angles, along=0 * heading[:, None]), "The mount turns with the robot: ahead is along the heading."
    yield expected[:, ::-1], "The beams are in the wrong order: as in `constants.bearings`."
    yield (
        scanned(heading[:, None] - bearings),
        "The beams are mirrored: bearings count counter-clockwise from the heading.",
    )
    yield scanned(heading[:, None] + np.radians(bearings)), "Bearings are in radians: convert nothing."
    yield scanned(heading[:, None] + np.degrees(bearings)), "Bearings are in radians: convert nothing."
    yield scanned(np.radians(heading[:, None]) + bearings), "Headings are in radians: convert nothing."
    yield scanned(0 * heading[:, None] + bearings), "The heading is ignored: a beam's direction is heading + bearing."
    yield scanned(-heading[:, None] + bearings), "The sign of the heading: a beam's direction is heading + bearing."
    yield scanned(np.pi / 2 - angles), "cos and sin are swapped: angles count from the x-axis."
    yield scanned(angles + np.pi), "The rays go backwards: they start at the sensor and go along +(cos, sin)."
    yield scanned(angles, behind="as ahead"), "Walls behind count: a wall is met only where t ≥ 0."
    yield scanned(angles, behind="as negative"), "Walls behind count: a wall is met only where t ≥ 0."
    yield scanned(angles, ends=False), "Walls are taken as endless lines: a ray must meet them between their ends."
    outline = len(constants.room)
    yield (
        scanned(angles, walls=constants.walls[:outline]),
        "Only the room's outline is met: `constants.walls` has all walls.",
    )
    yield (
        scanned(angles, walls=constants.walls[outline:]),
        "Only the obstacles are met: `constants.walls` has all walls.",
    )
    yield scanned(angles, choose=np.max), "The farthest wall on each ray is taken: a beam stops at the nearest."
    reason = "These are the distances to the walls, however far: what is beyond r_max is for the likelihood to say."
    yield np.where(expected > constants.r_max, np.inf, expected), reason
    yield np.minimum(expected, constants.r_max), reason
    if constants.room == OTHER.room:
        default = replace(Constants(), bearings=constants.bearings)
        yield (
            models.distances(states, default),
            "The numbers are those of the default constants: read all from `constants`.",
        )
        yield (
            scanned(angles, walls=default.walls),
            "The walls are those of the default constants: read `constants.walls`.",
        )
