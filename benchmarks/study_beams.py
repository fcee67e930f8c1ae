"""Minimum number of beams: chosen on half of the maps, tested on the other half and in drives.

Stated before the first run:

- Maps: the recorded ones of maps/ and maps_from_logs/ without the huge one and without
  willow_full_010, which is willow_full_005 in coarser cells, and the drawn demo building. By name
  in turns: the first, third ... are chosen on, the others are held out.
- Scanners: the TurtleBot3's LDS (360 beams, 3.5 m), and the RPLIDAR A1 (360 beams, 12 m).
- Loss: `ambinav.studies.design.beams.loss`, with the full scanner as it is, all 360 beams.
- Must hold: with 90 beams chosen on the first half no zone's share of the explored, reachable
  floor of any held-out map changes by more than 5 points; whole maps, not samples.
- Rivals with as many beams: spread evenly, and drawn at random.
- Drives: on held-out maps, 30 seeds, the same with all and with fewer beams, closed loop, odometry
  of 4.5 degrees and 6 cm in a metre. The localizer's error (root mean square of the position) with
  90 beams is within 10 % where the whole interval of 95 % of its ratio is.

Added after the first drives, which by mistake had twice that odometry's errors: these stay, beside
the others, and errors are also given of the runs in which neither robot of a pair was lost, since a
few lost ones decide a mean; and Monte Carlo localization that takes every beam, since by default
(max_beams 60) it takes 60 of 360 beams, but all of 90. Then drives in buildings whose walls are off
the map by what it is said to be good for (`map_std`), in waves of 1 to 3 m: in a building that is
its map to the micrometre every beam errs by itself, and more of them always help.
"""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from beams_tables import (
    ALL_BEAMS,
    AS_MAPPED,
    DRIVE_LOCALIZERS,
    KEY,
    LIMIT,
    PLACES,
    QUARTER,
    RUNS,
    WARPED,
    drives_part,
    maps_part,
    small_part,
    times_part,
)
from harness import (
    ENVIRONMENTS,
    appended,
    arguments,
    environment_of,
    environment_path,
    kept_rows,
    option,
    report,
)
from localizers import ROBOT, localizer_of, parameters_of
from numpy.typing import NDArray

from ambinav.buildings.load import load_environment
from ambinav.drive.drive import drive_route
from ambinav.drive.localizers import Localizer
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.localization.parameters import MclParameters
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import UNEXPLORED, ZONES
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.beams.choose import choose
from ambinav.studies.design.beams.localizer import update_times
from ambinav.studies.design.beams.loss import POINTS, Loss
from ambinav.studies.design.beams.sample import MapSample, draw_samples, subset_tau
from ambinav.studies.design.beams.scanner import subset_scanner
from ambinav.studies.design.beams.search import at_random, best_of_all, even, grow, objective

RACE_TRACKS = ("f1_berlin", "f1_vegas")
"""Recorded maps that `harness` does not name."""
NAMES = sorted({*ENVIRONMENTS, *RACE_TRACKS})
CHOSEN_ON, HELD_OUT = NAMES[::2], NAMES[1::2]
SCANNERS = ("turtlebot3-lds", "rplidar-a1")
SIZES = (6, 8, 10, 12, 15, 18, 20, 24, 30, 36, 45, 60, 75, 90)
"""Numbers of beams of the subsets in curves."""
DRAWN = 20
"""Random subsets of each size."""
SPACING, RADIUS, SEED = 0.2, 0.5, 23
DRIVEN = ("demo", "freiburg-079", "intel", "stata_hallways_5cm")
WAVES, WAVE_LENGTHS, PIECE = 60, (1.0, 3.0), 0.25
"""Displacement of walls: number of cosines, their lengths, and length of a piece, metres."""
TENTH = 36
"""Beams of a further subset that is driven."""
PAIRS, ODOMETRIES = 3, (0.25, 0.5)
MARGIN = 0.195
"""Metres that routes keep beside the robot, as in `bench_claim.py`."""
SMALL, SMALL_PLACES = ("demo", "aces", "stata_hallways_5cm"), 100
Row = dict[str, Any]


def main() -> None:
    """Run the missing stages, and report."""
    args = arguments(
        __doc__,
        folder=Path("out/beams"),
        only=option(None, choices=("maps", "small", "times", "drives", "report")),
        scanners=list(SCANNERS),
    )
    stages = {
        "maps": lambda: [on_maps(args.folder, name) for name in args.scanners],
        "small": lambda: small_cases(args.folder),
        "times": lambda: times(args.folder),
        "drives": lambda: drives(args.folder),
    }
    for name, stage in stages.items():
        if args.only in (None, name):
            stage()
    if args.only in (None, "report"):
        write(args.folder, args.scanners, args.out)


