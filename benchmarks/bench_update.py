"""Maps of a changed building: `AmbiguityMap.update` against a whole build, time and values.

Walls of 2 m are put at random on the floor, one in the middle of the widest room, and in the end
posts all over it, all at once. Timed are the edit and the update together, and a build of the same
changed building, each with nothing prepared but the map before; every layer of the two maps is
compared. Processor time is that of all threads.
"""

from __future__ import annotations

import functools
import math
import os
import sys
import time
from collections.abc import Callable

import numba
import numpy as np
import shapely
from harness import arguments, environment_of, environment_path, option, report, spread, table
from lasers import laser

import ambinav as an
from ambinav.geometry.obstacle import Obstacle

LENGTH = 2.0
SCANNERS = ("plain", "hokuyo-urg-04lx", "rplidar-a1", "hokuyo-ust-20lx", "rplidar-s2")


def scanner_of(name: str) -> an.RangeScanner:
    """Return `plain`, the laser of most benchmarks, or a preset."""
    return laser() if name == "plain" else an.RangeScanner.from_preset(name)


def random_walls(
    env: an.Environment, count: int, rng: np.random.Generator
) -> list[tuple[float, float, float, float]]:
    """Draw walls of `LENGTH` in the free space; the first in the widest room."""
    shapely.prepare(env.free)
    x, y = shapely.get_coordinates(shapely.maximum_inscribed_circle(env.free))[0].tolist()
    walls = [(x, y - LENGTH / 2, x, y + LENGTH / 2)]
    while len(walls) < count:
        x, y = rng.uniform(env.bounds[:2], env.bounds[2:]).tolist()
        angle = float(rng.uniform(0.0, math.pi))
        ends = (x, y, x + LENGTH * math.cos(angle), y + LENGTH * math.sin(angle))
        if env.free.contains(shapely.LineString([ends[:2], ends[2:]])):
            walls.append(ends)
    return walls


def timed(run: Callable[[], an.AmbiguityMap]) -> tuple[an.AmbiguityMap, float, float]:
    """Build a map; return it, wall-clock seconds and processor seconds."""
    start, used = time.perf_counter(), os.times()
    amap = run()
    now = os.times()
    return amap, time.perf_counter() - start, now.user + now.system - used.user - used.system


def random_posts(env: an.Environment, count: int, rng: np.random.Generator) -> list[Obstacle]:
    """Draw posts of 0.2 m in the free space."""
    posts: list[Obstacle] = []
    while len(posts) < count:
        x, y = rng.uniform(env.bounds[:2], env.bounds[2:]).tolist()
        if env.is_free(x, y, 0.6):
            posts.append(Obstacle.post(x, y, 0.2))
    return posts


def edited_map(
    amap: an.AmbiguityMap, env: an.Environment, added: list[Obstacle]
) -> an.AmbiguityMap:
    """Return the map with obstacles."""
    return amap.update(env.edited(added))


def difference(first: an.AmbiguityMap, other: an.AmbiguityMap) -> float:
    """Return the greatest difference in any variable; inf where only one map has a value."""
    worst = 0.0
    for name, values in first.dataset.variables.items():
        a, b = (np.asarray(v.values, dtype=np.float64) for v in (values, other.dataset[name]))
        if a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
            return math.inf
        worst = max(worst, float(np.nan_to_num(np.abs(a - b)).max(initial=0.0)))
    return worst


def building_and_scanner(
    env: an.Environment, name: str, extrude: float
) -> tuple[an.Environment, an.RangeScanner]:
    """Return the building and the scanner, in space if the building gets a height, metres."""
    if extrude:
        return env.in_space(an.extruded(env, extrude)), scanner_of(name).raised(0.3)
    return env, scanner_of(name)


