"""Aliasing: seconds, survivors of each step of the search, and buildings that repeat by design.

60 beams over 360 degrees, deviation 0.03 m, resolution 0.001 m. Seconds are those of the processor
(all threads) beside those on the clock: their half is what two quiet
cores take. Shares are of all pairs of poses, for all 60 turns. The second table, of buildings
whose twins are known beforehand, is made with `--pairs` and a folder for its pictures: what an
audit pairs, and how many poses have all of the twins that are due, within 0.25 m and 3 degrees.
"""

from __future__ import annotations

import math
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from harness import arguments, environment_path, option, report, table
from lasers import laser
from numpy.typing import NDArray
from PIL import Image

import ambinav as an
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.geometry.lattice import Lattice
from ambinav.layers.aliasing.layer import LEAST_LIKENESS, aliased_poses
from ambinav.layers.aliasing.scans import Scans
from ambinav.layers.aliasing.signature import Signatures
from ambinav.layers.context import LayerContext
from ambinav.plotting.aliasing import plot_aliasing
from ambinav.plotting.canvas import save_figure
from ambinav.studies.audit.aliased_pairs import LEAST_DISTANCE, find_aliased_pairs
from ambinav.studies.audit.aliasing import SPACING, seek

# The spacings that come nearest to 20 000 poses, and one that is quickly done.
CASES = (("demo", 0.218, 4.0), ("aces", 0.25, 8.0), ("willow_full_005", 0.25, 4.0))
USUAL = ("demo", "aces")
# The tiles of stata_tiled_2x9_huge: pixels of 0.05 m from its left and its upper edge.
TILE_COLUMNS = (0, 1748)
TILE_ROWS = (0, 1224, 2448, 3672, 4893, 6117, 7338, 8562, 9786)
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Repeated:
    """A building that repeats.

    Attributes:
        name: For the table.
        environment: The building.
        spacing: Spacing of the map, metres.
        reach: Range of the scanner, metres.
        twins: Where poses x + i y, shape (P,), have their twins, shape (P, T); NaN for none.
        turn: How much the robot is turned there, radians, shape (T,).
    """

    name: str
    environment: an.Environment
    spacing: float
    reach: float
    twins: Callable[[Complex], Complex]
    turn: NDArray[np.float64]


def context_of(path: str, spacing: float, reach: float) -> LayerContext:
    """Return poses and beams of a case, without its map."""
    env = an.load_environment(path)
    scanner = laser(reach)
    model = AmbiguityModel(radius=0.5, map_std=env.map_std, tau=independent_tau(scanner))
    return LayerContext(env, scanner, Lattice.over(env, spacing), np.zeros(1), False, model)


def passed(context: LayerContext, poses: int = 200) -> float:
    """Return the share of pose pairs that signatures do not reject, from a random sample."""
    scans = Scans.of(context)
    signatures = Signatures.of(scans, -math.log(LEAST_LIKENESS))
    explored = np.flatnonzero(scans.explored)
    drawn = np.random.default_rng(0).choice(explored, min(poses, explored.size), replace=False)
    low, high = signatures.low_above[explored], signatures.high_above[explored]
    shares = [
        (
            (signatures.above[p] <= high + signatures.odd)
            & (signatures.above[p] + signatures.odd + signatures.blind[p] >= low)
        )
        .all(axis=1)
        .mean()
        for p in drawn
    ]
    return float(np.mean(shares))


def repeated() -> Iterator[Repeated]:
    """Return buildings that repeat; the last one is recorded data and takes some minutes."""
    arm = shapely.union_all([shapely.box(0, -0.8, 9, 0.8), shapely.box(7, 0, 8, 1.6)])
    for name, fold in (("four-fold crossing", 4), ("hexagonal hall", 6)):
        turn = math.tau / fold * np.arange(fold)
        corner = 2.5 * np.exp(1j * (turn + 0.5 * turn[1]))
        arms = [shapely.affinity.rotate(arm, angle, (0, 0), use_radians=True) for angle in turn]
        hall = shapely.Polygon(np.column_stack([corner.real, corner.imag]))
        env = an.environment_from_shapes([shapely.union_all([hall, *arms])])
        yield Repeated(name, env, 0.1, 4.0, lambda p, turn=turn: turned(p, turn), turn[1:])
    room = shapely.Polygon([(0.2, 1.8), (3.8, 1.8), (3.8, 4.6), (1.2, 5.2)])
    door, corridor = shapely.box(1.5, 1.4, 2.4, 1.9), shapely.box(-6, 0, 26, 1.5)
    rooms = [shapely.affinity.translate(shape, 4 * i) for i in range(5) for shape in (room, door)]
    env = an.environment_from_shapes([shapely.union_all([corridor, *rooms])])
    yield Repeated("five rooms", env, 0.1, 4.0, in_rooms, np.zeros(8))
    yield Repeated("stata_tiled_2x9_huge", tiled(), 1.0, 8.0, in_tiles, np.zeros(18))


def turned(p: Complex, turn: NDArray[np.float64]) -> Complex:
    """Return twins rotated about the origin; nan if closer than the least distance of a pair."""
    twins = p[:, np.newaxis] * np.exp(1j * turn[1:])
    return np.where(np.abs(twins - p[:, np.newaxis]) >= LEAST_DISTANCE, twins, np.nan)


