"""What the DR20's estimator is told, and what it is not.

Letters follow S. Thrun, W. Burgard, D. Fox, *Probabilistic Robotics*, MIT Press 2005, ch. 5, 6 and 8; the map, the
robot and the beams are those of the assignment (SJTU AI3603, homework 3, 2021).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from course_lib.dr20 import maps
from course_lib.geometry import polygons
from course_lib.ranges import check_ranges

#: Columns of a state: metres, metres, radians counter-clockwise from the x-axis.
X, Y, HEADING = range(3)
ANGLES = (HEADING,)


@dataclass(frozen=True)
class Constants:
    """What the estimator is told.

    Attributes
    ----------
    room : tuple of (float, float)
        Vertices of the outline, in metres.
    obstacles : tuple of such tuples
        Vertices of what stands in the room; a ring within a ring is a hole.
    bearings : tuple of float
        Of the beams, in radians counter-clockwise from the robot's heading.
    mount : float
        How far ahead of the axle's centre the beams start, in metres, less than `radius`.
    radius : float
        The robot is a disc about the axle's centre, in metres.
    Ts : float
        Sampling time, in seconds.
    sigma_v, sigma_omega : float
        Standard deviations of what is executed about the command: m/s and rad/s, drawn anew in each step.
    sigma : float
        Standard deviation of a range that hits what the map says, in metres.
    r_max : float
        What is farther away than this, in metres, is not seen: the reading is `inf`.
    p_short, p_miss, p_random : float
        Probabilities that a reading comes from something before the wall, that it is `inf` for no reason, and that it
        is uniform on [0, r_max].
    rate_short : float
        What stands before the wall is at an exponentially distributed distance, with this rate per metre.
    near : (float, float)
    within : float
        The robot starts at a position uniform over the free part of the square of half-width `within` about `near`
        (metres), with any heading. A square that holds the room says nothing: the global problem.
    kidnap_rate : float
        How often per second, on average, somebody carries the robot elsewhere: anywhere free, at least 2 m away.
    """

    room: tuple = maps.ROOM
    obstacles: tuple = maps.TABLES
    bearings: tuple = (-np.pi / 2, -np.pi / 4, 0.0, np.pi / 4, np.pi / 2)
    mount: float = 0.0
    radius: float = 0.15
    Ts: float = 0.1
    sigma_v: float = 0.03
    sigma_omega: float = float(np.radians(3.0))
    sigma: float = 0.05
    r_max: float = 4.0
    p_short: float = 0.05
    p_miss: float = 0.02
    p_random: float = 0.02
    rate_short: float = 1.0
    near: tuple = (2.5, 2.5)
    within: float = 100.0
    kidnap_rate: float = 0.0

    def __post_init__(self):
        check_ranges(
            self,
            radius=(0.0, np.inf),
            mount=(0.0, self.radius),
            Ts=(1e-9, np.inf),
            sigma_v=(0.0, np.inf),
            sigma_omega=(0.0, np.inf),
            sigma=(1e-9, np.inf),
            r_max=(1e-9, np.inf),
            p_short=(0.0, 1.0),
            p_miss=(0.0, 1.0 - self.p_short),
            p_random=(0.0, 1.0 - self.p_short - self.p_miss),
            rate_short=(1e-9, np.inf),
            within=(1e-9, np.inf),
            kidnap_rate=(0.0, np.inf),
        )

    @cached_property
    def walls(self):
        """The map's walls, shape (S, 4): rows x₀, y₀, x₁, y₁ in metres. Not to be written to."""
        return polygons.walls((self.room, *self.obstacles))

    @cached_property
    def bounds(self):
        """The box about the outline: x₀, y₀, x₁, y₁ in metres, shape (4,)."""
        vertices = np.asarray(self.room, dtype=float)
        return np.concatenate([vertices.min(axis=0), vertices.max(axis=0)])


@dataclass(frozen=True)
class Hidden:
    """What the world knows and the estimator is not told.

    Attributes
    ----------
    steps : int
        Length of a run in sampling times.
    shortest_segment, longest_segment : int
        The driver keeps a command for a uniformly drawn number of steps between these, both included.
    slowest, fastest : float
        Speeds are uniform between these, in m/s.
    sharpest : float
        Yaw rates are uniform between ± this, in rad/s.
    careless : float
        Share of the segments in which the driver does not look ahead, and may push the robot against a wall.
    kidnaps : int
        How often the robot is carried elsewhere: the run is cut into as many equal parts, and it happens at a time
        uniform over the middle half of each.
    dead : tuple of int
        Beams that read `inf` always.
    slip : float
        What is executed is this many times as noisy as `Constants` says.
    """

    steps: int = 300
    shortest_segment: int = 10
    longest_segment: int = 30
    slowest: float = 0.3
    fastest: float = 0.6
    sharpest: float = 0.8
    careless: float = 0.15
    kidnaps: int = 0
    dead: tuple = ()
    slip: float = 1.0

    def __post_init__(self):
        check_ranges(
            self,
            steps=(1, np.inf),
            shortest_segment=(1, self.longest_segment),
            longest_segment=(1, np.inf),
            slowest=(0.0, self.fastest),
            fastest=(0.0, np.inf),
            sharpest=(0.0, np.inf),
            careless=(0.0, 1.0),
            kidnaps=(0, self.steps // 4),
            slip=(0.0, np.inf),
        )
