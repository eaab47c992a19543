"""CPU time of the DR20's five beams, for clouds of three sizes: exact ray casting, what it replaces, and tables."""

import time

import numba
import numpy as np
import shapely
from rich.progress import track
from rich.table import Table

from course_lib.dr20.constants import Constants
from course_lib.dr20.report.listing import detect_obstacles, half_metre_lines
from course_lib.geometry import lookup
from course_lib.geometry.polygons import inside
from course_lib.geometry.raycast import cast_fan
from tests.course_lib.geometry import raycast_twin

SIZES = 1_000, 10_000, 100_000
#: Steps of a march along the rays, in metres; it may step over a corner.
STEP = 0.05
#: Cells in metres and directions of the tables; the second is the one that is timed beside the others.
TABLES = (0.1, 90), (0.05, 180), (0.025, 360)
#: Poses that NumPy casts at a time, so that its intermediate results stay in the caches.
BLOCK = 500
#: Shortest time that is measured, in seconds: calls are repeated until they take it.
SHORTEST = 0.02


def raycasting(console, runs):
    """The least of `runs` measurements; ratios are to our own kernel on one core."""
    constants = Constants()
    walls, bearings = constants.walls, np.asarray(constants.bearings)
    poses = _free_poses(max(SIZES), constants, np.random.default_rng(1))
    lines = half_metre_lines(constants)
    table = lookup.build(walls, *TABLES[1])
    threads = f"ours, {numba.get_num_threads()} threads"
    # Each with the largest cloud it is given.
    ways = {
        "ours": (lambda p: cast_fan(p, bearings, walls), 100_000),
        threads: (lambda p: cast_fan(p, bearings, walls, parallel=True), 100_000),
        f"table, {TABLES[1][0]} m, {TABLES[1][1]} directions": (lambda p: lookup.look_up(table, p, bearings), 100_000),
        "NumPy": (lambda p: _with_numpy(p, bearings, walls), 100_000),
        f"marching in NumPy, {100 * STEP:.0f} cm": (lambda p: _marching(p, bearings, walls), 1_000),
        "shapely": (lambda p: _with_shapely(p, bearings, walls), 1_000),
        "the source's way": (lambda p: np.array([detect_obstacles(*pose, lines) for pose in p.tolist()]), 10_000),
    }
    times, elapsed = {}, {}
    for name, (way, largest) in track(ways.items(), "ray casting"):
        for size in (size for size in SIZES if size <= largest):
            times[name, size], elapsed[name, size] = _times(lambda way=way, n=size: way(poses[:n]), runs)
    exact = cast_fan(poses[: SIZES[0]], bearings, walls)
    report = Table(
        "CPU ms of particles",
        *(f"{size:,}" for size in SIZES),
        "ratio",
        "off by > 1 cm",
        "worst",
        title=f"{len(bearings)} rays against {len(walls)} walls",
        caption="≈ is ten times what is left of it. The ratio is of 1,000 particles; errors are theirs.",
    )
    for name, (way, _) in ways.items():
        error = np.abs(way(poses[: SIZES[0]]) - exact)
        report.add_row(
            name,
            *_cells(times, name),
            f"{times[name, SIZES[0]] / times['ours', SIZES[0]]:,.2f}",
            f"{np.mean(error > 0.01):.1%}",
            f"{np.max(error):.2g} m",
        )
        if name == threads:
            report.add_row("  until it is done", *_cells(elapsed, name), "", "", "")
    console.print(report)
    _tables(console, runs, walls, bearings, poses)


def _tables(console, runs, walls, bearings, poses):
    report = Table(
        "cell and step",
        "built in",
        "size",
        f"CPU, {len(poses):,}",
        "off by > 1 cm",
        "median",
        "90 %",
        "99 %",
        "worst",
        title=f"Tables of ranges: error on {len(poses):,} random free poses",
    )
    for cell, directions in track(TABLES, "tables"):
        start = time.process_time()
        table = lookup.build(walls, cell, directions)
        built = time.process_time() - start
        used, _ = _times(lambda table=table: lookup.look_up(table, poses, bearings), runs)
        error = lookup.measured_error(table, walls, poses, bearings)
        report.add_row(
            f"{cell} m, {360 / directions:g}°",
            f"{built:.2f} s",
            f"{table.ranges.nbytes / 1e6:.1f} MB",
            f"{1e3 * used:.2f} ms",
            f"{error.share_off:.1%}",
            *(f"{1e3 * quantile:.1f} mm" for quantile in (error.median, error.q90, error.q99)),
            f"{error.worst:.2f} m",
        )
    console.print(report)


def _cells(times, name):
    """Milliseconds for each size, extrapolated past the last that was measured."""
    cells = []
    for size in SIZES:
        if (name, size) in times:
            milliseconds, sign = 1e3 * times[name, size], ""
        else:
            milliseconds, sign = 10.0 * milliseconds, "≈ "
        cells.append(sign + (f"{milliseconds:.3f}" if milliseconds < 10.0 else f"{milliseconds:,.0f}"))
    return cells


def _times(function, runs):
    """The least CPU and elapsed seconds per call: what others do on the machine only adds."""
    function()
    start = time.perf_counter()
    function()
    calls = max(1, round(SHORTEST / (time.perf_counter() - start)))
    samples = []
    for _ in range(runs):
        used, elapsed = time.process_time(), time.perf_counter()
        for _ in range(calls):
            function()
        samples.append((time.process_time() - used, time.perf_counter() - elapsed))
    return np.min(samples, axis=0) / calls


def _free_poses(count, constants, rng):
    x0, y0, x1, y1 = constants.bounds
    points = rng.uniform([x0, y0], [x1, y1], (2 * count, 2))
    points = points[inside(points, constants.walls)][:count]
    return np.column_stack([points, rng.uniform(-np.pi, np.pi, count)])


def _with_numpy(poses, bearings, walls):
    blocks = np.array_split(poses, max(1, len(poses) // BLOCK))
    return np.vstack([raycast_twin.naive(block[:, :2], block[:, 2:] + bearings, walls) for block in blocks])


def _marching(poses, bearings, walls):
    """Step along each ray until the point is in an obstacle or outside the room."""
    u = raycast_twin.directions(poses[:, 2:] + bearings).reshape(-1, 2)
    origins = np.repeat(poses[:, :2], len(bearings), axis=0)
    ranges, going = np.zeros(len(u)), np.arange(len(u))
    while going.size:
        ranges[going] += STEP
        going = going[inside(origins[going] + ranges[going, None] * u[going], walls)]
    return ranges.reshape(len(poses), -1)


def _with_shapely(poses, bearings, walls):
    obstacles = shapely.MultiLineString(list(walls.reshape(-1, 2, 2)))
    reach = np.hypot(*np.ptp(walls.reshape(-1, 2), axis=0))
    origins = np.broadcast_to(poses[:, None, :2], (len(poses), len(bearings), 2))
    ends = origins + reach * raycast_twin.directions(poses[:, 2:] + bearings)
    met = shapely.intersection(shapely.linestrings(np.stack([origins, ends], axis=2)), obstacles)
    return shapely.distance(shapely.points(origins), met)
