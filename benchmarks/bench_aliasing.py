"""Aliasing: seconds, pairs compared in full, and what each step of the search leaves out.

60 beams over 360 degrees, deviation 0.03 m, resolution 0.001 m. Seconds are those of the processor
(all threads) beside those on the clock: they say what a quiet machine with two cores would take.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np
from harness import add_out, environment_path, report, table

import ambinav as an
from ambinav.ambiguity.layers.aliasing import LEAST_LIKENESS, look_alikes
from ambinav.ambiguity.layers.aliasing_scans import Scans
from ambinav.ambiguity.layers.aliasing_signature import Signatures
from ambinav.ambiguity.layers.ground import Ground
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.geometry.lattice import Lattice

CASES = (
    ("demo", 0.25, 4.0),
    ("aces", 0.25, 8.0),
    ("stata_hallways_5cm", 0.25, 8.0),
    ("nav2_depot", 0.15, 8.0),
    ("willow_full_005", 0.25, 4.0),
)


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


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", nargs="*", default=[name for name, _, _ in CASES])
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
                f"{100 * passed(ground):.0f} %", f"{found.compared / (60 * poses**2):.1e}",
                f"{np.nanmean(found.share):.2f}",
            )
        )  # fmt: skip
        print(rows[-1], flush=True)
    header = (
        "environment", "spacing (m)", "range (m)", "poses", "s on the clock", "s of processor",
        "pairs past signatures", "pairs and turns compared", "mean aliasing",
    )  # fmt: skip
    report("Aliasing", ("ambinav", "numba", "numpy", "scipy"), table(header, rows), chosen.out)


if __name__ == "__main__":
    main()
