"""Aliasing: seconds, what each step of the search leaves, and places that repeat by construction.

60 beams over 360 degrees, deviation 0.03 m, resolution 0.001 m. Seconds are those of the processor
(all threads) beside those on the clock: their half is what two quiet
cores take. Shares are of all pairs of poses, for all 60 turns. The second table, of buildings
whose look-alikes are known beforehand, is made with `--pairs` and a folder for its pictures.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely
from harness import add_out, environment_path, report, table

import ambinav as an
from ambinav.ambiguity.layers.aliasing import LEAST_LIKENESS, look_alikes
from ambinav.ambiguity.layers.aliasing_scans import Scans
from ambinav.ambiguity.layers.aliasing_signature import Signatures
from ambinav.ambiguity.layers.ground import Ground
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.audit.alikes import own_places
from ambinav.audit.link_pictures import plot_links
from ambinav.audit.links import find_links
from ambinav.geometry.lattice import Lattice

# The spacings that come nearest to 20 000 poses, and one that is quickly done.
CASES = (
    ("demo", 0.218, 4.0),
    ("aces", 0.25, 8.0),
    ("willow_full_005", 0.25, 4.0),
)
USUAL = ("demo", "aces")


def ground_of(path: str, spacing: float, reach: float) -> Ground:
    """Poses and beams of a case, without its map."""
    env = an.load_environment(path)
    sensor = an.RangeSensor(max_range=reach, std=0.03, resolution=0.001)
    scanner = an.RangeScanner.planar(sensor, 60, math.tau)
    model = AmbiguityModel(radius=0.5, map_std=env.map_std, tau=independent_tau(scanner))
    return Ground(env, scanner, Lattice.over(env, spacing), np.zeros(1), False, model)


def passed(ground: Ground, poses: int = 200) -> float:
    """Share of the pairs of poses that signatures let through, from some poses drawn by seed."""
    scans = Scans.of(ground)
    told = Signatures.of(scans, -math.log(LEAST_LIKENESS))
    explored = np.flatnonzero(scans.explored)
    drawn = np.random.default_rng(0).choice(explored, min(poses, explored.size), replace=False)
    low, high = told.low_above[explored], told.high_above[explored]
    shares = [
        ((told.above[p] <= high + told.odd) & (told.above[p] + told.odd + told.blind[p] >= low))
        .all(axis=1)
        .mean()
        for p in drawn
    ]
    return float(np.mean(shares))


def repeated() -> Iterator[tuple[str, an.Environment, float, float]]:
    """Buildings that repeat: name, environment, spacing, range."""
    for name, fold in (("four-fold crossing", 4), ("hexagon", 6)):
        arm = shapely.union_all([shapely.box(0, -0.6, 4, 0.6), shapely.box(3, 0, 3.5, 1.1)])
        arms = [shapely.affinity.rotate(arm, 360 / fold * i, origin=(0, 0)) for i in range(fold)]
        yield name, an.environment_from_shapes([shapely.union_all(arms)]), 0.1, 8.0
    room = shapely.Polygon([(0.2, 1.8), (3.8, 1.8), (3.8, 4.6), (1.2, 5.2)])
    door, hall = shapely.box(1.5, 1.4, 2.4, 1.9), shapely.box(-3, 0, 20, 1.5)
    rooms = [shapely.affinity.translate(one, 4 * i) for i in range(5) for one in (room, door)]
    yield "five rooms", an.environment_from_shapes([shapely.union_all([hall, *rooms])]), 0.2, 6.0
    yield "aces", an.load_environment(str(environment_path("aces"))), 0.4, 8.0


def pair(
    name: str, env: an.Environment, spacing: float, reach: float, folder: Path
) -> tuple[str, ...]:
    """Link one building's look-alikes, draw them, and say what the first letter links."""
    sensor = an.RangeSensor(max_range=reach, std=0.03, resolution=0.001)
    amap = an.build_map(env, an.RangeScanner.planar(sensor, 60, math.tau), spacing=spacing)
    ground = Ground.of(amap, env)
    places = own_places(amap, *ground.points)
    began = time.process_time()
    found = look_alikes(ground, count=17, place=places)
    took = time.process_time() - began
    links = find_links(ground, found, 6)
    axes = plot_links(amap, links, spacing)
    axes.figure.savefig(folder / f"{name.replace(' ', '-')}.png", dpi=120)
    first = [link for link in links if link.letter == "A"]
    return (
        name, str(len(ground.points[0])), f"{took:.1f}", f"{np.mean(found.share):.2f}",
        "; ".join(
            f"{link.distance:.1f} m, {math.degrees(link.turn):.0f}°, {link.likeness:.2f}"
            for link in first
        ),
    )  # fmt: skip


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", nargs="*", default=list(USUAL))
    parser.add_argument(
        "--pairs", type=Path, metavar="FOLDER", help="link what repeats, with pictures"
    )
    add_out(parser)
    chosen = parser.parse_args()
    look_alikes(ground_of(str(environment_path("demo")), 1.0, 4.0))
    rows = []
    for name, spacing, reach in CASES:
        if name not in chosen.cases:
            continue
        ground = ground_of(str(environment_path(name)), spacing, reach)
        ground.returns(0)
        clock, processor = time.perf_counter(), time.process_time()
        found = look_alikes(ground, count=3)
        clock, processor = time.perf_counter() - clock, time.process_time() - processor
        poses = len(ground.points[0])
        rows.append(
            (
                name, f"{spacing:g}", f"{reach:g}", poses, f"{clock:.1f}", f"{processor:.1f}",
                f"{100 * passed(ground):.0f} %",
                *(f"{left:.1e}" for left in found.left / (60.0 * poses**2)),
                f"{np.nanmean(found.share):.2f}",
            )
        )  # fmt: skip
        print(rows[-1], flush=True)
    header = (
        "environment", "spacing (m)", "range (m)", "poses", "s on the clock", "s of processor",
        "past signatures", "past a bundle's count", "past its own", "compared in full",
        "alike", "mean aliasing",
    )  # fmt: skip
    lines = table(header, rows)
    if chosen.pairs is not None:
        chosen.pairs.mkdir(parents=True, exist_ok=True)
        told = ("building", "poses", "s of processor", "mean aliasing", "links of letter A")
        lines += "\n\n" + table(told, [pair(*case, chosen.pairs) for case in repeated()])
    report("Aliasing", ("ambinav", "numba", "numpy", "scipy"), lines, chosen.out)


if __name__ == "__main__":
    main()