def write(folder: Path, scanners: Sequence[str], out: Path | None) -> None:
    """Write the report of the stored stages."""
    driven = subsets_driven(folder)
    parts = [
        str(__doc__).partition("\n\n")[2].strip(),
        f"Chosen on: {', '.join(CHOSEN_ON)}.\nHeld out: {', '.join(HELD_OUT)}.",
        *(maps_part(read(folder / f"{name}_maps.json"), name) for name in scanners),
        small_part(read(folder / "small.json"), SMALL_PLACES),
        drives_part(kept_rows(folder / "drives.jsonl"), [*driven][1:], SCANNERS[0]),
        times_part(read(folder / "times.json")),
    ]
    report("Fewer beams", ("numpy", "numba", "shapely"), "\n\n".join(parts), out)


def read(path: Path) -> Any:
    """Read the stored result of a stage."""
    return json.loads(path.read_text(encoding="utf-8"))


def keep(path: Path, result: object) -> None:
    """Store the result of a stage."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(result, indent=1), encoding="utf-8")


def environment(name: str) -> Environment:
    """Return one of `NAMES`."""
    if name not in RACE_TRACKS:
        return environment_of(name)
    return load_environment(environment_path("willow_full_005").with_name(f"{name}.yaml"))


def samples_of(names: Sequence[str], scanner: RangeScanner) -> list[tuple[MapSample, ...]]:
    """Return two samples of each map."""
    samples = []
    for name in names:
        env = environment(name)
        reach = find_reach(env, ROBOT.radius)
        rng = np.random.default_rng([SEED, NAMES.index(name)])
        samples.append(
            draw_samples(env, scanner, PLACES, rng, spacing=SPACING, radius=RADIUS, reach=reach)
        )
    return samples


def on_maps(folder: Path, preset: str) -> None:
    """Choose on half of the maps; test on the whole maps of the other half."""
    path = folder / f"{preset}_maps.json"
    if path.is_file():
        return
    scanner = RangeScanner.from_preset(preset)
    sample_pairs = samples_of(CHOSEN_ON, scanner)
    chosen_on, checks = [pair[0] for pair in sample_pairs], [pair[1] for pair in sample_pairs]
    rng = np.random.default_rng(SEED)
    begun = time.perf_counter()
    choice = choose(scanner, chosen_on, checks, LIMIT, rng)
    seconds = time.perf_counter() - begun
    begun = time.perf_counter()
    greedy = next(itertools.islice(grow(chosen_on, rng), QUARTER - 1, None))
    quarter_seconds = time.perf_counter() - begun
    held_out = [pair[0] for pair in samples_of(HELD_OUT, scanner)]
    curves = {
        "greedy": [[n, *worst(checks, greedy[:n]), *worst(held_out, greedy[:n])] for n in SIZES],
        "even": [
            [n, *worst(checks, even(scanner, n)), *worst(held_out, even(scanner, n))] for n in SIZES
        ],
    }
    drawn = [[worst(held_out, at_random(scanner, n, rng))[0] for _ in range(DRAWN)] for n in SIZES]
    subsets = {
        f"even {QUARTER}": even(scanner, QUARTER),
        f"greedy {QUARTER}": tuple(sorted(greedy)),
    }
    few = choice.fewest["even"]
    fewest = {f"even {few}": even(scanner, few)}
    if choice.method == "greedy":
        fewest[f"greedy {len(choice.chosen.beams)}"] = choice.chosen.beams
    rows = {}
    for name in HELD_OUT:
        env = environment(name)
        rows[name] = whole_maps(env, scanner, {**subsets, **fewest})
        print(preset, name, rows[name], flush=True)
    result = {
        "chosen": choice.chosen.beams, "method": choice.method, "fewest": choice.fewest,
        "seconds": seconds, "quarter_seconds": quarter_seconds, "greedy": greedy,
        "sizes": SIZES, "curves": curves, "random": drawn, "held_out": rows,
    }  # fmt: skip
    keep(path, result)


def worst(samples: Sequence[MapSample], beams: Sequence[int]) -> list[float]:
    """Return the points lost on the worst map, and its two parts."""
    loss = Loss.worst(sample.loss(beams) for sample in samples)
    return [loss.points, loss.zones, loss.level]


def whole_maps(
    env: Environment, scanner: RangeScanner, subsets: dict[str, tuple[int, ...]]
) -> dict[str, list[float]]:
    """Return each zone's share with all beams, and the losses with each subset, on a whole map.

    A subset that does not look all around has eight headings: its shares are means over them.
    """
    full = build_map(
        env, scanner, spacing=SPACING, radius=RADIUS, max_beams=scanner.beams, store=False
    )
    counted = counted_floor(env, full)
    shares, level = on_floor(full, counted)
    shares_by_subset = {"full": (POINTS * shares).tolist()}
    for name, beams in subsets.items():
        amap = build_map(
            env, subset_scanner(scanner, beams), spacing=SPACING, radius=RADIUS,
            max_beams=scanner.beams, tau=subset_tau(scanner, len(beams)), store=False,
        )  # fmt: skip
        own_shares, own_level = on_floor(amap, counted)
        if level.ndim < own_level.ndim:
            level = level[..., None]
        shares_by_subset[name] = [
            POINTS * float(np.abs(own_shares - shares).max()),
            POINTS * float(np.nanmean(np.abs(own_level - level))),
        ]
        level = level if level.ndim == 1 else level[..., 0]
    return shares_by_subset


def counted_floor(env: Environment, amap: AmbiguityMap) -> NDArray[np.bool_]:
    """Return the explored cells that the robot reaches."""
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    reached = find_reach(env, ROBOT.radius).reaches(x, y)
    unknown = amap.dataset["unknown"].values
    return np.asarray(reached & (unknown < UNEXPLORED))


def on_floor(
    amap: AmbiguityMap, counted: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each zone's share, and `level` at the counted cells (and each heading)."""
    zone, level = (
        amap.dataset[name].transpose("y", "x", ...).values[counted] for name in ("zone", "level")
    )
    is_floor = zone < len(ZONES)
    shares = np.bincount(zone[is_floor], minlength=len(ZONES)) / is_floor.sum()
    return shares, level.astype(np.float64)


