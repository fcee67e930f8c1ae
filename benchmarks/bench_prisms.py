"""Rays of 3D scanners through buildings of prisms against Embree, measured in the same run.

Scans from random poses in furnished offices (walls with doors and windows, beams, tables on legs,
shelves): of a VLP-16, level and tilted, and of the pattern of a Mid-360. Embree casts the same
rays, through `embreex` and one after the other, against the triangles of the same surfaces; its
directions are made before the clock starts, while `Prisms.cast_scans` works out its own within it.
One thread against one is measured in processor time, since other work on the machine would count
else. Two threads are measured against two processes of `Mesh`, which holds the interpreter's lock
otherwise, by the clock on the wall.
"""

from __future__ import annotations

import time

import numba
import numpy as np
from embreex.rtcore_scene import EmbreeScene
from harness import arguments, interleave, option, report, table
from numpy.typing import NDArray
from prism_mesh import embree_scene, mid360, office, poses, triangles, vlp16

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms
from ambinav.casting.space import SpaceRays

# Ranges that differ by more than these are counted, metres.
LIMITS = (1e-5, 1e-4, 1e-3)
HEADER = (
    "building",
    "rays",
    "by",
    "M rays/s: median (extremes)",
    "times Embree: median (extremes)",
)
TILT = 0.1


def exactly(
    origin: NDArray[np.float64], direction: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return distances in float64, every ray against every triangle (Moeller and Trumbore 1997)."""
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    nearest = np.empty(len(origin))
    with np.errstate(all="ignore"):
        for i, (o, d) in enumerate(zip(origin, direction, strict=True)):
            p, s = np.cross(d, e2), o - a
            per = 1.0 / (e1 * p).sum(axis=1)
            u, q = (s * p).sum(axis=1) * per, np.cross(s, e1)
            v, t = (q * d).sum(axis=1) * per, (q * e2).sum(axis=1) * per
            is_hit = (u >= -1e-12) & (v >= -1e-12) & (u + v <= 1 + 1e-12) & (t >= 0.0)
            nearest[i] = t[is_hit].min(initial=np.inf)
    return nearest


def differences(
    prisms: Prisms, scene: EmbreeScene, rays: SpaceRays, at: NDArray[np.float64], max_range: float
) -> tuple[object, ...]:
    """Return how often and by how much ranges differ, and the error of those to float64."""
    ours = prisms.cast_scans(*at.T, rays, max_range, incidence=False)[0].ravel()
    origin, direction = (part.reshape(-1, 3) for part in rays.at(*at.T))
    limit = np.full(len(origin), max_range, dtype=np.float32)
    theirs = scene.run(
        origin.astype(np.float32), direction.astype(np.float32), limit, query="DISTANCE"
    )
    gap = np.abs(np.minimum(ours, max_range) - theirs)
    odd = np.flatnonzero(~(gap <= LIMITS[1]))[:200]
    exact = np.minimum(exactly(origin[odd], direction[odd], triangles(prisms)), max_range)
    worst = [
        f"{np.abs(np.minimum(of[odd], max_range) - exact).max(initial=0.0):.1e}"
        for of in (ours, theirs)
    ]
    counts = [int((~(gap <= limit)).sum()) for limit in LIMITS]
    return (gap.size, f"{np.median(gap):.1e}", f"{gap.max():.1e}", *counts, *worst)


def rates(
    prisms: Prisms,
    scene: EmbreeScene,
    rays: SpaceRays,
    at: NDArray[np.float64],
    max_range: float,
    repeats: int,
) -> list[tuple[object, ...]]:
    """Return each caster's speed, and its ratio to Embree; one thread each, then two."""
    flat = [part.reshape(-1, 3).astype(np.float32) for part in rays.at(*at.T)]
    limit = np.empty(len(flat[0]), dtype=np.float32)

    def embree() -> object:
        # Embree writes the distances over the limits.
        limit[:] = max_range
        return scene.run(*flat, limit, query="DISTANCE")

    def ours() -> object:
        return prisms.cast_scans(*at.T, rays, max_range, incidence=False)

    numba.set_num_threads(1)
    single = interleave({"embree": embree, "prisms": ours}, repeats, time.process_time)
    numba.set_num_threads(2)
    points = triangles(prisms)
    corners = np.arange(3 * len(points)).reshape(-1, 3)
    with Mesh(points.reshape(-1, 3), corners, processes=2) as mesh:
        caster = mesh._caster
        two = interleave({"embree": lambda: caster.cast(*flat, max_range), "prisms": ours}, repeats)
    return [
        (by, times[key].rate(limit.size), times[key].ratio(times["embree"]))
        for by, times, key in (
            ("Embree, 1 thread", single, "embree"),
            ("`Prisms`, 1 thread", single, "prisms"),
            ("Embree, 2 processes", two, "embree"),
            ("`Prisms`, 2 threads", two, "prisms"),
        )
    ]


def measure(
    rooms: int, count: int, max_range: float, repeats: int, seed: int
) -> tuple[list[tuple[object, ...]], list[tuple[object, ...]]]:
    """Return rows of rates and of differences in an office of rooms x rooms."""
    prisms = office(rooms, seed)
    scene = embree_scene(prisms)
    at = poses(prisms, count, np.random.default_rng(seed))
    name = f"{len(prisms.walls)} walls, {len(prisms.solids)} solids"
    level = vlp16()
    fast: list[tuple[object, ...]] = []
    range_rows: list[tuple[object, ...]] = []
    for title, rays in (
        ("level", level),
        ("tilted", level.mounted(0, 0, 0, 0, TILT, 0.05)),
        ("Mid-360", mid360()),
    ):
        rate_rows = rates(prisms, scene, rays, at, max_range, repeats)
        fast += [(name, title, *row) for row in rate_rows]
        range_rows.append((name, title, *differences(prisms, scene, rays, at, max_range)))
    return fast, range_rows


def main() -> None:
    """Measure as the command line says, and report."""
    args = arguments(
        __doc__,
        rooms=option([3, 6, 12], "offices of so many squared rooms"),
        poses=option(300, "scans"),
        range=option(30.0, "metres"),
        repeats=option(11, "rounds"),
        seed=option(1, "of buildings and poses"),
    )
    fast: list[tuple[object, ...]] = []
    range_rows: list[tuple[object, ...]] = []
    for rooms in args.rooms:
        measured = measure(rooms, args.poses, args.range, args.repeats, args.seed)
        fast += measured[0]
        range_rows += measured[1]
    differ = ("building", "rays", "cast", "median gap (m)", "largest (m)")
    differ += tuple(f"gap > {limit:g} m" for limit in LIMITS)
    differ += ("`Prisms` off float64 (m)", "Embree off float64 (m)")
    body = "\n\n".join(
        [
            "VLP-16, 16 x 360 rays, level and tilted, and the sampled rays of a Mid-360, "
            f"{len(mid360().azimuth)}, no two of one azimuth, from {args.poses} poses, range "
            f"{args.range:g} m, {args.repeats} interleaved rounds; one against one in processor "
            "time, two against two by the clock.",
            table(HEADER, fast, words=3),
            "How ranges differ. The last two columns: of the rays that differ by more than "
            f"{LIMITS[1]:g} m (200 at the most), how far each is at worst from every triangle "
            "tried in float64.",
            table(differ, range_rows, words=2),
        ]
    )
    report(
        "Prisms against Embree",
        ["ambinav", "numba", "llvmlite", "numpy", "embreex"],
        body,
        args.out,
    )


if __name__ == "__main__":
    main()
