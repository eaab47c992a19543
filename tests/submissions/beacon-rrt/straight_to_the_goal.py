"""Does not plan: sends the controller straight to the goal."""

from course_lib.beacon.quadrotor import fly_to


def Planner(previous, belief, state, constants, rng):
    return fly_to(state, [*constants.goal, constants.start[3]], constants)
