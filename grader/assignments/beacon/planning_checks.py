"""What the checks of the collision check and of the planner try: edges made to fool a careless march, easy flights."""

import functools
import importlib
from dataclasses import replace

import numpy as np

from course_lib.beacon import quadrotor
from course_lib.beacon.constants import POSITION, RATES, VELOCITY
from course_lib.beacon.planning.flight import Flight
from course_lib.beacon.planning.obstacles import Scene, distances
from course_lib.filters import Step
from grader.lessons import expect

#: A room without obstacles, for edges in its middle.
EMPTY = Scene(start=(-4.0, -4.0, 2.0, 0.0), goal=(4.0, 4.0, 2.0))
#: Edges that come this close to touching, or touch no deeper, are not asked about, in metres.
UNDECIDED = 0.02
#: Random edges.
EDGES = 80


def safe_march(function):
    """Edges one by one, each with what a march that fails there has overlooked; then random ones."""
    hover = quadrotor.hover(EMPTY)
    for words, state, thrusts, duration, boxes, safe, reason in _edges(hover):
        scene = replace(EMPTY, obstacles=boxes)
        call = f"safe_march for {words}, within {duration:.2f} s"
        got = _boolean(function(state, thrusts, duration, scene), call)
        if got != safe:
            clearance = _clearance(state, thrusts, duration, scene)
            found = f"stays {clearance:.3f} m away" if safe else "touches something"
            raise AssertionError(f"{reason}\n{call}: expected {safe}, for the vehicle {found}; got {got}")
    edges = _random_edges()
    missed, alarms = [], []
    for state, thrusts, duration, scene, clearance in edges:
        got = _boolean(function(state, thrusts, duration, scene), "safe_march for a random edge")
        if got != (clearance > 0):
            (alarms if clearance > 0 else missed).append((state, clearance))
    collide = sum(edge[-1] < 0 for edge in edges)
    if missed:
        deepest = min(clearance for _, clearance in missed)
        raise AssertionError(
            f"{len(missed)} of {collide} random edges that touch something are said to be safe: no step may be longer "
            "than it takes to fly, at the greatest speed there can be, what is free around the vehicle.\n"
            f"The worst of them touches {-deepest:.2f} m deep"
        )
    if alarms:
        widest = max(clearance for _, clearance in alarms)
        raise AssertionError(
            f"{len(alarms)} of {len(edges) - collide} random edges that touch nothing are said to touch, one of which "
            f"stays {widest:.2f} m away: a long step is no reason to give up, take another from where it leads"
        )
    return f"All {collide} collisions among {len(edges)} random edges are found, and no other."


def _boolean(value, call):
    assert isinstance(value, bool | np.bool_), f"{call}: expected True or False, got {type(value).__name__}"
    return bool(value)


def _flying(position, velocity=(0.0, 0.0, 0.0)):
    state = np.zeros(12)
    state[POSITION], state[VELOCITY] = position, velocity
    return state


def _edges(hover):
    """Words, state, thrusts, duration, boxes, whether it is safe, and what it means when it is said not to be."""
    middle, ahead = (0.0, 0.0, 2.0), _flying((0.0, 0.0, 2.0), (2.0, 0.0, 0.0))
    x_end = quadrotor.f(ahead, hover, 0.5, EMPTY)[0]
    low, high = 0.5, 3.5
    yield (
        "a flight ahead in an empty room",
        ahead,
        hover,
        0.5,
        (),
        True,
        "True means that the vehicle touches nothing.",
    )
    yield (
        "a fast flight through a thin pillar",
        _flying((-1.2, 0.0, 2.0), (5.0, 0.0, 0.0)),
        hover,
        0.5,
        ((-0.02, -0.02, low, 0.02, 0.02, high),),
        False,
        "The ends of the edge are free, its middle is not: march along it.",
    )
    yield (
        "a flight past a box at 15 cm from its centre",
        ahead,
        hover,
        0.5,
        ((0.4, 0.15, low, 0.6, 0.5, high),),
        False,
        "The vehicle is no point: what is free around it is the distance less scene.radius.",
    )
    yield (
        "a flight away from a box that it touches at the start",
        _flying(middle, (-2.0, 0.0, 0.0)),
        hover,
        0.3,
        ((0.1, -0.2, low, 0.5, 0.2, high),),
        False,
        "The place where the edge begins is to be checked, too.",
    )
    yield (
        "a vehicle without thrust that is thrown upwards and falls back to where it was, below a box",
        _flying(middle, (0.0, 0.0, 2.0)),
        np.zeros(4),
        0.4,
        ((-1.0, -1.0, 2.35, 1.0, 1.0, 2.8),),
        False,
        "The march along the chord is fooled by a way that turns back: its chord is short, and it has been everywhere "
        "before it begins. March in time.",
    )
    yield (
        "full thrust from rest, through a plate above",
        _flying((0.0, 0.0, 1.0)),
        np.full(4, EMPTY.u_max),
        0.5,
        ((-1.5, -1.5, 1.9, 1.5, 1.5, 1.95),),
        False,
        "The speed at which a step begins is no bound: it grows, by at most (Σu/m + g) per second.",
    )
    yield (
        "a flight through the room's wall",
        _flying((4.0, 0.0, 2.0), (4.0, 0.0, 0.0)),
        hover,
        0.5,
        (),
        False,
        "Walls, floor and ceiling are obstacles like the others: `distances` knows them.",
    )
    yield (
        "an edge that ends 5 cm before a box",
        ahead,
        hover,
        0.5,
        ((x_end + EMPTY.radius + 0.05, -0.5, low, x_end + 1.0, 0.5, high),),
        True,
        "The edge ends before the box: march no longer than `duration`.",
    )
    yield (
        "a flight past a box, with 5 cm to spare",
        ahead,
        hover,
        0.5,
        ((0.4, EMPTY.radius + 0.05, low, 0.6, 1.0, high),),
        True,
        "Too careful: it is a collision when the distance is no more than scene.radius, and a little for rounding.",
    )
    yield (
        "hovering 10 cm from a box",
        _flying(middle),
        hover,
        0.5,
        ((EMPTY.radius + 0.1, -0.5, low, 1.0, 0.5, high),),
        True,
        "A hovering vehicle stays where it is.",
    )


