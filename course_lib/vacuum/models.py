"""Motion and measurement models of the two vacuum robots.

States are (N, 6) arrays with columns x_A, y_A, θ_A, x_B, y_B, θ_B: metres and radians, the origin in the corner of
sensor S4, headings counter-clockwise from the x axis. Equation numbers are those of `solutions/03_vacuum_robots.md`.
"""

import numpy as np
from numba import njit, types


def bounce_noise(p, v_bar):
    """Bounce noise v at cumulative probability p.

    Parameters
    ----------
    p : array_like
        Probabilities in [0, 1].
    v_bar : float
        Half-width v̄.

    Returns
    -------
    ndarray
        v in [-v̄, v̄], distributed as f(v) = 3 v² / (2 v̄³) when p is uniform.
    """
    # F(v) = (v³ + v̄³) / (2 v̄³) = p  =>  v = v̄ (2p - 1)^{1/3}
    return v_bar * np.cbrt(2.0 * np.asarray(p) - 1.0)


def triangular_noise(p, half_width):
    """Symmetric triangular noise at cumulative probability p.

    Parameters
    ----------
    p : array_like
        Probabilities in [0, 1].
    half_width : float

    Returns
    -------
    ndarray
        Values in [-half_width, half_width].
    """
    p = np.asarray(p)
    # F(w) = (1 + w/w̄)² / 2 below zero, and symmetric above it
    tail = 1.0 - np.sqrt(2.0 * np.minimum(p, 1.0 - p))
    return half_width * np.where(p < 0.5, -tail, tail)


def prior(n, constants, rng):
    """Draw states at time 0: A in the corner of S1 or S2, B in that of S3 or S4, headings into the room.

    Parameters
    ----------
    n : int
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n, 6)
    """
    # From its corner, each robot may head into a quarter of the circle, which begins here (S1 to S4):
    first_heading = np.array([np.pi / 2, -np.pi, -np.pi / 2, 0.0])
    states = np.empty((n, 6))
    for robot in (0, 1):
        corner = rng.integers(2, size=n) + 2 * robot
        heading = first_heading[corner] + rng.uniform(0.0, np.pi / 2, size=n)
        states[:, 3 * robot : 3 * robot + 2] = constants.sensors[corner]
        states[:, 3 * robot + 2] = heading
    return states


def transition(states, control, constants, rng):
    """Draw states one sampling time later.

    Parameters
    ----------
    states : ndarray, shape (N, 6)
        Positions inside the room.
    control : array_like, shape (2,)
        Speeds u_A, u_B over the interval, in m/s.
    constants : Constants
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (N, 6)
        Positions inside the room, headings in [-π, π].
    """
    states = np.array(states, dtype=float, order="C")
    room_x, room_y = constants.room
    for robot in (0, 1):
        distance = np.full(len(states), control[robot] * constants.Ts)
        if constants.v_s_bar:
            distance *= 1.0 + triangular_noise(rng.random(len(states)), constants.v_s_bar)
        drive(states, 3 * robot, distance, room_x, room_y, constants.v_bar, rng)
    return states


@njit(cache=True, inline="always")
def bounce(along, into, noise):
    """Direction after a bounce off any wall, for kernels.

    Parameters
    ----------
    along, into : float
        Components of the direction before it, parallel to the wall and perpendicular.
    noise : float
        v in [-1, 1].

    Returns
    -------
    along, into : float
        The same components after it; `into` has changed its sign.
    """
    # α⁻ = atan(|v_n| / |v_t|);  α⁺ = α⁻ (1 + v) in [0, π], so sin α⁺ ≥ 0 points back into the room at every wall
    after = np.arctan2(abs(into), abs(along)) * (1.0 + noise)
    return np.copysign(1.0, along) * np.cos(after), -np.copysign(1.0, into) * abs(np.sin(after))


@njit(cache=True, inline="always")
def to_wall(states, i, column, dx, dy, distance, room_x, room_y):
    """Drive one robot to the next wall or to the end of its distance, for kernels; changes `states` in place.

    Parameters
    ----------
    states : ndarray, shape (N, d)
    i, column : int
        Row of the robot, and first of its columns x, y.
    dx, dy : float
        Its direction, a unit vector.
    distance : float
        Metres.
    room_x, room_y : float
        Extent of the room in metres.

    Returns
    -------
    float
        Metres left when it met a wall; -1 when it did not.
    """
    x, y = states[i, column], states[i, column + 1]
    to_x = (room_x - x) / dx if dx > 0.0 else (-x / dx if dx < 0.0 else np.inf)
    to_y = (room_y - y) / dy if dy > 0.0 else (-y / dy if dy < 0.0 else np.inf)
    wall = min(to_x, to_y)
    if wall >= distance:
        states[i, column] = min(max(x + distance * dx, 0.0), room_x)
        states[i, column + 1] = min(max(y + distance * dy, 0.0), room_y)
        return -1.0
    if to_x <= to_y:
        states[i, column] = room_x if dx > 0.0 else 0.0
        states[i, column + 1] = min(max(y + wall * dy, 0.0), room_y)
    else:
        states[i, column] = min(max(x + wall * dx, 0.0), room_x)
        states[i, column + 1] = room_y if dy > 0.0 else 0.0
    return distance - wall


