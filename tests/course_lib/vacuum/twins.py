"""Array twins of the vacuum robots' kernels: the same algorithm without numba, one round of bounces at a time."""

import numpy as np


def drive_numpy(states, column, distance, room_x, room_y, v_bar, rng, path=None):
    """`course_lib.vacuum.models.drive` on arrays: the same arguments, the same draws, the same result up to rounding.

    Parameters
    ----------
    states, column, distance, room_x, room_y, v_bar, rng
        As in `drive`; `states` is changed in place.
    path : list, optional
        Where given, the positions (N, 2) after each round are appended to it, those at the start first: robot i
        drove straight from path[r][i] to path[r + 1][i].
    """
    x, y, heading = states[:, column : column + 3].T.copy()
    dx, dy = np.cos(heading), np.sin(heading)
    left = np.array(distance, dtype=float)
    if path is not None:
        path.append(np.column_stack([x, y]))
    while True:
        to_x, to_y = _to_wall(x, dx, room_x), _to_wall(y, dy, room_y)
        wall = np.minimum(to_x, to_y)
        # A robot that has stopped drives no further, whatever wall it touches.
        bounces = wall < left
        step = np.where(bounces, wall, left)
        x, y = np.clip(x + step * dx, 0.0, room_x), np.clip(y + step * dy, 0.0, room_y)
        on_x = bounces & (to_x <= to_y)
        x = np.where(on_x, np.where(dx > 0.0, room_x, 0.0), x)
        on_y = bounces & (to_x > to_y)
        y = np.where(on_y, np.where(dy > 0.0, room_y, 0.0), y)
        left = left - step
        if path is not None:
            path.append(np.column_stack([x, y]))
        if not bounces.any():
            break

        noise = np.zeros(len(x))
        noise[bounces] = v_bar * np.cbrt(2.0 * rng.random(np.count_nonzero(bounces)) - 1.0)
        # In a corner the wall across x comes first.
        across_x = ((x <= 0.0) & (dx < 0.0)) | ((x >= room_x) & (dx > 0.0))
        along, into = np.where(across_x, dy, dx), np.where(across_x, dx, dy)
        after = np.arctan2(np.abs(into), np.abs(along)) * (1.0 + noise)
        along = np.copysign(1.0, along) * np.cos(after)
        into = -np.copysign(1.0, into) * np.abs(np.sin(after))
        dx = np.where(bounces, np.where(across_x, into, along), dx)
        dy = np.where(bounces, np.where(across_x, along, into), dy)
        heading = np.where(bounces, np.arctan2(dy, dx), heading)
    states[:, column : column + 3] = np.column_stack([x, y, heading])


def _to_wall(position, direction, extent):
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ahead = np.where(direction > 0.0, (extent - position) / direction, -position / direction)
    return np.where(direction == 0.0, np.inf, ahead)
