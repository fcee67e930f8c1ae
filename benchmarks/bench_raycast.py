"""Ray casting on one thread against Embree, walls as quads, measured in the same run.

Whole scans: `RangeScanner.scan` and, below it, `scan_rays`. Single rays: `Environment.cast` and,
below it, `cast_rays`; once in scan order, where rays that follow each other share their origin,
and once shuffled. Embree casts the same rays through embreex. Its directions are made before the
clock starts, while the scans and casts of ambinav work out theirs within it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from harness import ENVIRONMENTS, arguments, environment_of, interleave, option, report, table
from lasers import laser
from numpy.typing import NDArray

from ambinav.casting.plane.raycast import cast_rays
from ambinav.casting.scans import scan_rays
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.sensing.scanner import RangeScanner

# Ranges that differ by more than this from Embree's are counted, metres.
DIFFERENT = 1e-3
HEADER = ("rays", "by", "M rays/s: median (extremes)", "times Embree: median (extremes)")


@dataclass(frozen=True)
class Poses:
    """Random free poses: x and y in metres, theta in radians, each of shape (N,)."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    theta: NDArray[np.float64]

    @classmethod
    def draw(cls, env: Environment, count: int, rng: np.random.Generator) -> Poses:
        """Draw `count` free points, evenly over the free space, with even headings."""
        xmin, ymin, xmax, ymax = env.bounds
        points = np.empty((0, 2))
        while len(points) < count:
            tried = rng.uniform((xmin, ymin), (xmax, ymax), (10 * count, 2))
            points = np.concatenate([points, tried[env.is_free(tried[:, 0], tried[:, 1])]])
        x, y = np.ascontiguousarray(points[:count].T)
        return cls(x, y, rng.uniform(-math.pi, math.pi, count))


