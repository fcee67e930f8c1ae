"""One building of `lost-routes` (`bench_lost.py`): robots that drive sampled routes.

A file a drive: `FOLDER/BUILDING/SCANNER_ROUTE_ODOMETRY_LOCALIZER_WORLD_LOOP.npz` with

- `poses` (n, 3): poses along the route, x, y (metres) and heading (radians), map frame: in open
  loop the true ones at the samples;
- `distance` (n,): metres along the route;
- `error` (R, samples, 3), float32: estimate less truth, metres and radians, nan after a run's end;
- `lost_at` (R,): metres along the route (closed loop: driven) at which it had been lost for a
  second (`drive.metrics`), nan if it never was.

Files that are there are not driven again, so it can be stopped at any time.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path

import numba
import numpy as np
from harness import environment_of, recorded_maps
from localizers import LOCALIZERS, ROBOT, localizer_of
from numpy.typing import NDArray
from truth_case import MIXED, PLANAR, aged, scanner_of

from ambinav.buildings.load import load_environment
from ambinav.drive import odometries
from ambinav.drive.drive import drive_route
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.schedule import scheduled
from ambinav.geometry.collision.reach import reach_of
from ambinav.geometry.environment import Environment
from ambinav.routes.route import Route
from ambinav.routes.sampled import path_length, sample_routes
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing
from ambinav_envs.buildings.suites import suite

ODOMETRIES = {
    **{name: odometries.ODOMETRIES[name] for name in ("good", "mediocre", "poor")},
    "skid": OdometryNoise(alpha1=0.4, alpha2=0.1, alpha3=0.8, alpha4=0.4, scale=0.4),
}
"""Odometries of the robots, known to the localizers: errors of 2, 4 and 9 degrees and 3, 6 and
11 cm in a metre; the last one slips (5 degrees and 18 cm)."""
SCANNERS = ("laser-3m", "laser-4m", "laser-8m", "sonar-ring", "laser-30m", "mixed")
DRAWN = ("hall", "corridor", "office", "warehouse", "loop", "procedural", "cluttered")
"""Suites of which buildings are drawn,"""
VARIANTS = 6
"""so many of each."""
LEFT_OUT = ("stata_tiled_2x9_huge", "willow_full_010")
"""Recorded maps that repeat another one."""
PLANS = ("institute", "duplex", "barcelona_pavilion", "demo")
ROUTES = 8
"""Routes of each scanner in a building; route k has the odometry k modulo 4."""
SHORTEST, LONGEST = 6.0, 70.0
"""Length of routes, metres."""
MARGIN = 0.03
RUNS = 32
SPEED = FollowerParameters().desired_linear_vel
EVERY = 5
"""Samples of a drive, of which one is kept: 0.5 s."""
START_STD = (0.05, 0.05, 0.02)
SEED = 36
WORLDS, LOOPS = ("map", "aged"), ("open", "closed")

Floats = NDArray[np.float64]


def building_names() -> list[str]:
    """Return the names of all buildings, recorded and planned ones first."""
    recorded = [path.stem for path in recorded_maps() if path.stem not in LEFT_OUT]
    return [*recorded, *PLANS, *(f"{name}-{k}" for k in range(1, VARIANTS + 1) for name in DRAWN)]


def building(name: str) -> Environment:
    """Return a building of `building_names`."""
    family, _, number = name.rpartition("-")
    if family in DRAWN:
        return suite(family).building(int(number))
    if name in PLANS:
        return environment_of(name)
    return load_environment(recorded_maps([name])[0])


def rng_of(*words: str | int) -> np.random.Generator:
    """Return random numbers of their own for a purpose."""
    return np.random.default_rng([SEED, *(zlib.crc32(str(word).encode()) for word in words)])


def routes_of(environment: Environment, name: str) -> tuple[Route, ...]:
    """Sample `ROUTES` shortest routes of fair length; fewer where the building has none."""
    reach = reach_of(environment, ROBOT.radius + MARGIN)
    drawn = sample_routes(environment, reach, 4 * ROUTES, rng_of(name, "routes"))
    fair = [route for route in drawn if SHORTEST <= path_length(route) <= LONGEST]
    return tuple(fair[:ROUTES])


def drives_of(args: argparse.Namespace) -> Iterator[tuple[Path, str, int, str, str]]:
    """Yield file, scanner, route, odometry and localizer of each drive of a building."""
    for scanner in args.scanners:
        for k in range(args.routes):
            odometry = list(ODOMETRIES)[k % len(ODOMETRIES)]
            for localizer in args.localizers:
                words = [scanner, str(k), odometry, localizer, args.world, args.loop]
                yield (
                    args.folder / args.building / ("_".join(words) + ".npz"),
                    scanner,
                    k,
                    odometry,
                    localizer,
                )


def main() -> None:
    """Drive what is missing of a building."""
    parser = argparse.ArgumentParser()
    parser.add_argument("building")
    parser.add_argument("--scanners", nargs="+", default=SCANNERS, choices=(*PLANAR, *MIXED))
    parser.add_argument("--localizers", nargs="+", default=["product"], choices=LOCALIZERS)
    parser.add_argument("--routes", type=int, default=ROUTES)
    parser.add_argument("--world", choices=WORLDS, default="map")
    parser.add_argument("--loop", choices=LOOPS, default="open")
    parser.add_argument("--folder", type=Path, default=Path("out/lost"))
    args = parser.parse_args()
    numba.set_num_threads(1)
    pending = [drive for drive in drives_of(args) if not drive[0].exists()]
    if not pending:
        return
    mapped = building(args.building)
    world = mapped if args.world == "map" else aged(mapped, rng_of(args.building, "aged"))
    routes = routes_of(mapped, args.building)
    for path, scanner, k, odometry, localizer in pending:
        if k < len(routes):
            words = (args.building, scanner, k, args.world, args.loop)
            record = driven(
                mapped, world, routes[k], scanner, odometry, localizer, args.loop, words
            )
            if record is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
                with replacing(path) as fresh, open(fresh, "wb") as file:
                    np.savez(file, **record)


def driven(
    mapped: Environment,
    world: Environment,
    route: Route,
    scanner: str,
    odometry: str,
    localizer: str,
    loop: str,
    words: tuple[str | int, ...],
) -> dict[str, Floats] | None:
    """Drive a route; None where its start is not free in the aged world."""
    noise, seen = ODOMETRIES[odometry], scanner_of(scanner)
    guide = localizer_of(localizer, mapped, seen, noise, RUNS)
    try:
        drives = drive_route(
            mapped, seen, ROBOT, route, guide, rng_of(*words), RUNS, world=world, noise=noise,
            open_loop=loop == "open", start_std=START_STD, max_time=400.0,
        )  # fmt: skip
    except InputError as error:
        print(f"{words}: {error}", file=sys.stderr)
        return None
    lost_after = metrics(drives).lost_after
    travelled = drives.travelled()
    step = np.searchsorted(drives.time, np.nan_to_num(lost_after) - 1e-9)
    lost_at = np.where(np.isnan(lost_after), np.nan, travelled[np.arange(RUNS), step])
    poses = scheduled(route.poses, route.steering, ROBOT, SPEED, drives.time[1])
    steps = np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2])
    every = slice(0, None, EVERY)
    return {
        "poses": poses[every],
        "distance": np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))[every],
        "error": drives.errors()[:, every].astype(np.float32),
        "lost_at": lost_at,
    }


if __name__ == "__main__":
    main()
