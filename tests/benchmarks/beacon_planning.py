"""Planners: which rooms they get through, how long it takes, what an independent checker says, flights in gusts."""

import os
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from course_lib.beacon.planning import checker, collisions, flight, pilot, problem, rrt
from course_lib.beacon.planning.obstacles import Scene, distances
from course_lib.beacon.planning.scenes import KINDS, random_scene
from course_lib.beacon.quadrotor import f, parameters
from tests.benchmarks.planar_edges import AGILE, GENTLE, compare
from tests.course_lib.beacon.planning import twins

#: u_min and u_max of the source's planner, in N: all the rotors can do, and two ranges about hovering at 2.45 N.
INPUTS = {"all that rotors can": None, "hover ± 10 %": (2.2, 2.7), "hover ± 1 %": (2.43, 2.48)}
#: Edges of the source's search: it then takes longer than the planner in every kind of room.
EDGES = 40_000
#: The source is tried in one room of so many.
FEW = 10
#: Edges by which the checks are compared; and the plain program's, which is slow.
COMPARED, PLAIN = 10_000, 150
ROUGH = {"k": 0.001, "sigma_v": 0.5, "sigma_w": 0.1}
SCENES = {"ordinary": Scene(), "heavy gusts": Scene(**ROUGH), "large vehicle": Scene(radius=0.4)}


