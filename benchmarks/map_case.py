"""Measure one map in this process, and print the results as JSON.

`bench_map.py` runs it once a case: the peak memory is then that of the case alone. The kernels
are loaded (and compiled, if they never were) by the map of a small room before any clock starts.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
import numpy as np
import shapely
from harness import ENVIRONMENTS, LEVELS, environment_path
from lasers import laser

from ambinav.ambiguity import reference
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.ambiguity.reach import reach
from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import STEPS, Lattice
from ambinav.geometry.segments import Segments
from ambinav.map_building import build
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing.scanner import RangeScanner

SPACING = 0.1
RADIUS = 0.5
# The parts of the build that are timed apart: names in `ambinav.map_building.build`.
PARTS = ("panorama_returns", "neighbourhood_sums", "turning_moments", "assemble")


def small_room() -> Environment:
    """Return a square room of 3 m."""
    free = shapely.box(0.0, 0.0, 3.0, 3.0)
    ends = np.array(free.exterior.coords)
    return Environment(
        Segments(np.hstack([ends[:-1], ends[1:]]), np.zeros(4, dtype=np.uint8)), free
    )


@contextmanager
def timed_parts() -> Iterator[dict[str, float]]:
    """Sum the seconds spent in each of `PARTS` while the block runs."""
    seconds = dict.fromkeys(PARTS, 0.0)
    originals = {name: getattr(build, name) for name in PARTS}

    def timed(name: str) -> Callable[..., Any]:
        def run(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            result = originals[name](*args, **kwargs)
            seconds[name] += time.perf_counter() - start
            return result

        return run

    for name in PARTS:
        setattr(build, name, timed(name))
    try:
        yield seconds
    finally:
        for name, function in originals.items():
            setattr(build, name, function)


def compared_pairs(env: Environment) -> tuple[int, int]:
    """Count free poses, and the pose pairs that the kernel compares for one heading."""
    lattice = Lattice.over(env, SPACING)
    steps = math.floor(RADIUS / SPACING + 1e-9)
    offsets = np.array(
        [
            (row, column)
            for row in range(-steps, steps + 1)
            for column in range(-steps, steps + 1)
            if (row**2 + column**2) * SPACING**2 <= RADIUS**2 * (1 + 1e-9)
        ]
    )
    pairs = _count_pairs(
        lattice.rows_columns, lattice.index, lattice.links, offsets, 2 * steps + 1, STEPS
    )
    return len(lattice.rows_columns), int(pairs)


@numba.njit
def _count_pairs(rows_columns, index, links, offsets, side, steps):  # type: ignore[no-untyped-def]
    marks = np.empty(side * side, dtype=np.uint8)
    queue = np.empty(side * side, dtype=np.int32)
    pairs = 0
    for p in range(rows_columns.shape[0]):
        row, column = rows_columns[p, 0], rows_columns[p, 1]
        reach(row, column, index, 0, links, offsets, side, steps, marks, queue)
        pairs += (marks == 2).sum()
    return pairs


def peak_memory() -> float:
    """Return the peak resident memory of this process so far, MiB."""
    # Linux counts KiB, macOS bytes.
    unit = 1024**2 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def time_reference(
    env: Environment, scanner: RangeScanner, built: AmbiguityMap, count: int, seed: int
) -> dict[str, Any]:
    """Return the NumPy reference's seconds per pose at random free poses, and the deviation."""
    model = AmbiguityModel(radius=RADIUS, map_std=env.map_std, tau=independent_tau(scanner))
    lattice = Lattice.over(env, SPACING)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(lattice.rows_columns), size=count, replace=False)
    seconds, off = [], 0.0
    for row, column in lattice.rows_columns[chosen]:
        x, y = float(lattice.x[column]), float(lattice.y[row])
        start = time.perf_counter()
        sums = reference.pose_sums(env, scanner, model, SPACING, x, y)
        seconds.append(time.perf_counter() - start)
        off = max(off, abs(float(built.dataset["ambiguity"][row, column]) - float(sums[0])))
    return {"reference": seconds, "off": off}


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Load, prepare and build as often as asked; return all measurements."""
    path = environment_path(args.environment)
    plain = args.scanner == "plain"
    scanner = laser() if plain else RangeScanner.from_preset(args.scanner)
    build_map(small_room(), scanner, SPACING, RADIUS, args.headings, store=False)
    measured: dict[str, Any] = {
        "memory_before": peak_memory(),
        "load": [],
        "prepare": [],
        "build": [],
    }
    parts: dict[str, list[float]] = {name: [] for name in PARTS}
    for _ in range(args.repeats):
        start = time.perf_counter()
        env = load_environment(path, level=LEVELS.get(args.environment))
        loaded = time.perf_counter()
        # Computed lazily; done here, so that it does not count as building.
        _ = env.grid, env.border_lines
        prepared = time.perf_counter()
        with timed_parts() as seconds:
            built = build_map(env, scanner, SPACING, RADIUS, args.headings, store=False)
        measured["build"].append(time.perf_counter() - prepared)
        measured["load"].append(loaded - start)
        measured["prepare"].append(prepared - loaded)
        for name, value in seconds.items():
            parts[name].append(value)
    measured["memory"] = peak_memory()
    measured["parts"] = parts
    measured["threads"] = args.threads
    measured["segments"] = len(env.segments)
    measured["area"] = env.free.area
    measured["poses"], measured["pairs"] = compared_pairs(env)
    measured["beams"] = json.loads(built.dataset.attrs["parameters"])["beams_used"]
    if args.reference_poses:
        measured |= time_reference(env, scanner, built, args.reference_poses, args.seed)
    return measured


def main() -> None:
    """Measure the case that the command line describes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("environment", choices=sorted(ENVIRONMENTS))
    parser.add_argument("--scanner", default="plain", help="plain, or the name of a preset")
    parser.add_argument("--headings", type=int, help="of the map (default: as build_map does)")
    parser.add_argument("--threads", type=int, default=2, help="default: %(default)s")
    parser.add_argument("--repeats", type=int, default=3, help="default: %(default)s")
    parser.add_argument("--reference-poses", type=int, default=0, help="0: leave it out")
    parser.add_argument("--seed", type=int, default=1, help="of the reference's poses")
    args = parser.parse_args()
    if args.threads > numba.config.NUMBA_NUM_THREADS:
        parser.error(
            f"--threads is {args.threads} and numba has {numba.config.NUMBA_NUM_THREADS}; "
            "set NUMBA_NUM_THREADS."
        )
    numba.set_num_threads(args.threads)
    print(json.dumps(measure(args)))


if __name__ == "__main__":
    main()