def small_cases(folder: Path) -> None:
    """Compare greedy selection with the best of all subsets, on a ring of 16 sonars."""
    path = folder / "small.json"
    if path.is_file():
        return
    scanner = RangeScanner.from_preset("polaroid-6500-ring")
    rows = []
    for name in SMALL:
        env = environment(name)
        rng = np.random.default_rng([SEED, NAMES.index(name)])
        sample, check = draw_samples(
            env, scanner, SMALL_PLACES, rng, spacing=SPACING, radius=RADIUS
        )
        forward = list(grow([sample], rng, scanner.beams))
        backward = shrink([sample], scanner.beams)
        for count in range(2, 15):
            exact, value = best_of_all([sample], count)
            subsets = {
                "forward": forward[count - 1], "backward": backward[count],
                "even": even(scanner, count), "exact": exact,
            }  # fmt: skip
            row: Row = {"map": name, "beams": count, "exact": value}
            for kind, beams in subsets.items():
                row[kind] = objective([sample], beams)
                row[f"{kind} checked"] = objective([check], beams)
            rows.append(row)
            print(row, flush=True)
    keep(path, rows)


def shrink(samples: Sequence[MapSample], total: int) -> dict[int, tuple[int, ...]]:
    """Select greedily from all beams: remove the one whose removal costs least."""
    remaining = tuple(range(total))
    by_count = {total: remaining}
    while len(remaining) > 1:
        rivals = [remaining[:i] + remaining[i + 1 :] for i in range(len(remaining))]
        remaining = min(rivals, key=lambda beams: objective(samples, beams))
        by_count[len(remaining)] = remaining
    return by_count


def subsets_driven(folder: Path) -> dict[str, tuple[int, ...]]:
    """Return all beams, and the subsets whose drives are compared with theirs."""
    maps = read(folder / f"{SCANNERS[0]}_maps.json")
    scanner = RangeScanner.from_preset(SCANNERS[0])
    return {
        "all": tuple(range(scanner.beams)),
        f"even {QUARTER}": even(scanner, QUARTER),
        f"greedy {QUARTER}": tuple(sorted(maps["greedy"])),
        f"even {TENTH}": even(scanner, TENTH),
    }


def times(folder: Path) -> None:
    """Measure a localizer's update with all and with fewer beams."""
    path = folder / "times.json"
    if path.is_file():
        return
    scanner = RangeScanner.from_preset(SCANNERS[0])
    rows = []
    for name, beams in subsets_driven(folder).items():
        if name != "all":
            rng = np.random.default_rng(SEED)
            for timing in update_times(
                environment("demo"), scanner, subset_scanner(scanner, beams), rng
            ):
                rows.append(
                    [
                        name,
                        timing.localizer,
                        timing.full,
                        timing.kept,
                        timing.ratio,
                        timing.lowest,
                        timing.highest,
                    ]
                )
    keep(path, rows)