def rows_of(
    path: str, name: str, walls: int, posts: int, repeats: int, seed: int, extrude: float
) -> tuple[list[tuple[object, ...]], list[tuple[object, ...]]]:
    """Return a scanner's line of the summary, and one line for each wall."""
    env, scanner = building_and_scanner(an.load_environment(path), name, extrude)
    first = an.build_map(env, scanner, store=False)
    cells = int((first.dataset["free"].values > 0).sum())
    shares: dict[str, list[float]] = {"wall clock": [], "processor": []}
    lines: list[tuple[object, ...]] = []
    drawn = random_walls(env, walls, np.random.default_rng(seed))
    cases = [[Obstacle.panel(*ends)] for ends in drawn]
    if posts:
        cases.append(random_posts(env, posts, np.random.default_rng(seed)))
    for k, added in enumerate(cases):
        print(f"{name}: case {k + 1} of {len(cases)}", file=sys.stderr)
        again = functools.partial(edited_map, first, env, added)
        made = [timed(again) for _ in range(repeats)]
        after, clock_s, used_s = min(made, key=lambda item: item[2])
        full_map, *built = timed(
            functools.partial(an.build_map, env.edited(added), scanner, store=False)
        )
        took = (clock_s, used_s)
        before = [first.floor("level").values, after.floor("level").values]
        moved = int((np.abs(np.nan_to_num(before[0]) - np.nan_to_num(before[1])) > 1e-6).sum())
        if len(added) == 1:
            for i, clock in enumerate(shares):
                shares[clock].append(took[i] / built[i])
        lines.append(
            (
                name, _title(k, len(added)), f"{moved / cells:.1%}",
                f"{took[0]:.2f}", f"{took[1]:.2f}", f"{built[0]:.2f}", f"{built[1]:.2f}",
                f"{took[1] / built[1]:.3f}", f"{difference(after, full_map):.1e}",
            )
        )  # fmt: skip
    reach = f"{scanner.max_range:g} m, {first.dataset.sizes.get('theta', 1)}"
    summary: list[tuple[object, ...]]
    summary = [(name, reach, clock, spread(values, 3)) for clock, values in shares.items()]
    return summary, lines


def _title(number: int, obstacles: int) -> str:
    if obstacles > 1:
        return f"{obstacles} posts"
    return "widest room" if number == 0 else f"random {number}"


def main() -> None:
    """Measure as the command line says, and report."""
    args = arguments(
        __doc__,
        map="willow_full_005",
        scanners=SCANNERS,
        walls=6,
        posts=12,
        repeats=option(3, "updates, of which the fastest"),
        seed=23,
        extrude=option(0.0, "height of walls, metres, for a building in space"),
    )
    numba.set_num_threads(2)
    path = str(environment_path(args.map))
    # Kernels are made before the clock starts.
    small = environment_of("demo")
    for name in args.scanners:
        env, scanner = building_and_scanner(small, name, args.extrude)
        amap = an.build_map(env, scanner, 1.0, 2.0, store=False)
        edited_map(amap, env, [Obstacle.panel(*random_walls(env, 1, np.random.default_rng(0))[0])])
    summary: list[tuple[object, ...]] = []
    lines: list[tuple[object, ...]] = []
    for name in args.scanners:
        summary_rows, more = rows_of(
            path, name, args.walls, args.posts, args.repeats, args.seed, args.extrude
        )
        summary += summary_rows
        lines += more
    header = ("scanner", "range, headings", "seconds", "update by build")
    every = (
        "scanner", "put up", "cells whose level moves", "update, s", "processor, s", "build, s",
        "processor, s", "processor, update by build", "greatest difference",
    )  # fmt: skip
    where = f"{args.map}, {args.extrude:g} m high" if args.extrude else args.map
    body = (
        f"{args.walls} walls of {LENGTH:g} m on {where}, seed {args.seed}; edit and update, the "
        f"fastest of {args.repeats}, by one build.\n\n{table(header, summary, words=3)}\n\n"
        f"## Each change\n\n{table(every, lines, words=2)}"
    )
    libraries = ("ambinav", "numba", "numpy", "shapely")
    report("Maps of a changed building", libraries, body, args.out)


if __name__ == "__main__":
    main()
