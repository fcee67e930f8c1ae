"""One environment and scanner of `bench_truth.py`: poses and short drives about them.

One line of JSON a pose, appended to a file in `--folder`; poses that are there are not driven
again, so it can be stopped at any time and goes on where it was.

It runs in a process of its own, on one thread, so that two of them run at a time on two cores.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
from harness import appended, environment_of, kept_rows
from lasers import laser
from localizers import LOCALIZERS, ROBOT, localizer_of
from numpy.typing import ArrayLike, NDArray

from ambinav.drive.ageing import with_aged_walls
from ambinav.drive.clutter import scattered_boxes, with_obstacles
from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.localizer_spec import ChosenLocalizer
from ambinav.drive.localizers import Localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.filter_state import filter_state
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.localization.random import states
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.runtime.files import replacing
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.service.service import AmbiguityService

NOISE = OdometryNoise(scale=0.5)
"""Poor odometry, 9 degrees and 11 cm in a metre, so that 12 m of it are worse than 0.3 m."""
REACH = 0.4
"""The robot stays within this distance of its pose, metres: inside the map's neighbourhood."""
LENGTH = 12.0
"""Metres that it drives there,"""
UNKNOWN_LENGTH = 4.0
"""or so many where its start is unknown to it: it finds itself in the first or not at all."""
RATE = 5.0
FOUND = 0.5
"""A robot within this distance of where it believes it is has found itself, metres."""
START_STD = (0.05, 0.05, 0.03)
BOXES_PER_AREA = 0.04
"""In the aged world: boxes that the map does not know, per square metre."""
WALLS_OFF = 0.03
"""There too: how far walls stand from where the map has them, metres in x and in y (standard
deviation)."""
PARTICLES_PER_AREA = {"laser-4m": 250.0, "laser-8m": 1000.0}
"""With an unknown start, on a square metre of free floor, for the first scan;"""
PARTICLES = 5000
"""and at most so many from then on."""

WORLD_STREAM, PLACES_STREAM, PLACE_STREAM = range(3)
"""Purposes of random numbers; every seed has a stream for each."""
MOST_PLACES = 2000
"""Number of stored poses, more than will ever be driven about."""

TAKEN_OVER = ("anchor", "base", "base_covariance", "mean", "covariance", "averages", "ticks")
"""Fields of a filter's state beside its particles and their number."""

PLANAR = {"laser-30m": 30.0, "laser-8m": 8.0, "laser-4m": 4.0, "laser-3m": 3.0}
SONAR = RangeSensor(
    name="sonar", aperture=math.radians(30.0), min_range=0.15, max_range=3.0, resolution=0.01,
    std=0.02, max_incidence=math.radians(25.0), random_share=0.05,
)  # fmt: skip
"""Sonar of a small robot, with a range of 3 m."""
CAMERA = RangeSensor(name="depth camera", min_range=0.45, max_range=4.0, resolution=0.005, std=0.02)
MIXED = ("sonar-ring", "mixed")

Floats = NDArray[np.float64]


def main() -> None:
    """Choose poses, drive about each, and append a line of JSON for it to a file."""
    parser = argparse.ArgumentParser()
    parser.add_argument("environment")
    parser.add_argument("scanner", choices=(*PLANAR, *MIXED))
    parser.add_argument("--localizer", choices=LOCALIZERS, default="product")
    parser.add_argument("--poses", type=int, default=60)
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--seed", type=int, default=23)
    parser.add_argument("--world", choices=("map", "aged"), default="map")
    parser.add_argument("--start", choices=("known", "unknown"), default="known")
    parser.add_argument("--folder", type=Path, default=Path("out/truth"))
    args = parser.parse_args()
    if args.start == "unknown" and args.localizer in ("kalman", "pfilter"):
        parser.error(
            f"--localizer {args.localizer} needs to know where it starts; give another one"
        )
    path = drives_path(args.folder, args.environment, args.scanner, args)
    with appended(path) as append:
        rows = kept_rows(path)
        if len(rows) < args.poses:
            add_places(args, {int(row["place"]) for row in rows}, append)


def drives_path(folder: Path, environment: str, scanner: str, args: argparse.Namespace) -> Path:
    """Return the file of a case's drives; further poses are appended to it."""
    words = [environment, scanner, args.localizer, args.world, args.start]
    return folder / "_".join([*words, f"{args.runs}-runs", f"seed-{args.seed}_drives.jsonl"])