def beacon_planning(console: Console, rooms):
    """All of it, in so many random rooms, a sixth of each kind."""
    _checks(console)
    _speed(console)
    _rooms(console, rooms)
    _flights(console, max(rooms // 5, len(KINDS)))


def _scene(kind, index, scene=None):
    return random_scene(kind, np.random.default_rng([1, index]), scene)


def _by_planner(kind, index):
    """CPU seconds, whether there is a plan, its duration, the checker's verdicts, clearance and error; two margins."""
    scene = _scene(kind, index)
    start = time.process_time()
    plan = problem.plan(scene, scene.start_state, np.random.default_rng([2, index]))
    return _row(plan, scene, time.process_time() - start)


def _by_source(kind, index, inputs, check):
    scene = _scene(kind, index)
    start = time.process_time()
    plan, _ = rrt.source_rrt(scene, scene.start_state, np.random.default_rng([2, index]), EDGES, inputs, check)
    return _row(plan, scene, time.process_time() - start)


def _row(plan, scene, cpu):
    if plan is None:
        return cpu, False, np.nan, False, False, np.nan, np.nan
    report = checker.check(plan, scene)
    return cpu, True, plan.duration, report.collides, report.sound, report.clearance, report.error


def _flight(kind, index, name):
    scene = _scene(kind, index, SCENES[name])
    start = time.process_time()
    rngs = (np.random.default_rng([3, index, stream]) for stream in (0, 1))
    world, _ = flight.fly(pilot.Planner, scene, *rngs)
    return time.process_time() - start, world.status, world.metrics()["time"], world.message


def _many(function, tasks, title):
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        futures = [pool.submit(function, *task) for task in tasks]
        return [future.result() for future in track(futures, title)]


def _rooms(console, rooms):
    each = -(-rooms // len(KINDS))
    methods = [("steered and shortened", _by_planner, (), each)]
    methods += [(f"source, {name}", _by_source, (pair, rrt.CHORD), -(-each // FEW)) for name, pair in INPUTS.items()]
    table = Table(
        "room", "planner", "plans", "CPU / s", "max", "path / s", "collide", "sound", "least gap / m", "error",
        title=f"Plans in {each * len(KINDS)} random rooms, and what the independent checker says",
    )  # fmt: skip
    total, collisions_found, found = 0, 0, 0
    for kind in KINDS:
        for name, function, arguments, count in methods:
            tasks = [(kind, index, *arguments) for index in range(count)]
            rows = np.array(_many(function, tasks, f"{kind}: {name}"), dtype=float)
            cpu, there, duration, collide, sound, gap, error = rows.T
            if function is _by_planner:
                total, found = total + count, found + int(there.sum())
                collisions_found += int(collide.sum())
            some = there.any()
            table.add_row(
                kind,
                name,
                f"{int(there.sum())} of {count}",
                f"{cpu.mean():.2f}",
                f"{cpu.max():.2f}",
                f"{np.nanmean(duration):.1f}" if some else "",
                f"{int(collide.sum())}",
                f"{int(sound.sum())}",
                f"{np.nanmin(gap):.3f}" if some else "",
                f"{np.nanmax(error):.1e}" if some else "",
            )
    console.print(table)
    console.print(f"Planner: {found} plans in {total} rooms, {collisions_found} of them collide.\n")


def _flights(console, count):
    each = -(-count // len(KINDS))
    table = Table("", "arrived", "time to goal / s", "CPU per flight / s", "max", title="The reference in closed loop")
    for name in SCENES:
        tasks = [(kind, index, name) for kind in KINDS for index in range(each)]
        rows = _many(_flight, tasks, f"flights: {name}")
        cpu, status, durations, messages = zip(*rows, strict=True)
        arrived = [s == "ok" for s in status]
        table.add_row(
            name,
            f"{sum(arrived)} of {len(rows)}",
            f"{np.mean(np.array(durations)[arrived]):.2f}",
            f"{np.mean(cpu):.2f}",
            f"{np.max(cpu):.2f}",
        )
        for message in filter(None, messages):
            console.print(f"{name}: {message}")
    console.print(table)
    console.print()


def _checks(console):
    table = Table("edges", "collide", "missed by chord", "missed by speed", "checks by chord", "by speed", "ratio")
    table.title = "Collision checks: the source's, and the one that goes by the largest speed"
    for name, family in (("plane, |ω| < 8, |a| < 8", AGILE), ("plane, |ω| < 1, |a| < 1", GENTLE)):
        counts = compare(family, COMPARED, np.random.default_rng(5))
        _add(table, name, *counts)
    counts = compare(AGILE, COMPARED, np.random.default_rng(5), d_min=0.25, radius=0.25)
    _add(table, "the same, d_min = radius = 0.25 m", *counts)
    for name, inputs in INPUTS.items():
        _add(table, f"quadrotor, {name}", *_quadrotor_edges(inputs))
    console.print(table)
    console.print()


def _add(table, name, edges, colliding, chord, speed, by_chord, by_speed):
    table.add_row(
        name,
        f"{colliding} of {edges}",
        f"{chord} ({chord / max(colliding, 1):.1%})",
        f"{speed}",
        f"{by_chord / edges:.2f}",
        f"{by_speed / edges:.2f}",
        f"{by_speed / by_chord:.2f}",
    )


def _quadrotor_edges(inputs, edges=COMPARED // 5):
    """Edges of trees that the source grows in cluttered rooms; the truth from a hundred places on each."""
    counts, index = np.zeros(6, dtype=int), 0
    rng = np.random.default_rng(6)
    low, high = inputs or (0.0, Scene().u_max)
    while counts[0] < edges:
        scene = _scene("clutter", index)
        index += 1
        _, nodes = rrt.source_rrt(scene, scene.start_state, rng, 500, inputs, rrt.SPEED)
        told = (scene.boxes, scene.R, scene.h, parameters(scene))
        for state in nodes[rng.integers(len(nodes), size=100)]:
            u, duration = rng.uniform(low, high, 4), rng.uniform(*rrt.DURATIONS)
            path = [state]
            for _ in range(100):
                path.append(f(path[-1], u, duration / 100, scene))
            truth = distances(np.array(path)[:, :3], scene).min() < scene.radius
            chord, by_chord = collisions.edge_by_chord(state, u, duration, scene.radius, *told)
            speed, by_speed, _ = collisions.edge_by_speed(state, u, duration, scene.radius, collisions.TOLERANCE, *told)
            counts += [1, truth, truth and not chord, truth and not speed, by_chord, by_speed]
    return counts.tolist()


def _speed(console):
    """Edges tried per second of CPU, in the same cluttered room."""
    scene = _scene("clutter", 0)
    low, high = INPUTS["hover ± 10 %"]
    rng = np.random.default_rng(7)
    start = time.process_time()
    twins.source_rrt(scene, rng.random((PLAIN, rrt.DRAWS)), low, high)
    plain = PLAIN / (time.process_time() - start)
    table = Table("tree", "edges tried per second", "ratio", title="Edges per second of CPU, one cluttered room")
    table.add_row(f"the source's way in plain Python and NumPy, {PLAIN} edges", f"{plain:,.0f}", "1")
    for count in (PLAIN, 5_000):
        repeats = max(20_000 // count, 1)
        start = time.process_time()
        for _ in range(repeats):
            rrt.source_rrt(scene, scene.start_state, rng, count, (low, high))
        rate = repeats * count / (time.process_time() - start)
        table.add_row(f"the same, compiled, {count:,} edges", f"{rate:,.0f}", f"{rate / plain:.0f}")
    edges, start = 0, time.process_time()
    for _ in range(200):
        edges += problem.search(scene, scene.start_state, rng, 0.15, 20_000)[1][1]
    rate = edges / (time.process_time() - start)
    table.add_row(f"steered, until the goal, {edges / 200:.0f} edges on average", f"{rate:,.0f}", f"{rate / plain:.0f}")
    console.print(table)
    console.print()