def in_rooms(p: Complex) -> Complex:
    """Return twins in five rooms that are 4 m apart, for poses in the rooms only."""
    twins = p[:, np.newaxis] + 4.0 * np.array([-4, -3, -2, -1, 1, 2, 3, 4])
    inside = (p.imag[:, np.newaxis] > 1.9) & (twins.real > 0.0) & (twins.real < 20.0)
    return np.where(inside, twins, np.nan)


def in_tiles(p: Complex) -> Complex:
    """Return twins in the other tiles, and none in a pose's own."""
    left, top = 0.05 * np.array(TILE_COLUMNS), 0.05 * (10976 - np.array(TILE_ROWS))
    column = np.searchsorted(left, p.real, side="right") - 1
    row = np.searchsorted(-top, -p.imag, side="right") - 1
    local = p - (left[column] + 1j * top[row])
    corner = (left[:, np.newaxis] + 1j * top).ravel()
    twins = local[:, np.newaxis] + corner
    twins[np.arange(len(p)), column * len(top) + row] = np.nan
    return twins


def tiled() -> an.Environment:
    """Return the tiled map without the white strip at its right edge."""
    source = environment_path("stata_hallways_5cm").with_name("stata_tiled_2x9_huge.yaml")
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(source, folder)
        Image.MAX_IMAGE_PIXELS = None
        with Image.open(source.with_suffix(".png")) as image:
            cropped = image.crop((0, 0, 2 * TILE_COLUMNS[1], image.height))
        cropped.save(Path(folder) / source.with_suffix(".png").name)
        return an.load_environment(str(Path(folder) / source.name))


def pair(case: Repeated, folder: Path) -> tuple[str, ...]:
    """Pair one building's aliased poses as an audit does, plot them, and count the twins."""
    amap = an.build_map(
        case.environment,
        laser(case.reach),
        spacing=case.spacing,
        radius=max(0.5, case.spacing),
        store=False,
    )
    spacing = max(amap.spacing, SPACING)
    context = LayerContext.of(amap, case.environment)
    if spacing > amap.spacing:
        context = replace(context, lattice=Lattice.over(case.environment, spacing))
    began = time.process_time()
    aliased, sought = seek(amap, context)
    took = time.process_time() - began
    pairs = find_aliased_pairs(context, aliased, 6)
    axes = plot_aliasing(amap, pairs, spacing)
    save_figure(axes, folder / f"{case.name.replace(' ', '-')}.png")
    x, y = context.points
    twins = case.twins(x + 1j * y)
    have = np.zeros(twins.shape, dtype=np.bool_)
    alike = aliased.poses[:, 0]
    for k, turn in enumerate(case.turn):
        off = np.abs(alike[..., 0] + 1j * alike[..., 1] - twins[:, k, np.newaxis])
        bend = np.abs(np.angle(np.exp(1j * (alike[..., 2] - turn))))
        have[:, k] = ((off < 0.25) & (bend < 0.05)).any(axis=1)
    due = ~np.isnan(twins)
    poses = due.any(axis=1)
    complete = (have | ~due)[poses].all(axis=1)
    first = [aliased_pair for aliased_pair in pairs if aliased_pair.letter == "A"]
    return (
        case.name, f"{spacing:g}", str(len(x)), str(int(sought.sum())), f"{took:.0f}",
        f"{np.nanmean(aliased.share):.2f}", str(due.sum(axis=1).max()),
        f"{due[poses].sum(axis=1).mean():.1f}", f"{have[poses].sum(axis=1).mean():.1f}",
        f"{100 * complete.mean():.0f} %", str(len(first)),
        f"{min(aliased_pair.likeness for aliased_pair in first):.2f}" if first else "",
    )  # fmt: skip


def main() -> None:
    """Measure and report."""
    chosen = arguments(
        __doc__,
        cases=option(list(USUAL), nargs="*"),
        pairs=option(None, "pair what repeats, with pictures", type=Path, metavar="FOLDER"),
    )
    aliased_poses(context_of(str(environment_path("demo")), 1.0, 4.0))
    rows = []
    for name, spacing, reach in CASES:
        if name not in chosen.cases:
            continue
        context = context_of(str(environment_path(name)), spacing, reach)
        context.returns(0)
        clock, processor = time.perf_counter(), time.process_time()
        aliased = aliased_poses(context, count=3)
        clock, processor = time.perf_counter() - clock, time.process_time() - processor
        poses = len(context.points[0])
        rows.append(
            (
                name, f"{spacing:g}", f"{reach:g}", poses, f"{clock:.1f}", f"{processor:.1f}",
                f"{100 * passed(context):.0f} %",
                *(f"{left:.1e}" for left in aliased.left / (60.0 * poses**2)),
                f"{np.nanmean(aliased.share):.2f}",
            )
        )  # fmt: skip
        print(rows[-1], flush=True)
    header = (
        "environment", "spacing (m)", "range (m)", "poses", "s on the clock", "s of processor",
        "past signatures", "past a bundle's count", "past its own", "compared in full",
        "alike", "mean aliasing",
    )  # fmt: skip
    lines = table(header, rows) if rows else ""
    if chosen.pairs is not None:
        chosen.pairs.mkdir(parents=True, exist_ok=True)
        signatures = (
            "building", "spacing (m)", "poses", "sought from", "s of processor", "mean aliasing",
            "twins, at most", "due to a pose", "found", "poses with all", "pairs of letter A",
            "least likeness of these",
        )  # fmt: skip
        lines += "\n\n" + table(signatures, [pair(case, chosen.pairs) for case in repeated()])
    report("Aliasing", ("ambinav", "numba", "numpy", "scipy"), lines, chosen.out)


if __name__ == "__main__":
    main()