@dataclass(frozen=True)
class Rays:
    """Rays one by one: origin in metres and direction in radians, each of shape (N,)."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    angle: NDArray[np.float64]

    @classmethod
    def of_scans(cls, poses: Poses, scanner: RangeScanner) -> Rays:
        """Return the rays of a scan at each of the poses, one scan after the other."""
        beams = scanner.rays().angle
        angle = (poses.theta[:, None] + beams).ravel()
        return cls(np.repeat(poses.x, len(beams)), np.repeat(poses.y, len(beams)), angle)

    def ordered(self, order: NDArray[np.intp]) -> Rays:
        """Return the same rays in another order."""
        return Rays(self.x[order], self.y[order], self.angle[order])


def embree_scene(segments: Segments) -> EmbreeScene:
    """Return the segments as upright quads of two triangles each, from z = -1 to 1 m."""
    ends = segments.xy.reshape(-1, 2, 2)
    corners = np.empty((len(ends), 4, 3), dtype=np.float32)
    corners[:, :, :2] = ends[:, [0, 1, 1, 0]]
    corners[:, :, 2] = (-1.0, -1.0, 1.0, 1.0)
    triangles = 4 * np.arange(len(ends))[:, None] + (0, 1, 2, 0, 2, 3)
    scene = EmbreeScene()
    TriangleMesh(scene, corners.reshape(-1, 3), triangles.reshape(-1, 3).astype(np.int32))
    return scene


def embree_caster(
    scene: EmbreeScene, rays: Rays, max_range: float
) -> Callable[[], NDArray[np.float32]]:
    """Return a function that casts the rays with Embree: distances, `max_range` for none."""
    origins = np.zeros((len(rays.x), 3), dtype=np.float32)
    origins[:, 0], origins[:, 1] = rays.x, rays.y
    directions = np.zeros_like(origins)
    directions[:, 0], directions[:, 1] = np.cos(rays.angle), np.sin(rays.angle)

    def cast() -> NDArray[np.float32]:
        # Embree writes the distances over the limits: used again, they would cut the work short.
        limits = np.full(len(origins), max_range, dtype=np.float32)
        distances: NDArray[np.float32] = scene.run(origins, directions, limits, query="DISTANCE")
        return distances

    return cast


def differing(ours: NDArray[np.floating], theirs: NDArray[np.floating], max_range: float) -> str:
    """Return as text how many rays differ by more than `DIFFERENT`, and their share."""
    gap = np.abs(np.minimum(ours.ravel(), max_range) - np.minimum(theirs, max_range))
    count = int((~(gap <= DIFFERENT)).sum())
    return f"{count} of {gap.size} ({count / gap.size:.1e})"


def measure(name: str, count: int, beams: int, max_range: float, repeats: int, seed: int) -> str:
    """Measure in the environment called `name`; return the section of the report."""
    env = environment_of(name)
    rng = np.random.default_rng(seed)
    poses = Poses.draw(env, count, rng)
    scanner = laser(max_range, beams=beams)
    table_of_rays = scanner.rays()
    in_order = Rays.of_scans(poses, scanner)
    shuffled = in_order.ordered(rng.permutation(len(in_order.x)))
    scene = embree_scene(env.segments)
    embree = embree_caster(scene, in_order, max_range)
    embree_shuffled = embree_caster(scene, shuffled, max_range)

    def raw_cast(rays: Rays) -> object:
        return cast_rays(env.grid, rays.x, rays.y, rays.angle, max_range)

    timings = interleave(
        {
            "embree": embree,
            "scan": lambda: scanner.scan(env, poses.x, poses.y, poses.theta),
            "scan_rays": lambda: scan_rays(
                env, poses.x, poses.y, poses.theta, table_of_rays.origin, table_of_rays.angle,
                max_range, height=table_of_rays.height, elevation=table_of_rays.elevation,
                incidence=False,
            ),
            "cast": lambda: env.cast(in_order.x, in_order.y, in_order.angle, max_range),
            "cast_rays": lambda: raw_cast(in_order),
            "embree, shuffled": embree_shuffled,
            "cast, shuffled": lambda: env.cast(shuffled.x, shuffled.y, shuffled.angle, max_range),
            "cast_rays, shuffled": lambda: raw_cast(shuffled),
        },
        repeats,
    )  # fmt: skip
    rows = [
        (rays, title, timings[key].rate(len(in_order.x)), timings[key].ratio(timings[peer]))
        for rays, title, key, peer in (
            ("whole scans", "Embree", "embree", "embree"),
            ("whole scans", "`RangeScanner.scan`", "scan", "embree"),
            ("whole scans", "`scan_rays`", "scan_rays", "embree"),
            ("single, scan order", "`Environment.cast`", "cast", "embree"),
            ("single, scan order", "`cast_rays`", "cast_rays", "embree"),
            ("single, shuffled", "Embree", "embree, shuffled", "embree, shuffled"),
            ("single, shuffled", "`Environment.cast`", "cast, shuffled", "embree, shuffled"),
            ("single, shuffled", "`cast_rays`", "cast_rays, shuffled", "embree, shuffled"),
        )
    ]
    theirs = embree()
    scans = scanner.scan(env, poses.x, poses.y, poses.theta)
    casts = np.asarray(env.cast(in_order.x, in_order.y, in_order.angle, max_range))
    return "\n\n".join(
        [
            f"## {env.name}",
            f"{len(env.segments)} segments; {count} random free poses, {beams} beams each.",
            table(HEADER, rows, words=2),
            f"Rays that differ from Embree by more than {DIFFERENT * 1e3:g} mm: "
            f"`scan` {differing(scans, theirs, max_range)}, "
            f"`cast` {differing(casts, theirs, max_range)}.",
        ]
    )


def main() -> None:
    """Measure as the command line says, and report."""
    args = arguments(
        __doc__,
        environments=option(
            ["willow_full_005", "infinite-corridor"],
            "of: " + ", ".join(ENVIRONMENTS),
            choices=sorted(ENVIRONMENTS),
            metavar="NAME",
        ),
        poses=option(10000, "scans"),
        beams=option(100, "rays a scan"),
        range=option(30.0, "metres"),
        repeats=option(15, "rounds"),
        seed=option(1, "of poses and order"),
    )
    numba.set_num_threads(1)
    sections = [
        measure(name, args.poses, args.beams, args.range, args.repeats, args.seed)
        for name in args.environments
    ]
    body = (
        f"One thread, range {args.range:g} m, {args.repeats} interleaved rounds.\n\n"
        + "\n\n".join(sections)
    )
    report(
        "Ray casting against Embree",
        ["ambinav", "numba", "llvmlite", "numpy", "embreex"],
        body,
        args.out,
    )


if __name__ == "__main__":
    main()