@njit(
    types.void(
        types.float64[:, ::1],
        types.int64,
        types.float64[::1],
        types.float64,
        types.float64,
        types.float64,
        types.npy_rng,
    ),
    cache=True,
)
def drive(states, column, distance, room_x, room_y, v_bar, rng):
    """Drive robots their distance, bouncing off walls as often as it takes; changes `states` in place.

    A bounce keeps the speed, so that a robot's time in a step is used up when its distance is. Bounces are drawn
    round by round (every robot's first bounce in order of rows, then every second one, ...), which is the order
    in which an array implementation draws them.

    Parameters
    ----------
    states : ndarray, shape (N, d)
        Columns `column`, `column + 1`, `column + 2` hold x, y, θ.
    column : int
    distance : ndarray, shape (N,)
        Metres to drive, not negative; left as it is.
    room_x, room_y : float
        Extent of the room in metres.
    v_bar : float
        Half-width of the bounce noise.
    rng : numpy.random.Generator
    """
    n = states.shape[0]
    bouncing = np.empty(n, dtype=np.int64)
    left = np.empty(n)
    direction_x = np.empty(n)
    direction_y = np.empty(n)
    count = 0
    for i in range(n):
        dx, dy = np.cos(states[i, column + 2]), np.sin(states[i, column + 2])
        rest = to_wall(states, i, column, dx, dy, distance[i], room_x, room_y)
        if rest >= 0.0:
            bouncing[count], left[count] = i, rest
            direction_x[count], direction_y[count] = dx, dy
            count += 1
    while count:
        again = 0
        for j in range(count):
            i = bouncing[j]
            dx, dy = direction_x[j], direction_y[j]
            # v = v̄ (2p - 1)^{1/3}
            noise = v_bar * np.cbrt(2.0 * rng.random() - 1.0)
            x = states[i, column]
            if (x <= 0.0 and dx < 0.0) or (x >= room_x and dx > 0.0):
                dy, dx = bounce(dy, dx, noise)
            else:
                dx, dy = bounce(dx, dy, noise)
            states[i, column + 2] = np.arctan2(dy, dx)
            rest = to_wall(states, i, column, dx, dy, left[j], room_x, room_y)
            if rest >= 0.0:
                bouncing[again], left[again] = i, rest
                direction_x[again], direction_y[again] = dx, dy
                again += 1
        count = again


def distances(states, constants):
    """Distance of each robot to each sensor.

    Parameters
    ----------
    states : ndarray, shape (N, 6)
    constants : Constants

    Returns
    -------
    ndarray, shape (N, 2, 4)
        Metres; robots A and B, sensors S1 to S4.
    """
    positions = np.asarray(states)[:, [[0, 1], [3, 4]]]
    return np.linalg.norm(positions[:, :, None, :] - constants.sensors, axis=-1)


def triangular_density(w, half_width):
    """Density of symmetric triangular noise on [-half_width, half_width] at w (any shape)."""
    # f(w) = (1 - |w| / w̄) / w̄
    return np.maximum(1.0 - np.abs(w) / half_width, 0.0) / half_width


def log_likelihood(observation, states, constants):
    """Log-likelihood of the four sensors' readings for each state.

    Parameters
    ----------
    observation : array_like, shape (4,)
        Distances in metres; `inf` where a sensor is silent, which says nothing of the state.
    states : ndarray, shape (N, 6)
    constants : Constants

    Returns
    -------
    ndarray, shape (N,)
        `-inf` where a reading is impossible.
    """
    observation = np.asarray(observation)
    reports = np.flatnonzero(np.isfinite(observation))
    residual = observation[reports] - distances(states, constants)[:, :, reports]
    density = triangular_density(residual, constants.w_bar)
    tuned_to = reports // 2
    column = np.arange(len(reports))
    right, wrong = density[:, tuned_to, column], density[:, 1 - tuned_to, column]
    # f(z_i | p) = (1 - s̄) f_w(z_i - d_right) + s̄ f_w(z_i - d_wrong);  the sensors are independent
    likelihood = (1.0 - constants.s_bar) * right + constants.s_bar * wrong
    with np.errstate(divide="ignore"):
        return np.log(likelihood).sum(axis=1)
