"""What the quadrotor's estimator is told, and what it is not.

Letters are the source's where it has them: R, h, ρ, α, a, r, β, k, and θ for yaw. World frame: origin at the centre of
the floor, z up. Attitude: yaw, then pitch, then roll (Z-Y-X), body x ahead, y to the left, z up.
"""

from dataclasses import dataclass

import numpy as np

from course_lib.ranges import check_ranges

#: Columns of a state: position (m), attitude (rad), velocity in the world frame (m/s), body rates (rad/s).
X, Y, Z, ROLL, PITCH, YAW, VX, VY, VZ, RATE_X, RATE_Y, RATE_Z = range(12)
POSITION, ATTITUDE, VELOCITY, RATES = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
#: Columns of a state that are angles.
ANGLES = (ROLL, PITCH, YAW)

#: Columns of an observation: ranges ρ₁...ρ₄, bearings α₁...α₄, altitude a, and range r and bearing β of an obstacle.
RANGES, BEARINGS, ALTITUDE = slice(0, 4), slice(4, 8), 8
OBSTACLE_RANGE, OBSTACLE_BEARING = 9, 10
#: How many of them, the first, depend on the state alone: z₁...z₉.
MEASURED = 9


@dataclass(frozen=True)
class Constants:
    """What the estimator is told.

    Attributes
    ----------
    R, h : float
        Side of the square room and its height, in metres.
    Ts : float
        Sampling time, in seconds.
    mass : float
        In kg.
    arm : float
        From the centre to a rotor, in metres.
    torque_ratio : float
        Torque about the rotor's axis per thrust, in metres.
    inertia : tuple of float
        Principal moments about the body axes, in kg m².
    drag : float
        Force per speed, in kg/s.
    g : float
        In m/s².
    u_max : float
        Largest thrust of a rotor, in N; the least is 0.
    sigma_rho, sigma_alpha, sigma_a : float
        Standard deviations of ranges (m), bearings (rad) and altitude (m).
    sigma_r, sigma_beta : float
        Of range (m) and bearing (rad) of an obstacle.
    k : float
        Process gain: a rotor's thrust has the variance k |u| about the commanded u, anew in each step, in N.
    sigma_v, sigma_w : float
        Gusts: standard deviations of what a second adds to the velocity (m/s) and to the body rates (rad/s), as
        random walks.
    start : tuple of float
        Mean of the first state's x, y, z (m) and yaw (rad); attitude, velocity and rates have mean zero.
    start_sigma : tuple of float
        Standard deviations at the start of each coordinate of position (m), of roll and pitch (rad), of yaw (rad),
        of each coordinate of velocity (m/s) and of each body rate (rad/s).
    """

    R: float = 10.0
    h: float = 4.0
    Ts: float = 0.05
    mass: float = 1.0
    arm: float = 0.2
    torque_ratio: float = 0.05
    inertia: tuple[float, float, float] = (0.01, 0.01, 0.02)
    drag: float = 0.3
    g: float = 9.81
    u_max: float = 6.0
    sigma_rho: float = 0.1
    sigma_alpha: float = float(np.radians(2.0))
    sigma_a: float = 0.1
    sigma_r: float = 0.05
    sigma_beta: float = float(np.radians(1.0))
    k: float = 0.0001
    sigma_v: float = 0.2
    sigma_w: float = 0.05
    start: tuple[float, float, float, float] = (0.0, 0.0, 2.0, 0.0)
    start_sigma: tuple[float, float, float, float, float] = (
        0.5,
        float(np.radians(2.0)),
        float(np.radians(5.0)),
        0.3,
        0.1,
    )

    def __post_init__(self):
        positive = (1e-9, np.inf)
        check_ranges(
            self,
            **dict.fromkeys(("R", "h", "Ts", "mass", "arm", "torque_ratio", "g", "u_max"), positive),
            **dict.fromkeys(("sigma_rho", "sigma_alpha", "sigma_a", "sigma_r", "sigma_beta"), positive),
            **dict.fromkeys(("drag", "k", "sigma_v", "sigma_w"), (0.0, np.inf)),
        )
        # They cross processes as JSON, which knows lists only.
        for name, length in (("inertia", 3), ("start", 4), ("start_sigma", 5)):
            values = getattr(self, name)
            if len(values) != length or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} = {values} must be {length} finite numbers")

    @property
    def beacons(self):
        """Positions of beacons 1 to 4 in metres, shape (4, 3): the corners (+, +), (-, +), (-, -), (+, -)."""
        r, z = self.R / 2, self.h / 2
        return np.array([[r, r, z], [-r, r, z], [-r, -r, z], [r, -r, z]])

    @property
    def sigma_z(self):
        """Standard deviations of the first nine columns of an observation, shape (9,)."""
        return np.repeat([self.sigma_rho, self.sigma_alpha, self.sigma_a], [4, 4, 1])


@dataclass(frozen=True)
class Hidden:
    """What the world knows and the estimator is not told.

    Attributes
    ----------
    steps : int
        Length of a run in sampling times.
    reach : float
        Waypoints are uniform in |x|, |y| ≤ reach · R / 2 and in the middle half of the height.
    interval : float
        A new waypoint after so many seconds.
    outage : float
        Probability that a range or a bearing is missing in a step, for each independently.
    dead : tuple of int
        Beacons, 0 to 3, that are never heard.
    bias : tuple of float
        Added to the ranges of the four beacons, in metres.
    gain : float
        The rotors' noise has this many times the variance that `Constants.k` says.
    obstacles : tuple of tuple of float
        Boxes (x₀, y₀, z₀, x₁, y₁, z₁) in metres, for the obstacle sensor; outside the vehicle's way.
    sight : float
        How far the obstacle sensor sees, in metres.
    """

    steps: int = 200
    reach: float = 0.6
    interval: float = 2.5
    outage: float = 0.1
    dead: tuple[int, ...] = ()
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    gain: float = 1.0
    obstacles: tuple[tuple[float, ...], ...] = (
        (3.8, -0.6, 0.0, 4.4, 0.4, 4.0),
        (-1.2, 3.9, 0.0, -0.4, 4.5, 4.0),
        (-4.3, -2.9, 0.0, -3.7, -2.1, 4.0),
    )
    sight: float = 3.0

    def __post_init__(self):
        check_ranges(
            self,
            steps=(1, np.inf),
            reach=(0.0, 1.0),
            interval=(1e-9, np.inf),
            outage=(0.0, 1.0),
            gain=(0.0, np.inf),
            sight=(0.0, np.inf),
        )
