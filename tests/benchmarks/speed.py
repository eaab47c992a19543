"""How fast the reference is, in process CPU time, and how much faster than named baselines in the same run."""

import math
import time
from functools import partial

import filterpy.monte_carlo
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from course_lib.filters import bootstrap_step, equally_weighted, resampling
from course_lib.vacuum import models, reference
from course_lib.vacuum.constants import Constants
from course_lib.vacuum.world import World
from tests.course_lib.filters.test_resampling import systematic_numpy
from tests.course_lib.vacuum import test_reference as twins
from tests.course_lib.vacuum.twins import drive_numpy

#: Particles of the filter without arrays, and the steps it takes.
FEW, STEPS = 300, 60
#: Steps of the scalar model that is filtered beside `particles`: x' = 0.9 x + 0.3 noise, read with 0.2 of noise.
SCALAR_STEPS = 30


def cpu_of(function, repeats=15):
    """Median process CPU time of a call in seconds, after one that is not counted."""
    function()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return float(np.median(times))


def speed(console: Console, runs):
    """The whole filter, its kernels, and the resamplers."""
    constants = Constants()
    updates = reference_updates(constants, runs)
    _whole_filter(console, constants, updates)
    _kernels(console, constants)
    _resamplers(console)
    _beside_particles(console)


def reference_updates(constants, runs):
    """CPU seconds per update of the reference, mean of each run of 200 updates."""
    means = []
    for i in track(range(runs), "reference, CPU per update"):
        run = World(constants).simulate(np.random.default_rng([1, i]))
        rng = np.random.default_rng([2, i])
        step = reference.Estimator(None, None, None, constants, rng)
        start = time.process_time()
        for observation, control in zip(run.observations, run.controls, strict=True):
            step = reference.Estimator(step, observation, control, constants, rng)
        means.append((time.process_time() - start) / run.steps)
    return np.array(means)


def _whole_filter(console, constants, updates):
    run = World(constants).simulate(np.random.default_rng([1, 0]))
    start = time.process_time()
    loop_filter(run, constants, np.random.default_rng(4))
    loop = (time.process_time() - start) / (FEW * STEPS)
    own = updates.mean() / reference.COUNT
    table = Table("filter", "CPU per update", "particles x steps per second", "ratio", title="The whole filter")
    table.add_row(f"reference, {reference.COUNT} particles", f"{1e3 * updates.mean():.2f} ms", f"{1 / own:,.0f}", "1")
    table.add_row(
        f"Python loop over the particles, {FEW} of them",
        f"{1e3 * loop * FEW:.2f} ms",
        f"{1 / loop:,.0f}",
        f"{loop / own:.0f} times slower per particle and step",
    )
    console.print(table)
    console.print(
        f"Reference: {len(updates)} runs of 200 updates, slowest run {1e3 * updates.max():.2f} ms per update.\n"
    )


def _kernels(console, constants):
    n, rng = reference.COUNT, np.random.default_rng(5)
    robot, other = twins.robots_on_the_way(n, rng), twins.robots_on_the_way(n, rng)
    states = np.ascontiguousarray(robot[:3].T)
    distance = np.full(n, 1.5 * constants.Ts)
    weights = rng.random(n) ** 3
    weights /= weights.sum()
    parents = resampling.systematic(weights, rng)
    room = constants.room
    pairs = {
        "models.drive": (models.drive, drive_numpy, (states, 0, distance, *room, constants.v_bar, rng)),
        "advance": (reference.advance, twins.advance_numpy, (robot, distance, *room, constants.v_bar, rng)),
        "weigh": (
            reference.weigh,
            twins.weigh_numpy,
            (np.ones(n), robot, other, 3.0, *constants.sensors[0], constants.w_bar, constants.s_bar),
        ),
        "turn_copies": (reference.turn_copies, twins.turn_copies_numpy, (robot, parents, 0.002, *room, rng)),
        "systematic_indices": (resampling.systematic_indices, systematic_numpy, (weights, 0.5, n)),
    }
    table = Table("kernel", "particles per second", "NumPy twin's", "kernel is", title=f"Kernels, {n} particles")
    for name, (kernel, twin, arguments) in pairs.items():
        # Some change their arrays in place: each works on copies of its own.
        fast = cpu_of(partial(kernel, *_copied(arguments)))
        slow = cpu_of(partial(twin, *_copied(arguments)))
        table.add_row(name, f"{n / fast:,.0f}", f"{n / slow:,.0f}", f"{slow / fast:.1f} times faster")
    console.print(table)
    console.print()


def _copied(arguments):
    return [argument.copy() if isinstance(argument, np.ndarray) else argument for argument in arguments]


def _resamplers(console):
    n, rng = 10_000, np.random.default_rng(6)
    weights = rng.random(n) ** 3
    weights /= weights.sum()
    table = Table(
        "scheme", "course_lib.filters", "filterpy.monte_carlo", "course_lib is", title=f"Resamplers, {n} particles"
    )
    for name in ("systematic", "stratified", "multinomial", "residual"):
        scheme, peer = getattr(resampling, name), getattr(filterpy.monte_carlo, f"{name}_resample")
        own, theirs = cpu_of(partial(scheme, weights, rng)), cpu_of(partial(peer, weights), 5)
        table.add_row(name, f"{1e3 * own:.3f} ms", f"{1e3 * theirs:.3f} ms", f"{theirs / own:.1f} times faster")
    console.print(table)
    console.print()


