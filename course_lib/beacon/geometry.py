"""Question 1: from ranges and bearings to a position, and from a position to an obstacle; each with its Jacobian.

Everything broadcasts. What is not there, or has no answer, is `inf`, as a missing reading is. θ is the yaw. Readings
are taken to be horizontal bearings and a range that the altitude makes horizontal, so roll and pitch do not enter.
"""

import numpy as np

#: Signs of x and y of beacons 1 to 4, shape (4, 2): the corners (+, +), (-, +), (-, -), (+, -).
SIGNS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


def horizontal_range(rho, a, h):
    """Horizontal distance to a beacon at half height.

    Where ρ is shorter than the height that it has to bridge, noise has made it so and there is no distance. The source
    takes the root all the same (NaN). A distance of zero in its place would be a reading too, and a wrong one: it puts
    the vehicle under the beacon, with an error whose linearisation has no bound. So the pair counts as missing.

    Parameters
    ----------
    rho : array_like
        Range ρ in metres; `inf` where missing.
    a : array_like
        Altitude above the floor in metres.
    h : float
        Height of the room in metres.

    Returns
    -------
    ndarray or float
        √(ρ² - (h/2 - a)²) in metres; `inf` where the root is not positive.
    """
    with np.errstate(invalid="ignore"):
        square = np.square(rho) - np.square(h / 2 - np.asarray(a))
    return np.sqrt(np.where(square > 0.0, square, np.inf))


def horizontal_range_jacobian(rho, a, h):
    """∂ρ_xy/∂(ρ, a), shape (..., 2); parameters as in `horizontal_range`, NaN where that has no answer.

    Grows without bound as the vehicle comes under the beacon: ∂ρ_xy/∂ρ = ρ / ρ_xy.
    """
    rho, rise = np.broadcast_arrays(np.asarray(rho, dtype=float), h / 2 - np.asarray(a, dtype=float))
    with np.errstate(invalid="ignore"):
        slopes = np.stack([rho, rise], axis=-1) / horizontal_range(rho, a, h)[..., None]
    return np.where(np.isfinite(horizontal_range(rho, a, h))[..., None], slopes, np.nan)


def position(corner, rho, alpha, a, yaw, constants):
    """Where the vehicle is, by the range and bearing of one beacon, its altitude and its yaw.

    Parameters
    ----------
    corner : array_like of int
        Beacon, 0 to 3; `range(4)` for all at once.
    rho, alpha : array_like
        Its range ρ in metres and its bearing α in radians; `inf` where missing.
    a, yaw : array_like
        Altitude in metres, θ in radians.
    constants : Constants

    Returns
    -------
    ndarray, shape (..., 3)
        x = ±R/2 - ρ_xy cos(θ + α), y = ±R/2 - ρ_xy sin(θ + α), z = a, the signs those of the corner; `inf` in all
        three where a reading is missing or ρ_xy has no answer.
    """
    reach, direction = horizontal_range(rho, a, constants.h), np.add(alpha, yaw)
    there = np.isfinite(reach) & np.isfinite(direction)
    reach, direction = np.where(there, reach, 0.0), np.where(there, direction, 0.0)
    center = constants.R / 2 * SIGNS[np.asarray(corner)]
    x = center[..., 0] - reach * np.cos(direction)
    y = center[..., 1] - reach * np.sin(direction)
    return np.where(there[..., None], np.stack(np.broadcast_arrays(x, y, a), axis=-1), np.inf)


def position_jacobian(corner, rho, alpha, a, yaw, constants):
    """∂(x, y, z)/∂(ρ, α, a, θ) of `position`.

    Parameters
    ----------
    corner, rho, alpha, a, yaw, constants
        As in `position`. The corner moves the result and not its slopes.

    Returns
    -------
    ndarray, shape (..., 3, 4)
        NaN where there is no position.
    """
    _, rho, alpha, a, yaw = np.broadcast_arrays(corner, rho, alpha, a, yaw)
    reach, direction = horizontal_range(rho, a, constants.h), alpha + yaw
    there = np.isfinite(reach) & np.isfinite(direction)
    reach, direction = np.where(there, reach, np.nan), np.where(there, direction, np.nan)
    cos, sin = np.cos(direction), np.sin(direction)
    by_rho, by_a = np.moveaxis(horizontal_range_jacobian(rho, a, constants.h), -1, 0)
    zero, one = np.zeros_like(reach), np.ones_like(reach)
    jacobian = [
        [-by_rho * cos, reach * sin, -by_a * cos, reach * sin],
        [-by_rho * sin, -reach * cos, -by_a * sin, -reach * cos],
        [zero, zero, one, zero],
    ]
    jacobian = np.moveaxis(np.array(jacobian), (0, 1), (-2, -1))
    return np.where(there[..., None, None], jacobian, np.nan)


def obstacle(pose, r, beta):
    """The point that the obstacle sensor sees, in the world frame.

    Parameters
    ----------
    pose : array_like, shape (..., 4)
        x, y, z in metres and θ in radians.
    r, beta : array_like
        Horizontal range in metres and bearing in radians; `inf` when nothing is in sight.

    Returns
    -------
    ndarray, shape (..., 3)
        x + r cos(θ + β), y + r sin(θ + β), z; `inf` in all three when nothing is in sight.
    """
    x, y, z, yaw = np.moveaxis(np.asarray(pose, dtype=float), -1, 0)
    there = np.isfinite(r) & np.isfinite(beta)
    r, direction = np.where(there, r, 0.0), yaw + np.where(there, beta, 0.0)
    point = np.broadcast_arrays(x + r * np.cos(direction), y + r * np.sin(direction), z)
    return np.where(there[..., None], np.stack(point, axis=-1), np.inf)


def obstacle_jacobian(pose, r, beta):
    """∂/∂(x, y, z, θ, r, β) of `obstacle`.

    Parameters
    ----------
    pose, r, beta
        As in `obstacle`.

    Returns
    -------
    ndarray, shape (..., 3, 6)
        NaN when nothing is in sight. With J = [J_pose, J_reading] the point's covariance is
        J_pose P J_poseᵀ + J_reading diag(σ_r², σ_β²) J_readingᵀ.
    """
    yaw, r, beta = np.broadcast_arrays(np.asarray(pose, dtype=float)[..., 3], r, beta)
    there = np.isfinite(r) & np.isfinite(beta)
    r, direction = np.where(there, r, np.nan), yaw + np.where(there, beta, np.nan)
    cos, sin = np.cos(direction), np.sin(direction)
    zero, one = np.zeros_like(r), np.ones_like(r)
    jacobian = [
        [one, zero, zero, -r * sin, cos, -r * sin],
        [zero, one, zero, r * cos, sin, r * cos],
        [zero, zero, one, zero, zero, zero],
    ]
    jacobian = np.moveaxis(np.array(jacobian), (0, 1), (-2, -1))
    return np.where(there[..., None, None], jacobian, np.nan)