def add_places(
    args: argparse.Namespace, finished: set[int], append: Callable[[dict[str, Any]], None]
) -> None:
    """Drive about new poses until there are as many as asked for.

    What a place's drives are does not depend on where an earlier process was stopped: each place
    has random numbers of its own, and the same for each localizer.
    """
    numba.set_num_threads(1)
    mapped = environment_of(args.environment)
    scanner = scanner_of(args.scanner)
    if args.world == "aged":
        world = aged(mapped, np.random.default_rng([args.seed, WORLD_STREAM]))
    else:
        world = mapped
    checker = CollisionChecker(world, ROBOT.footprint, Steering())
    has_start = args.start == "known"
    localizer = made(args, mapped, scanner)
    # A route needs a map for its figures, which are not used.
    coarse = AmbiguityService(build_map(mapped, scanner_of("laser-4m"), spacing=0.5, store=False))
    for number, place in enumerate(kept_places(args, mapped, scanner, checker)):
        if len(finished) == args.poses:
            return
        rng, localizer_rng = np.random.default_rng([args.seed, PLACE_STREAM, number]).spawn(2)
        if number in finished:
            continue
        strokes = wander(place, LENGTH if has_start else UNKNOWN_LENGTH, checker, rng)
        if strokes is None:
            continue
        route = evaluate_route(coarse, strokes, Steering(), planner="wander")
        if isinstance(localizer, MonteCarloLocalizer):
            reseed(localizer, localizer_rng)
        drives = driven(mapped, scanner, route, localizer, world, rng, args.runs)
        append({"place": number, "x": float(place[0]), "y": float(place[1]), **measured(drives)})
        finished.add(number)
    print(f"{len(finished)} poses of {args.poses} found room", file=sys.stderr)


def kept_places(
    args: argparse.Namespace, mapped: Environment, scanner: RangeScanner, checker: CollisionChecker
) -> Floats:
    """Return poses in the order in which they are tried, shape (N, 3), new or stored."""
    words = [args.environment, args.scanner, args.world, f"seed-{args.seed}_places.csv"]
    path = args.folder / "_".join(words)
    if not path.is_file():
        rng = np.random.default_rng([args.seed, PLACES_STREAM])
        poses = places(build_map(mapped, scanner, store=False), checker, rng)[:MOST_PLACES]
        with replacing(path) as fresh:
            np.savetxt(fresh, poses, fmt="%.6f", delimiter=",")
    return np.array(np.loadtxt(path, delimiter=",", ndmin=2), dtype=np.float64)


def made(
    args: argparse.Namespace, mapped: Environment, scanner: RangeScanner
) -> ChosenLocalizer | MonteCarloLocalizer | Localizer:
    """Return the localizer, for all poses."""
    localizer = localizer_of(args.localizer, mapped, scanner, NOISE, args.runs, RATE)
    if not isinstance(localizer, MclParameters):
        return localizer
    kind = MonteCarloLocalizer if args.start == "known" else Unstarted
    return kind(mapped, scanner, localizer, runs=args.runs, rng=np.random.default_rng(0))


def reseed(localizer: MonteCarloLocalizer, rng: np.random.Generator) -> None:
    """Reset a localizer's random numbers as if it had just been made."""
    filters = [localizer]
    if isinstance(localizer, Unstarted):
        filters.append(localizer.seeking)
    for particle_filter in filters:
        particle_filter.state = filter_state(
            particle_filter.parameters, particle_filter.runs, states(rng, particle_filter.runs)
        )


class Unstarted(MonteCarloLocalizer):
    """A localizer that does not know its start.

    The first scan is taken in by a filter of many more particles, spread anywhere, for one run
    after the other.
    """

    def __init__(
        self,
        environment: Environment,
        scanner: RangeScanner,
        parameters: MclParameters,
        *,
        runs: int,
        rng: np.random.Generator,
    ) -> None:
        """Create a `MonteCarloLocalizer`; `parameters` get the number of particles."""
        later = replace(parameters, max_particles=PARTICLES)
        super().__init__(environment, scanner, later, runs=runs, rng=rng)
        particles = max(round(PARTICLES_PER_AREA[scanner.name] * environment.free.area), PARTICLES)
        first = replace(parameters, max_particles=particles)
        self.seeking = MonteCarloLocalizer(environment, scanner, first, runs=1, rng=rng)
        self.new = True

    def start(self, poses: ArrayLike, covariance: ArrayLike | None = None) -> None:
        """Begin anywhere in the map, whatever the pose."""
        self.start_globally()
        self.new = True

    def update(self, odometry: ArrayLike, ranges: ArrayLike) -> NDArray[np.bool_]:
        """Update with scans; the first one uses all the particles."""
        if not self.new:
            return super().update(odometry, ranges)
        self.new = False
        for run in range(self.runs):
            self.seeking.start_globally()
            self.seeking.update(np.asarray(odometry)[run], np.asarray(ranges)[run])
            sought, state = self.seeking.state, self.state
            # They are drawn in the order of van der Corput's sequence: the first so many of them
            # stand for all.
            count = min(int(sought.number[0]), PARTICLES)
            state.number[run] = count
            state.particles[run, :count] = sought.particles[0, :count]
            for name in TAKEN_OVER:
                getattr(state, name)[run] = getattr(sought, name)[0]
        return np.ones(self.runs, dtype=np.bool_)


