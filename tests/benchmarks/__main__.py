"""`make bench`: every benchmark, or those named: `python -m tests.benchmarks speed optimality --runs 2`."""

import argparse
import os
import sys

from rich.console import Console

from tests.benchmarks import (
    accuracy,
    beacon_accuracy,
    beacon_planning,
    beacon_speed,
    dr20_accuracy,
    dr20_recorded,
    dr20_speed,
    drawn,
    overhead,
    raycasting,
    recorded,
    sequential,
    speed,
    timing,
)

#: Benchmark and the number of runs it takes.
BENCHMARKS = {
    "speed": (speed.speed, 3),
    "defaults": (accuracy.defaults, 200),
    "variants": (accuracy.variants, 20),
    "optimality": (accuracy.optimality, 50),
    "drawn": (drawn.drawn, 40),
    "timing": (timing.timing, 100),
    "planning": (beacon_planning.beacon_planning, 1000),
    "overhead": (overhead.overhead, 50),
    "sequential": (sequential.sequential, 2000),
    "recorded": (recorded.recorded, 5),
    "beacon": (beacon_accuracy.beacon, 200),
    "beacon-speed": (beacon_speed.beacon_speed, 3),
    "dr20": (dr20_accuracy.dr20, 200),
    "dr20-speed": (dr20_speed.dr20_speed, 5),
    "dr20-recorded": (dr20_recorded.dr20_recorded, 20),
    "raycasting": (raycasting.raycasting, 9),
}


def main():
    """Run the benchmarks that were asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description="Accuracy and speed.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"any of {', '.join(BENCHMARKS)}; all when left out")
    parser.add_argument("--runs", type=int, help="recorded runs per benchmark (at least 2), in place of its own number")
    parser.add_argument("--data", metavar="FOLDER", help="recordings of real robots; COURSE_DATA when left out")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(BENCHMARKS):
        parser.error(f"no benchmark called {', '.join(sorted(unknown))}: choose from {', '.join(BENCHMARKS)}")
    if arguments.runs is not None and arguments.runs < 2:
        parser.error("--runs must be at least 2: one run has no standard deviation")
    if arguments.data:
        os.environ["COURSE_DATA"] = arguments.data
    # Piped into a file, there is no width to ask for.
    console = Console(width=None if sys.stdout.isatty() else 110)
    for name in arguments.names or BENCHMARKS:
        benchmark, runs = BENCHMARKS[name]
        benchmark(console, arguments.runs or runs)


if __name__ == "__main__":
    main()
