"""Build maps with the ambinav of the checkout that PYTHONPATH names; `bench_kernel.py` runs it.

It uses nothing but names of the contract, so that it runs in checkouts of any age.
"""

from __future__ import annotations

import argparse
import functools
import inspect
import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np

import ambinav
from ambinav import RangeScanner, RangeSensor, load_environment

# Free points of a map whose levels are compared, at about the most.
POSES = 30_000
SPACING = 0.1
CELLS = 5
"""Radius of the neighbourhood, in spacings."""

_STORE = "store" in inspect.signature(ambinav.build_map).parameters
_ALONE: dict[str, Any] = {"store": False} if _STORE else {}
build: Any = functools.partial(ambinav.build_map, **_ALONE)
"""Builds are measured: where there is a store of maps, none that was built before is opened."""


def scanner_of(name: str) -> RangeScanner:
    """Return `plain`, 60 beams over the full circle, 4 m, deviation 0.03 m; or a preset."""
    if name == "plain":
        sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
        return RangeScanner.planar(sensor, 60, 2 * math.pi)
    return RangeScanner.from_preset(name)


def levels(path: Path, names: list[str], out: Path) -> None:
    """Write the level of one environment for each scanner, and the spacing."""
    env = load_environment(path)
    spacing = max(SPACING, math.ceil(math.sqrt(env.free.area / POSES) * 100) / 100)
    arrays: dict[str, Any] = {"spacing": np.array(spacing)}
    for name in names:
        amap = build(env, scanner_of(name), spacing, CELLS * spacing)
        arrays[name] = amap.dataset["level"].values
    np.savez(out, **arrays)


def seconds(path: Path, name: str, headings: int | None, repeats: int) -> None:
    """Print build times, wall clock and processor time of both threads, as JSON."""
    env, scanner = load_environment(path), scanner_of(name)
    # The triangles and the kernels are made before the clock starts.
    build(env, scanner, 1.0, 5.0, headings)
    timings = []
    for _ in range(repeats):
        start, used = time.perf_counter(), os.times()
        build(env, scanner, SPACING, CELLS * SPACING, headings)
        now = os.times()
        timings.append(
            (time.perf_counter() - start, now.user + now.system - used.user - used.system)
        )
    json.dump(timings, sys.stdout)


def main() -> None:
    """Run the case of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("environment", type=Path)
    parser.add_argument("scanners", nargs="+")
    parser.add_argument(
        "--levels", type=Path, help="file to write levels to; else builds are timed"
    )
    parser.add_argument("--headings", type=int)
    parser.add_argument("--repeats", type=int, default=3)
    args = parser.parse_args()
    numba.set_num_threads(2)
    if args.levels:
        levels(args.environment, args.scanners, args.levels)
    else:
        seconds(args.environment, args.scanners[0], args.headings, args.repeats)


if __name__ == "__main__":
    main()