def scanner_of(name: str) -> RangeScanner:
    """Return 60 beams all around; 8 sonars; or these and a depth camera that looks ahead."""
    if name in PLANAR:
        return laser(PLANAR[name], 0.02, name=name)
    ring = RangeScanner.ring(SONAR, 8, 0.1, name=name)
    if name == "sonar-ring":
        return ring
    camera = RangeScanner.planar(
        sensor=CAMERA, beams=32, aperture=math.radians(57.0), mount=(0.1, 0.0, 0.0)
    )
    return RangeScanner.mixed(ring, camera, name=name)


def aged(mapped: Environment, rng: np.random.Generator) -> Environment:
    """Return the building with its true walls, and furniture newer than its map."""
    true = with_aged_walls(mapped, WALLS_OFF, rng)
    count = round(BOXES_PER_AREA * true.free.area)
    return with_obstacles(true, scattered_boxes(true, count, rng))


def places(amap: AmbiguityMap, checker: CollisionChecker, rng: np.random.Generator) -> Floats:
    """Return explored cells where the robot fits, in random order, shape (N, 3)."""
    rows, columns = np.nonzero(amap.dataset["free"].values & ~amap.unexplored)
    x, y = amap.dataset["x"].values[columns], amap.dataset["y"].values[rows]
    poses = np.column_stack([x, y, np.zeros(len(x))])
    return rng.permutation(poses[checker.poses_free(poses)])


def wander(
    place: Floats, metres: float, checker: CollisionChecker, rng: np.random.Generator
) -> Floats | None:
    """Draw a path of straight lines about a pose, of a given length; None without room for it."""
    spots = place + np.column_stack([rng.uniform(-REACH, REACH, (200, 2)), np.zeros(200)])
    spots = spots[np.hypot(*(spots - place)[:, :2].T) <= REACH]
    spots = spots[checker.poses_free(spots)]
    if len(spots) < 10:
        return None
    spots = spots[checker.motions_free(np.broadcast_to(place, spots.shape), spots)]
    if len(spots) < 10 or np.ptp(spots[:, :2], axis=0).max() < REACH:
        return None
    path, length = [place], 0.0
    while length < metres:
        pose = path[-1]
        few = spots[rng.integers(len(spots), size=6)]
        few = few[checker.motions_free(np.broadcast_to(pose, few.shape), few)]
        far = np.hypot(*(few - pose)[:, :2].T)
        if not len(few) or far.max() < 0.05:
            return None if length == 0.0 else np.array(path)
        path.append(few[far.argmax()])
        length += float(far.max())
    return np.array(path)


def driven(
    mapped: Environment,
    scanner: RangeScanner,
    route: Route,
    localizer: ChosenLocalizer | Localizer,
    world: Environment,
    rng: np.random.Generator,
    runs: int,
) -> Drives:
    """Drive along the path exactly, whatever the estimate."""
    return drive_route(
        mapped, scanner, ROBOT, route, localizer, rng, runs,
        world=world, noise=NOISE, open_loop=True, rate=RATE, start_std=START_STD,
    )  # fmt: skip


def measured(drives: Drives) -> dict[str, Any]:
    """Return errors of the second half of all runs: size, and the axis of the largest.

    The second moment about the truth, so that a bias counts. And the share of runs that are
    farther than FOUND from the truth at the end, and that were after the first scan.
    """
    errors = drives.errors()[:, drives.truth.shape[1] // 2 :]
    xy = errors[..., :2].reshape(-1, 2)
    values, vectors = np.linalg.eigh(xy.T @ xy / len(xy))
    return {
        "error": float(np.sqrt(values.sum())),
        "error_major": float(np.sqrt(values[1])),
        "error_minor": float(np.sqrt(max(values[0], 0.0))),
        "error_axis": float(np.arctan2(vectors[1, 1], vectors[0, 1]) % np.pi),
        "error_heading": float(np.sqrt(np.mean(errors[..., 2] ** 2))),
        "missed": float(np.mean(np.hypot(*errors[:, -1, :2].T) > FOUND)),
        "missed_at_once": float(np.mean(np.hypot(*drives.errors()[:, 0, :2].T) > FOUND)),
    }


if __name__ == "__main__":
    main()
