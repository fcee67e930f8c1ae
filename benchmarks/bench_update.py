"""Maps of a changed building: `AmbiguityMap.update` against a whole build, time and values.

Walls of 2 m are put at random on the floor, one in the middle of the widest room; posts all over
it, all at once; and the middle of the longest wall is moved into the widest room. The changed
building is made before the clock starts, for the update and for the build each time anew, and the
map is one that was just opened. They run by turns, and every layer of the two maps is compared.
Processor time is that of all threads.
"""

from __future__ import annotations

import argparse
import functools
import math
import sys
import time
from collections.abc import Callable, Iterator

import numba
import numpy as np
import shapely
import xarray as xr
from harness import arguments, environment_of, option, report, spread, table
from lasers import laser
from shapely.ops import substring

import ambinav as an
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.segments import WALL

LENGTH = 2.0
# A wall that is taken away leaves as much floor on both sides, metres.
ASIDE = 0.2
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


def moved_wall(env: an.Environment, panel: Obstacle) -> an.Environment:
    """Return the building without `LENGTH` of its longest wall, and with the panel."""
    walls = env.segments.xy[env.segments.kind == WALL]
    ax, ay, bx, by = walls[np.argmax(np.hypot(*(walls[:, 2:] - walls[:, :2]).T))].tolist()
    wall = shapely.LineString([(ax, ay), (bx, by)])
    part = substring(wall, (wall.length - LENGTH) / 2, (wall.length + LENGTH) / 2)
    return env.edited([panel], part.buffer(ASIDE, cap_style="flat"))


def timed(run: Callable[[], an.AmbiguityMap]) -> tuple[an.AmbiguityMap, float, float]:
    """Make a map; return it, wall-clock seconds and processor seconds."""
    start, used = time.perf_counter(), time.process_time()
    amap = run()
    return amap, time.perf_counter() - start, time.process_time() - used


def random_posts(env: an.Environment, count: int, rng: np.random.Generator) -> list[Obstacle]:
    """Draw posts of 0.2 m in the free space."""
    posts: list[Obstacle] = []
    while len(posts) < count:
        x, y = rng.uniform(env.bounds[:2], env.bounds[2:]).tolist()
        if env.is_free(x, y, 0.6):
            posts.append(Obstacle.post(x, y, 0.2))
    return posts


def difference(first: an.AmbiguityMap, second: an.AmbiguityMap) -> float:
    """Return the greatest difference in any variable; inf where only one map has a value."""
    worst = 0.0
    for name, values in first.dataset.variables.items():
        a, b = (np.asarray(v.values, dtype=np.float64) for v in (values, second.dataset[name]))
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


def changes_of(
    env: an.Environment, walls: int, posts: list[int], moved: bool, seed: int
) -> Iterator[tuple[str, Callable[[], an.Environment]]]:
    """Yield a title of each change, and what makes the changed building."""
    drawn = random_walls(env, max(walls, 1), np.random.default_rng(seed))
    for k, ends in enumerate(drawn[:walls]):
        added = [Obstacle.panel(*ends)]
        yield f"random {k}" if k else "widest room", functools.partial(env.edited, added)
    for count in posts:
        added = random_posts(env, count, np.random.default_rng(seed))
        title = "1 post" if count == 1 else f"{count} posts"
        yield title, functools.partial(env.edited, added)
    if moved:
        yield "moved wall", functools.partial(moved_wall, env, Obstacle.panel(*drawn[0]))


def rows_of(
    place: str, name: str, args: argparse.Namespace
) -> tuple[list[tuple[object, ...]], list[tuple[object, ...]]]:
    """Return a scanner's lines of the summary, and one line for each change."""
    env, scanner = building_and_scanner(environment_of(place), name, args.extrude)
    first = an.build_map(env, scanner, store=False)
    cells = int((first.dataset["free"].values > 0).sum())
    # Update by build, in seconds on the clock and of the processor.
    ratios: list[tuple[float, float]] = []
    lines: list[tuple[object, ...]] = []
    changes = changes_of(env, args.walls, args.posts, args.moved, args.seed)
    for title, changed in changes:
        print(f"{place}, {name}: {title}", file=sys.stderr)
        seconds = np.empty((args.repeats, 2, 2))
        for row in seconds:
            after, *row[0] = timed(functools.partial(opened(first).update, changed()))
            fresh, *row[1] = timed(functools.partial(an.build_map, changed(), scanner, store=False))
        update, build = seconds.min(axis=0)
        # A wall that is moved may leave a lattice of another extent.
        levels = xr.align(*(amap.floor("level") for amap in (first, after)), join="outer")
        old, new = (np.nan_to_num(level.values) for level in levels)
        moved = int((np.abs(old - new) > 1e-6).sum())
        clock, processor = (update / build).tolist()
        ratios.append((clock, processor))
        lines.append(
            (
                place, name, title, f"{moved / cells:.1%}",
                *(f"{value:.2f}" for value in (*update, *build)),
                f"{clock:.3f}", f"{processor:.3f}", f"{difference(after, fresh):.1e}",
            )
        )  # fmt: skip
    reach = f"{scanner.max_range:g} m, {first.dataset.sizes.get('theta', 1)}"
    summary: list[tuple[object, ...]] = []
    for seconds_of, values in zip(
        ("wall clock", "processor"), zip(*ratios, strict=True), strict=True
    ):
        walls = spread(values[: args.walls], 3) if args.walls else ""
        summary.append((place, name, reach, seconds_of, walls, spread(values, 3)))
    return summary, lines


def opened(amap: an.AmbiguityMap) -> an.AmbiguityMap:
    """Return the map without what it has computed from its dataset."""
    return an.AmbiguityMap(amap.dataset)


def main() -> None:
    """Measure as the command line says, and report."""
    args = arguments(
        __doc__,
        maps=("willow_full_005",),
        scanners=SCANNERS,
        walls=6,
        posts=option((12,), "numbers of posts, each put up at once"),
        moved=option(False, "move a wall, too"),
        repeats=option(3, "updates and builds by turns, of which the fastest"),
        seed=23,
        extrude=option(0.0, "height of walls, metres, for a building in space"),
    )
    numba.set_num_threads(2)
    # Kernels are made before the clock starts.
    for name in args.scanners:
        env, scanner = building_and_scanner(environment_of("demo"), name, args.extrude)
        amap = an.build_map(env, scanner, 0.5, 1.0, store=False)
        amap.update(
            env.edited([Obstacle.panel(*random_walls(env, 1, np.random.default_rng(0))[0])])
        )
    summary: list[tuple[object, ...]] = []
    lines: list[tuple[object, ...]] = []
    for place in args.maps:
        for name in args.scanners:
            summary_rows, place_lines = rows_of(place, name, args)
            summary += summary_rows
            lines += place_lines
    header = ("map", "scanner", "range, headings", "seconds", "update by build", "all changes")
    every = (
        "map", "scanner", "change", "cells whose level moves", "update, s", "processor, s",
        "build, s", "processor, s", "update by build", "processor, update by build",
        "greatest difference",
    )  # fmt: skip
    where = ", ".join(args.maps) + (f", {args.extrude:g} m high" if args.extrude else "")
    body = (
        f"{where}; seed {args.seed}; the fastest of {args.repeats} updates by the fastest of as "
        f"many builds, after a wall and after all changes.\n\n{table(header, summary, words=4)}\n\n"
        f"## Each change\n\n{table(every, lines, words=3)}"
    )
    libraries = ("ambinav", "numba", "numpy", "shapely")
    report("Maps of a changed building", libraries, body, args.out)


if __name__ == "__main__":
    main()
