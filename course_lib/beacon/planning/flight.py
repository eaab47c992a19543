"""The world in which planners fly: one scene, its gusts, and what ends a flight."""

import numpy as np

from course_lib.angles import wrap
from course_lib.beacon import quadrotor
from course_lib.beacon.constants import ANGLES, POSITION, RATES, VELOCITY
from course_lib.beacon.planning.collisions import edge_by_speed
from course_lib.beacon.planning.obstacles import nearest
from course_lib.filters import Step

#: The vehicle has touched what it comes that close to, in metres.
TOUCH = 1e-3


class Flight:
    """A flight in closed loop. Noise is that of `models.transition`, and collisions are looked for all along each step.

    Parameters
    ----------
    scene : Scene
    rng : numpy.random.Generator
        Draws rotor noise and gusts: as many numbers in every step, so all planners meet the same.

    Attributes
    ----------
    constants : Scene
        What the planner is told.
    state : ndarray, shape (12,)
    steps : int
        That were flown.
    over : bool
        It has arrived, collided, lost control or run out of time.
    status, message : str
        "ok" and nothing, or "collided", "lost control", "not arrived" and one line that says when and where.
    """

    def __init__(self, scene, rng):
        self.constants = scene
        self.state = scene.start_state
        self.steps = 0
        self.over, self.status, self.message = False, "", ""
        self._rng = rng
        self._effort = 0.0
        self._told = quadrotor.parameters(scene), scene.boxes

    def inputs(self):
        """No belief, for the state is known, and the state (12,)."""
        return None, self.state.copy()

    def act(self, action):
        """Fly for one sampling time.

        Parameters
        ----------
        action : ndarray, shape (4,)
            Thrusts in N; cut to what the rotors can do.
        """
        scene, rng = self.constants, self._rng
        command = np.clip(action, 0.0, scene.u_max)
        # The draws and their order are those of models.transition, whose thrusts are needed here on the way.
        thrusts = command + np.sqrt(scene.k * command) * rng.standard_normal((1, 4))[0]
        gusts = np.sqrt(scene.Ts) * rng.standard_normal((1, 6))[0]
        parameters, boxes = self._told
        touched, _, when = edge_by_speed(
            self.state, thrusts, scene.Ts, scene.radius, TOUCH, boxes, scene.R, scene.h, parameters
        )
        begin = self.steps * scene.Ts
        self.steps += 1
        self._effort += scene.Ts * float(command @ command)
        reached = quadrotor.f(self.state, thrusts, when if touched else scene.Ts, scene)
        if not np.all(np.isfinite(reached)):
            self._end("lost control", "tumbled out of control")
            return
        self.state = reached
        if touched:
            x, y, z = reached[POSITION]
            what = nearest(reached[POSITION], scene)
            self._end("collided", f"flew into {what} at ({x:.2f}, {y:.2f}, {z:.2f}) m", begin + when)
            return
        self.state[VELOCITY] += scene.sigma_v * gusts[:3]
        self.state[RATES] += scene.sigma_w * gusts[3:]
        self.state[list(ANGLES)] = wrap(self.state[list(ANGLES)])
        if self.distance() <= scene.goal_radius:
            self._end("ok", "")
        elif self.steps == scene.steps:
            self._end("not arrived", f"time is up, {self.distance():.2f} m from the goal")

    def _end(self, status, message, when=None):
        when = self.steps * self.constants.Ts if when is None else when
        self.over, self.status = True, status
        self.message = message and f"step {self.steps} ({when:.2f} s): {message}"

    def metrics(self):
        """Time to the goal in seconds, and effort, the integral of the squared thrusts in N² s."""
        return {"time": self.steps * self.constants.Ts, "effort": self._effort}

    def position(self):
        """x and y, in metres."""
        return self.state[:2]

    def distance(self):
        """How far the goal is, in metres."""
        return float(np.linalg.norm(self.state[POSITION] - self.constants.goal))


def fly(planner, scene, gusts, rng):
    """Fly a scene with a planner.

    Parameters
    ----------
    planner : callable
        `planner(previous, belief, state, constants, rng)`.
    scene : Scene
    gusts, rng : numpy.random.Generator
        The world's and the planner's.

    Returns
    -------
    flight : Flight
        When it is over.
    track : ndarray, shape (steps + 1, 12)
        The states at the control instants.
    """
    flight, previous = Flight(scene, gusts), None
    track = [flight.state]
    while not flight.over:
        previous = planner(previous, *flight.inputs(), scene, rng)
        action = previous.posterior if isinstance(previous, Step) else previous
        flight.act(np.asarray(action, dtype=float))
        track.append(flight.state)
    return flight, np.array(track)