def _beside_particles(console):
    """Systematic resampling and a whole bootstrap step beside Chopin's `particles`, by turns."""
    try:
        import particles
        from particles import distributions, state_space_models
    except ImportError:
        console.print(
            "particles (Chopin) is not installed here: with it, its resampling and its filter stand beside.\n"
        )
        return
    rng = np.random.default_rng(7)
    weights = rng.random(10**6) ** 3
    weights /= weights.sum()

    class Scalar(state_space_models.StateSpaceModel):
        def PX0(self):
            return distributions.Normal()

        def PX(self, t, xp):
            return distributions.Normal(loc=0.9 * xp, scale=0.3)

        def PY(self, t, xp, x):
            return distributions.Normal(loc=x, scale=0.2)

    _, readings = Scalar().simulate(SCALAR_STEPS)

    def their_filter():
        model = state_space_models.Bootstrap(ssm=Scalar(), data=readings)
        particles.SMC(fk=model, N=10**5, resampling="systematic", ESSrmin=0.5).run()

    pairs = {
        "systematic, 10⁶ weights": (
            partial(resampling.systematic, weights, rng),
            partial(particles.resampling.systematic, weights),
            1,
        ),
        "bootstrap step, 10⁵ particles": (partial(_scalar_filter, readings, 10**5, rng), their_filter, SCALAR_STEPS),
    }
    table = Table("", "course_lib.filters", "particles", "course_lib is", title="Beside particles (Chopin)")
    for name, (own, theirs, steps) in pairs.items():
        # By turns, as a machine that others share has slow minutes: the ratio is of neighbours.
        times = np.array([(cpu_of(own, 1), cpu_of(theirs, 1)) for _ in range(15)]) / steps
        own, theirs = 1e3 * np.median(times, axis=0)
        ratio = np.median(times[:, 1] / times[:, 0])
        table.add_row(name, f"{own:.2f} ms", f"{theirs:.2f} ms", f"{ratio:.1f} times faster")
    console.print(table)
    console.print()


def _scalar_filter(readings, n, rng):
    cloud = equally_weighted(rng.standard_normal((n, 1)))
    constant = -np.log(0.2) - 0.5 * np.log(2 * np.pi)
    for reading in readings:
        cloud, _ = bootstrap_step(
            cloud,
            lambda states, rng: 0.9 * states + 0.3 * rng.standard_normal(states.shape),
            lambda states, z=reading: constant - 0.5 * ((z - states[:, 0]) / 0.2) ** 2,
            rng,
        )


def loop_filter(run, constants, rng):
    """The bootstrap filter as one writes it first: a Python loop over the particles."""
    particles = models.prior(FEW, constants, rng).tolist()
    (room_x, room_y), sensors = constants.room.tolist(), constants.sensors.tolist()
    for observation, control in zip(run.observations[:STEPS].tolist(), run.controls[:STEPS].tolist(), strict=True):
        weights = []
        for particle in particles:
            for column, u in ((0, control[0]), (3, control[1])):
                particle[column : column + 3] = _drive_one(
                    *particle[column : column + 3], u * constants.Ts, room_x, room_y, constants.v_bar, rng
                )
            weights.append(_likelihood_of_one(particle, observation, sensors, constants))
        total = sum(weights)
        if total > 0.0:
            particles = _resampled_one_by_one(particles, weights, total, rng)


def _drive_one(x, y, heading, left, room_x, room_y, v_bar, rng):
    while True:
        dx, dy = math.cos(heading), math.sin(heading)
        to_x = (room_x - x) / dx if dx > 0.0 else -x / dx if dx < 0.0 else math.inf
        to_y = (room_y - y) / dy if dy > 0.0 else -y / dy if dy < 0.0 else math.inf
        wall = max(min(to_x, to_y), 0.0)
        step = min(wall, left)
        x, y = min(max(x + step * dx, 0.0), room_x), min(max(y + step * dy, 0.0), room_y)
        if wall >= left:
            return x, y, heading
        left -= wall
        p = 2.0 * rng.random() - 1.0
        noise = v_bar * math.copysign(abs(p) ** (1.0 / 3.0), p)
        if to_x <= to_y:
            after = math.atan2(abs(dx), abs(dy)) * (1.0 + noise)
            heading = math.atan2(math.copysign(1.0, dy) * math.cos(after), -math.copysign(1.0, dx) * math.sin(after))
        else:
            after = math.atan2(abs(dy), abs(dx)) * (1.0 + noise)
            heading = math.atan2(-math.copysign(1.0, dy) * math.sin(after), math.copysign(1.0, dx) * math.cos(after))


def _likelihood_of_one(particle, observation, sensors, constants):
    likelihood = 1.0
    for i, (reading, (x, y)) in enumerate(zip(observation, sensors, strict=True)):
        if math.isinf(reading):
            continue
        to_a = math.hypot(particle[0] - x, particle[1] - y)
        to_b = math.hypot(particle[3] - x, particle[4] - y)
        right, wrong = (to_a, to_b) if i < 2 else (to_b, to_a)
        density_right = max(1.0 - abs(reading - right) / constants.w_bar, 0.0) / constants.w_bar
        density_wrong = max(1.0 - abs(reading - wrong) / constants.w_bar, 0.0) / constants.w_bar
        likelihood *= (1.0 - constants.s_bar) * density_right + constants.s_bar * density_wrong
    return likelihood


def _resampled_one_by_one(particles, weights, total, rng):
    children, cumulative, i = [], weights[0], 0
    shift = rng.random()
    for m in range(len(particles)):
        while cumulative < (m + shift) / len(particles) * total and i < len(weights) - 1:
            i += 1
            cumulative += weights[i]
        children.append(list(particles[i]))
    return children
