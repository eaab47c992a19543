"""What the vacuum robots' estimator is told, and what it is not.

The letters are those of the exercise sheet (ETH Zurich, Recursive Estimation, spring 2015, exercise 2).
"""

from dataclasses import dataclass

import numpy as np

from course_lib.ranges import check_ranges


@dataclass(frozen=True)
class Constants:
    """What the estimator is told.

    Attributes
    ----------
    L : float
        Side of the room along y, in metres.
    Ts : float
        Sampling time T_s, in seconds.
    v_bar : float
        Half-width v̄ of the bounce noise, 0 ≤ v̄ ≤ 1: f(v) = c v² on [-v̄, v̄].
    w_bar : float
        Half-width w̄ of the triangular sensor noise, in metres.
    s_bar : float
        Probability s̄ that a sensor measures the wrong robot.
    length : float
        Side of the room along x in multiples of L: 1 in 2015, 2 in 2017 and 2018.
    v_s_bar : float
        Half-width v̄_s of the triangular speed noise, 0 ≤ v̄_s < 1: a robot drives at u (1 + v_s), v_s drawn anew in
        each step. 0 in 2015; the sheets of 2017 and 2018 have it.
    """

    L: float = 5.0
    Ts: float = 0.1
    v_bar: float = 1.0
    w_bar: float = 1.0
    s_bar: float = 0.1
    length: float = 1.0
    v_s_bar: float = 0.0

    def __post_init__(self):
        check_ranges(
            self,
            L=(1e-9, np.inf),
            Ts=(1e-9, np.inf),
            v_bar=(0.0, 1.0),
            w_bar=(1e-9, np.inf),
            s_bar=(0.0, 1.0),
            length=(1e-9, np.inf),
            v_s_bar=(0.0, 1.0 - 1e-9),
        )

    @property
    def room(self):
        """Extent of the room along x and y in metres, shape (2,)."""
        return np.array([self.length * self.L, self.L])

    @property
    def sensors(self):
        """Positions of S1, S2, S3, S4 in metres, shape (4, 2): S1 and S2 are tuned to robot A, S3 and S4 to B."""
        x, y = self.room
        return np.array([[x, 0.0], [x, y], [0.0, y], [0.0, 0.0]])


@dataclass(frozen=True)
class Hidden:
    """What the world knows and the estimator is not told.

    Attributes
    ----------
    steps : int
        Length of a run in sampling times.
    shortest_segment, longest_segment : int
        A robot keeps its speed for a uniformly drawn number of steps between these, both included.
    slowest, fastest : float
        A new speed is uniform between these, in m/s.
    report_probability : float
        Probability that a sensor reports in a step, for each sensor and step independently.
    """

    steps: int = 200
    shortest_segment: int = 5
    longest_segment: int = 30
    slowest: float = 1.0
    fastest: float = 2.0
    report_probability: float = 0.2

    def __post_init__(self):
        check_ranges(
            self,
            steps=(1, np.inf),
            shortest_segment=(1, self.longest_segment),
            longest_segment=(1, np.inf),
            slowest=(0.0, self.fastest),
            fastest=(0.0, np.inf),
            report_probability=(0.0, 1.0),
        )