def _clearance(state, thrusts, duration, scene):
    """Least distance to anything along an edge, less the radius, in metres."""
    way = [quadrotor.f(state, thrusts, t, scene)[:3] for t in np.linspace(0.0, duration, 250)]
    return float(distances(np.array(way), scene).min()) - scene.radius


@functools.cache
def _random_edges():
    """(state, thrusts, duration, scene, clearance): a vehicle that turns, a pillar that it scrapes or just misses."""
    rng = np.random.default_rng(16)
    edges = []
    while len(edges) < EDGES:
        state = np.zeros(12)
        state[POSITION] = rng.uniform([-1.0, -1.0, 1.2], [1.0, 1.0, 2.8])
        state[3:6] = rng.uniform([-0.5, -0.5, -np.pi], [0.5, 0.5, np.pi])
        state[VELOCITY] = rng.uniform([-6.0, -6.0, -1.0], [6.0, 6.0, 1.0])
        state[RATES] = rng.uniform(-3.0, 3.0, 3)
        # Thrusts that differ more would tumble it.
        thrusts = rng.uniform(0.0, EMPTY.u_max) + rng.uniform(-0.1, 0.1, 4)
        thrusts, duration = np.clip(thrusts, 0.0, EMPTY.u_max), rng.uniform(0.2, 0.5)
        # Beside the way, as far as the vehicle is wide, a little more or a little less.
        at = quadrotor.f(state, thrusts, rng.uniform(0.2, 0.9) * duration, EMPTY)
        beside = rng.choice([-1.0, 1.0]) * np.array([-at[7], at[6]]) / np.hypot(at[6], at[7])
        x, y = at[:2] + (EMPTY.radius + 0.03 + rng.choice([-0.035, 0.035])) * beside
        scene = replace(EMPTY, obstacles=((x - 0.03, y - 0.03, 0.0, x + 0.03, y + 0.03, 4.0),))
        clearance = _clearance(state, thrusts, duration, scene)
        if abs(clearance) > UNDECIDED and distances(state[None, :3], scene)[0] > scene.radius:
            edges.append((state, thrusts, duration, scene, clearance))
    return edges


#: Easy flights, and how many times the reference's time to the goal passes.
SCENES = {
    "an open room": Scene(start=(-3.0, -1.0, 1.5, 0.5), goal=(3.0, 1.0, 2.5)),
    "a room with a wall that is open at one side": Scene(
        start=(-2.5, -2.0, 2.0, 0.0), goal=(2.5, -2.0, 2.0), obstacles=((-0.2, -5.0, 0.0, 0.2, 1.5, 4.0),)
    ),
}
SLOWEST = 4.0


def planner(function):
    """One flight in each scene, in gusts, beside the reference."""
    lines = []
    for i, (words, scene) in enumerate(SCENES.items()):
        flight = _fly(function, scene, i, words)
        if flight.status != "ok":
            calm = replace(scene, k=0.0, sigma_v=0.0, sigma_w=0.0)
            reason = "The flight does not end at the goal."
            if flight.status == "collided":
                reason = "The vehicle runs into something."
            if _fly(function, calm, i, words).status == "ok":
                reason = (
                    "In still air it arrives, in gusts it does not: a plan is not flown by its thrusts alone. Compare "
                    "`state` with the plan in each step, leave a margin, or plan anew."
                )
            elif not scene.obstacles:
                reason += " And nothing is in the way: is the plan flown from its first step on, one step per call?"
            raise AssertionError(f"{reason}\nPlanner in {words}: {flight.message}")
        own = _reference_flight(words)
        seconds = flight.metrics()["time"]
        beside = f" (the reference {own:.1f} s)" if own else ""
        lines.append(f"{words}: at the goal after {seconds:.1f} s{beside}")
        if own:
            assert seconds <= SLOWEST * own, (
                f"It arrives, but takes more than {SLOWEST:g} times as long as the reference: shorten the way, or fly "
                f"faster.\nPlanner in {lines[-1]}"
            )
    return "\n".join(lines)


def _fly(function, scene, seed, words):
    """A flight that is over."""
    flight, previous = Flight(scene, np.random.default_rng([17, seed])), None
    rng = np.random.default_rng([18, seed])
    while not flight.over:
        previous = function(previous, *flight.inputs(), scene, rng)
        action = previous.posterior if isinstance(previous, Step) else previous
        flight.act(expect.array(action, (4,), f"Planner in {words}, step {flight.steps}"))
    return flight


@functools.cache
def _reference_flight(words):
    """Seconds to the goal; None where the reference was not handed out."""
    try:
        reference = importlib.import_module("course_lib.beacon.planning.pilot").Planner
    except ModuleNotFoundError:
        return None
    return _fly(reference, SCENES[words], list(SCENES).index(words), words).metrics()["time"]