def warped(env: Environment, rng: np.random.Generator) -> Environment:
    """Return the building with walls off the map by its `map_std`, in waves of 1 to 3 m.

    What a map made by a robot is like: beams that see the same stretch of wall err together.
    """
    angle, phase = rng.uniform(0.0, 2 * np.pi, (2, 2, WAVES))
    number = 2 * np.pi / np.exp(rng.uniform(*np.log(WAVE_LENGTHS), (2, WAVES)))

    def moved(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        off = [
            np.cos(number[k] * (xy[:, :1] * np.cos(angle[k]) + xy[:, 1:] * np.sin(angle[k]))
                   + phase[k]).sum(axis=1)
            for k in (0, 1)
        ]  # fmt: skip
        return np.asarray(xy + env.map_std * np.sqrt(2.0 / WAVES) * np.stack(off, axis=1))

    def split(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        # The same points from either end, so that segments and the border stay one.
        if tuple(b) < tuple(a):
            return split(b, a)[::-1]
        pieces = max(int(np.ceil(np.hypot(*(b - a)) / PIECE)), 1)
        return moved(a + (b - a) * np.linspace(0.0, 1.0, pieces + 1)[:, None])

    def ring(coordinates: Any) -> NDArray[np.float64]:
        edges = itertools.pairwise(np.asarray(coordinates))
        return np.concatenate([split(a, b)[:-1] for a, b in edges])

    parts = shapely.get_parts(env.free)
    free = shapely.MultiPolygon([
        (ring(polygon.exterior.coords), [ring(hole.coords) for hole in polygon.interiors])
        for polygon in parts
    ])  # fmt: skip
    if not free.is_valid:  # where walls are thin their two sides may cross: another draw
        return warped(env, rng)
    each = [split(segment[:2], segment[2:]) for segment in env.segments.xy]
    xy = np.concatenate([np.hstack([points[:-1], points[1:]]) for points in each])
    kind = np.repeat(env.segments.kind, [len(points) - 1 for points in each])
    return Environment(Segments(xy, kind), free, name=f"{env.name}, warped")


def localizer(
    kind: str, env: Environment, scanner: RangeScanner, noise: OdometryNoise
) -> MclParameters | Localizer:
    """Return one of `DRIVE_LOCALIZERS`."""
    if kind == ALL_BEAMS:
        return replace(parameters_of("product", scanner, noise), max_beams=scanner.beams)
    return localizer_of(kind, env, scanner, noise, RUNS)


def drives(folder: Path) -> None:
    """Drive shortest routes of held-out maps with all and with fewer beams."""
    from plan_case import pairs

    from ambinav.service.service import AmbiguityService
    from ambinav_planners import RoutePlanner

    scanner = RangeScanner.from_preset(SCANNERS[0])
    path = folder / "drives.jsonl"
    finished = {tuple(row[name] for name in KEY) for row in kept_rows(path)}
    with appended(path) as append:
        for name in DRIVEN:
            env = environment(name)
            worlds = {AS_MAPPED: env, WARPED: warped(env, np.random.default_rng(SEED))}
            service = AmbiguityService(build_map(env, scanner, spacing=SPACING, store=False))
            robot = RoutePlanner(service, footprint=ROBOT.radius + MARGIN)
            for pair, (start, goal) in enumerate(pairs(robot, PAIRS, SEED)):
                route = None
                cases = itertools.product(
                    worlds.items(), ODOMETRIES, subsets_driven(folder).items(), DRIVE_LOCALIZERS
                )
                for (walls, world), scale, (beams, subset), kind in cases:
                    key = (name, pair, walls, scale, beams, kind)
                    if key in finished or (
                        scale != ODOMETRIES[0] and (kind == ALL_BEAMS or world is not env)
                    ):
                        continue
                    if route is None:
                        route = robot.plan(start, goal, planner_name="reference", weight=0.0)
                    reduced, noise = subset_scanner(scanner, subset), OdometryNoise(scale=scale)
                    driven = drive_route(
                        env, reduced, ROBOT, route, localizer(kind, env, reduced, noise),
                        np.random.default_rng([SEED, pair]), RUNS, noise=noise, world=world,
                    )  # fmt: skip
                    measured = metrics(driven)
                    append({
                        **dict(zip(KEY, key, strict=True)), "length": route.length,
                        "rmse": np.round(measured.position_rmse, 5).tolist(),
                        "lost": np.asarray(measured.lost).astype(int).tolist(),
                    })  # fmt: skip
                    print(*key, float(np.mean(measured.position_rmse)), flush=True)


if __name__ == "__main__":
    main()
