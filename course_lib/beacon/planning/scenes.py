"""Random scenes: rooms to fly through, of a stated kind.

Every scene that is returned can be flown: on a grid of `CELL` the places that stay `ROOMY` away from everything, beyond
the vehicle's radius, connect start and goal. A vehicle that can hover can follow such a way as slowly as it likes.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import label

from course_lib.beacon.planning.obstacles import Scene

#: Side of a cell, and the room beside the vehicle along the way that is sure to exist, in metres.
CELL, ROOMY = 0.1, 0.2
#: Start and goal are that far from everything, beyond the radius, in metres.
FREE = 0.35
#: A passage is wider than the vehicle by a draw from this range, in metres.
PASSAGE = (0.6, 1.0)
#: Redrawings of a scene before it is given up.
MOST = 200


def random_scene(kind, rng, scene=None):
    """Draw a scene.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    rng : numpy.random.Generator
    scene : Scene
        Has everything but `obstacles`, `start` and `goal`, which are drawn; the default is `Scene()`.

    Returns
    -------
    Scene

    Raises
    ------
    ValueError
        No such kind, or `MOST` draws gave none that can be flown: the vehicle is too large for the room.
    """
    if kind not in KINDS:
        raise ValueError(f"no scene of kind {kind!r}: choose from {', '.join(KINDS)}")
    scene = scene or Scene()
    away = scene.radius + FREE
    for _ in range(MOST):
        # At opposite ends of the room along x, so that what stands between is in the way.
        ends = rng.uniform(-1.0, 1.0, (2, 3))
        ends[:, 0] = rng.permutation([-1.0, 1.0]) * rng.uniform(0.85, 1.0, 2)
        ends = ends * (np.array([scene.R, scene.R, scene.h]) / 2 - away) + [0.0, 0.0, scene.h / 2]
        boxes = KINDS[kind](scene, rng)
        beyond = np.maximum(np.maximum(boxes[:, None, :3] - ends, ends - boxes[:, None, 3:]), 0.0)
        boxes = boxes[np.all(np.linalg.norm(beyond, axis=2) > away, axis=1)]
        drawn = replace(
            scene,
            obstacles=tuple(map(tuple, boxes.tolist())),
            start=(*ends[0].tolist(), rng.uniform(-np.pi, np.pi)),
            goal=tuple(ends[1].tolist()),
        )
        if solvable(drawn):
            return drawn
    raise ValueError(f"{MOST} scenes of kind {kind!r} and none can be flown by a vehicle of radius {scene.radius} m")


def solvable(scene, clearance=ROOMY):
    """Whether there is a way from start to goal that stays farther than `clearance` beyond the radius from everything.

    Sure when it says so: the centres of free cells are free with half a cell to spare, and boxes grow to boxes, not to
    rounded ones. A way that needs a passage hardly wider than that may be missed.

    Parameters
    ----------
    scene : Scene
    clearance : float
        In metres.

    Returns
    -------
    bool
    """
    grow = scene.radius + clearance + CELL / 2
    lowest, highest = np.array([[-scene.R, -scene.R, 0.0], [scene.R, scene.R, 2 * scene.h]]) / 2
    axes = [np.arange(low, high + CELL / 2, CELL) for low, high in zip(lowest, highest, strict=True)]

    def inside(low, high):
        """The cells whose centres are in this box."""
        ends = np.transpose([low, high])
        return tuple(slice(*np.searchsorted(axis, pair)) for axis, pair in zip(axes, ends, strict=True))

    free = np.zeros([len(axis) for axis in axes], dtype=bool)
    free[inside(lowest + grow, highest - grow)] = True
    for box in scene.boxes:
        free[inside(box[:3] - grow, box[3:] + grow)] = False
    regions, _ = label(free)
    start, goal = (
        regions[tuple(np.abs(axis - value).argmin() for axis, value in zip(axes, place, strict=True))]
        for place in (scene.start[:3], scene.goal)
    )
    return bool(start != 0 and start == goal)


def _open(scene, rng):
    """Nothing in the way."""
    return np.empty((0, 6))


def _pillars(scene, rng):
    """Twelve to eighteen pillars from floor to ceiling."""
    count = rng.integers(12, 19)
    middle = rng.uniform(-0.5, 0.5, (count, 2)) * scene.R * [0.7, 1.0]
    half = rng.uniform(0.15, 0.5, (count, 2))
    floor = np.zeros((count, 1))
    return np.hstack([middle - half, floor, middle + half, floor + scene.h])


def _window(scene, rng):
    """A wall across the room with a window."""
    return _pierced(rng.uniform(-0.1, 0.1) * scene.R, scene, rng)


def _windows(scene, rng):
    """Two such walls."""
    return np.vstack([_pierced((side + rng.uniform(-0.3, 0.3)) * scene.R / 6, scene, rng) for side in (-1, 1)])


def _corridor(scene, rng):
    """Three walls across the room with doors at alternating sides."""
    side = rng.choice([-1.0, 1.0])
    walls = []
    for middle in (-0.2, 0.0, 0.2):
        x0 = middle * scene.R + rng.uniform(-0.2, 0.2)
        x1 = x0 + rng.uniform(0.2, 0.4)
        passage = 2 * scene.radius + rng.uniform(*PASSAGE)
        y1 = scene.R / 2 - rng.uniform(0.1, 1.0)
        for low, high in ((-scene.R / 2, y1 - passage), (y1, scene.R / 2)):
            y = sorted((side * low, side * high))
            walls.append((x0, y[0], 0.0, x1, y[1], scene.h))
        side = -side
    return np.array(walls)


def _clutter(scene, rng):
    """Seventy to a hundred boxes, most of them in the air."""
    count = rng.integers(70, 101)
    middle = rng.uniform(-0.5, 0.5, (count, 3)) * [0.7 * scene.R, scene.R, scene.h] + [0.0, 0.0, scene.h / 2]
    half = rng.uniform(0.15, 0.6, (count, 3))
    return np.hstack([middle - half, middle + half])


def _pierced(x0, scene, rng):
    """A wall with a window, as four boxes, shape (4, 6)."""
    x1 = x0 + rng.uniform(0.2, 0.4)
    width, height = 2 * scene.radius + rng.uniform(*PASSAGE, 2)
    side, h = scene.R / 2, scene.h
    y0 = rng.uniform(0.1 - side, side - width - 0.1)
    z0 = rng.uniform(0.1, h - height - 0.1)
    return np.array(
        [
            (x0, -side, 0.0, x1, y0, h),
            (x0, y0 + width, 0.0, x1, side, h),
            (x0, y0, 0.0, x1, y0 + width, z0),
            (x0, y0, z0 + height, x1, y0 + width, h),
        ]
    )


#: Kind of a scene to the function that draws its boxes.
KINDS = {
    "open": _open,
    "pillars": _pillars,
    "window": _window,
    "windows": _windows,
    "corridor": _corridor,
    "clutter": _clutter,
}
