"""The kernel's `level` against brute force on a fine lattice, in all kinds of clutter."""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import Any

import numpy as np
from brute_force import HEADINGS, STEP, radii
from harness import arguments, environment_path, option, recorded_maps, report, table
from lasers import laser
from numpy.typing import NDArray

import ambinav as an
from ambinav.ambiguity.tensor import classify
from ambinav.maps.ambiguity_map import AmbiguityMap

SCANNERS = {"4 m, 3 cm": (4.0, 0.03), "8 m, 1 cm": (8.0, 0.01), "30 m, 1 cm": (30.0, 0.01)}
SPACINGS = (0.1, 0.05)
CLEAR = 0.3
MUCH = 0.05
TOWNS = "planner_maps"
"""Folder of maps that are no buildings."""
GREATEST = 2000.0
"""Square metres of floor; greater maps are left out, for the time that their maps take."""

Floats = NDArray[np.float64]


def main() -> None:
    """Compare at random places of every map."""
    args = arguments(
        __doc__,
        places=option(60, "in each map"),
        seed=1,
        sigma_theta=option(0.05, "radians"),
        scanners=option(list(SCANNERS), choices=list(SCANNERS)),
        maps=option(None, "names; by default all of up to 2000 m²", nargs="+"),
        half=option(True, "also at half the spacing", action=argparse.BooleanOptionalAction),
        step=option(STEP, "of the lattice, metres"),
        headings=option(HEADINGS, "of each of its places"),
    )
    drawn = [environment_path("demo"), *recorded_maps(args.maps)]
    paths = [path for path in drawn if path.parent.name != TOWNS]
    parts = []
    for name in args.scanners:
        reach, std = SCANNERS[name]
        scanner = laser(reach, std)
        rows, all_differences = [], []
        for path in paths:
            if args.maps and path.stem not in args.maps:
                continue
            env = an.load_environment(path)
            if env.free.area > GREATEST:
                continue
            rng = np.random.default_rng(args.seed)
            lattice = {"step": args.step, "headings": args.headings}
            spacings = SPACINGS if args.half else SPACINGS[:1]
            measured = differences(
                env, scanner, spacings, args.places, args.sigma_theta, rng, lattice
            )
            all_differences.append(measured)
            rows.append((path.stem, *described(measured)))
            print(name, *rows[-1], file=sys.stderr, flush=True)
        rows.append(("all", *described(np.concatenate(all_differences))))
        header = HEADER if args.half else HEADER[: -len(HALVED)]
        parts += [f"## Laser of {name}", table(header, [row[: len(header)] for row in rows])]
    report("The kernel against brute force", ["numba", "numpy"], "\n\n".join(parts), args.out)


HALVED = "at half the spacing: median", "95 %", "lowest, clear of walls"
HEADER = (
    "map", "places", "median", "95 %", "lowest", "highest", "off by more than 0.05",
    "zones that differ", "lowest, clear of walls", *HALVED,
)  # fmt: skip


def differences(
    env: an.Environment,
    scanner: an.RangeScanner,
    spacings: tuple[float, ...],
    count: int,
    sigma_theta: float,
    rng: np.random.Generator,
    lattice: dict[str, Any],
) -> Floats:
    """Compare kernel and brute force at random places.

    Returns:
        Rows of kernel less brute force at the first and the last spacing, the clearance, and 1
        where the zones differ, shape (N, 4).
    """
    maps = [
        an.build_map(env, scanner, spacing, sigma_theta=sigma_theta, store=False)
        for spacing in spacings
    ]
    coarse, fine = maps[0], maps[-1]
    model = json.loads(coarse.dataset.attrs["parameters"])
    explored = coarse.dataset["free"].values & (coarse.dataset["unknown"].values < 0.5)
    cells = rng.permutation(np.argwhere(explored))[:count]
    rows = []
    for row, column in cells:
        x, y = float(coarse.dataset["x"][column]), float(coarse.dataset["y"][row])
        true = radii(
            env, scanner, x, y, map_std=model["map_std"], tau=model["tau"],
            sigma_theta=sigma_theta, **lattice,
        )  # fmt: skip
        level = true.mean()
        zone = classify(true[:1], true[1:], model["low"], model["high"])[0]
        differ = zone != coarse.dataset["zone"].values[row, column]
        clearance = float(coarse.dataset["clearance"].values[row, column])
        rows.append([nearest(coarse, x, y) - level, nearest(fine, x, y) - level, clearance, differ])
    return np.array(rows)


def nearest(amap: AmbiguityMap, x: float, y: float) -> float:
    """Return `level` at a point; between lattice cells, the mean of the surrounding ones."""
    return float(np.asarray(amap.sample("level", x, y)))


def described(measured: Floats) -> list[str]:
    """Return the cells of a row of the table."""
    coarse, fine, clearance, differ = measured.T
    clear = clearance >= CLEAR
    fine = fine[np.isfinite(fine) & clear]
    sizes = np.quantile(np.abs(coarse), (0.5, 0.95))
    halves = np.quantile(np.abs(fine), (0.5, 0.95)) if len(fine) else (math.nan, math.nan)
    numbers = [*sizes, coarse.min(), coarse.max()]
    gaps = [coarse[clear].min(initial=0.0), *halves, fine.min(initial=0.0)]
    counts = [int((np.abs(coarse) > MUCH).sum()), int(differ.sum())]
    return [
        str(len(measured)), *(f"{value:.3f}" for value in numbers),
        *(str(count) for count in counts),
        *(f"{value:.3f}" for value in gaps),
    ]  # fmt: skip


if __name__ == "__main__":
    main()
