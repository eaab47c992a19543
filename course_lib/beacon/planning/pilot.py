"""The reference Planner: plans at the first call, then follows the plan with a linear-quadratic regulator.

The margin that the plan leaves comes from the gusts: so many standard deviations of how far, in the long run, the
regulated vehicle is blown off its way.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from course_lib.angles import wrap
from course_lib.beacon import models, quadrotor
from course_lib.beacon.constants import ANGLES, POSITION
from course_lib.beacon.planning import problem
from course_lib.filters import Step

#: Errors and thrusts that cost alike: position (m), attitude (rad), velocity (m/s), rates (rad/s); thrust (N).
STATE_SCALE = np.repeat([0.1, 0.5, 0.3, 0.5, 3.0], [3, 2, 1, 3, 3])
THRUST_SCALE = 1.0
#: The margin in standard deviations; where no way has it, these shares of it are tried.
SIGMAS, SHARES = 4.5, (1.0, 0.6, 0.3, 0.0)
#: The vehicle plans anew when it is farther off than so many margins.
STRAY = 1.5


class Memory(NamedTuple):
    """What the planner keeps.

    Attributes
    ----------
    plan : Plan or None
        None where no way was found.
    gains : ndarray, shape (K, 4, 12)
        Of the regulator, per step.
    step : int
        The next one of the plan.
    margin : float
        In metres.
    """

    plan: problem.Plan | None
    gains: np.ndarray
    step: int
    margin: float


def Planner(previous, belief, state, constants, rng):
    """Thrusts for the next sampling time.

    Parameters
    ----------
    previous : Step or None
        What the last call returned.
    belief : None
    state : ndarray, shape (12,)
    constants : Scene
    rng : numpy.random.Generator

    Returns
    -------
    Step
        Thrusts (4,) in N, and the memory.
    """
    memory = _plan(state, constants, rng) if previous is None else previous.memory
    if memory.plan is not None and memory.step < len(memory.gains):
        off = np.linalg.norm(state[POSITION] - memory.plan.states[memory.step, POSITION])
        if off > STRAY * memory.margin:
            again = _plan(state, constants, rng)
            memory = again if again.plan is not None else memory
    if memory.plan is None:
        # Nowhere to go: stay.
        return Step(quadrotor.fly_to(state, [*state[POSITION], state[5]], constants), memory)
    if memory.step == len(memory.gains):
        return Step(quadrotor.fly_to(state, [*constants.goal, state[5]], constants), memory)
    # u = u_k - K_k (x - x_k)
    error = state - memory.plan.states[memory.step]
    error[list(ANGLES)] = wrap(error[list(ANGLES)])
    u = memory.plan.thrusts[memory.step] - memory.gains[memory.step] @ error
    return Step(np.clip(u, 0.0, constants.u_max), memory._replace(step=memory.step + 1))


def margin_for(constants):
    """What to leave beside the vehicle, in metres: `SIGMAS` deviations of its place when it hovers in gusts."""
    u = quadrotor.hover(constants)
    A, B = quadrotor.jacobians(constants.start_state, u, constants.Ts, constants)
    Q, R = _costs()
    P = solve_discrete_are(A, B, Q, R)
    closed = A - B @ np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    # Σ = (A - B K) Σ (A - B K)ᵀ + W
    covariance = solve_discrete_lyapunov(closed, models.process_covariance(B, u, constants))
    return SIGMAS * float(np.sqrt(np.linalg.eigvalsh(covariance[POSITION, POSITION]).max()))


def regulator(plan, constants):
    """Gains K_k of the time-varying linear-quadratic regulator along a plan, shape (K, 4, 12)."""
    Q, R = _costs()
    P, gains = Q.copy(), np.empty((len(plan.thrusts), 4, 12))
    for k in range(len(gains) - 1, -1, -1):
        A, B = quadrotor.jacobians(plan.states[k], plan.thrusts[k], constants.Ts, constants)
        # K = (R + Bᵀ P B)⁻¹ Bᵀ P A;  P = Q + Aᵀ P (A - B K)
        gains[k] = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        P = Q + A.T @ P @ (A - B @ gains[k])
    return gains


def _plan(state, constants, rng):
    """Plan from a state, with as much margin as there is room for."""
    margin = margin_for(constants)
    for share in SHARES:
        plan = problem.plan(constants, state, rng, share * margin)
        if plan is not None:
            return Memory(plan, regulator(plan, constants), 0, margin)
    return Memory(None, np.empty((0, 4, 12)), 0, margin)


def _costs():
    return np.diag(STATE_SCALE**-2.0), np.eye(4) / THRUST_SCALE**2
