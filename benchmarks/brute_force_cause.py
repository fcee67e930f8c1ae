"""The largest differences of kernel and brute force, and their cause: turning within a cell.

The worst place of nav2_depot in `bench_brute_force.py`, a hall with posts, for the laser of 4 m and
3 cm: `level` of both as the deviation of the heading shrinks, and as the cap of a beam goes.
"""

from __future__ import annotations

import argparse
import json
import math
from typing import Any

import numpy as np
from brute_force import level
from harness import add_out, environment_path, report, table

import ambinav as an

PLACE = (12.55, 5.45)
CHANGES: tuple[dict[str, float], ...] = (
    {}, {"sigma_theta": 0.01}, {"sigma_theta": 0.001}, {"outlier_share": 0.2},
    {"outlier_share": 1e-6},
)  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    add_out(parser)
    args = parser.parse_args()
    env = an.load_environment(environment_path("nav2_depot"))
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001),
        beams=60,
        aperture=math.tau,
    )
    rows = []
    for change in CHANGES:
        options: dict[str, Any] = dict(change)
        amap = an.build_map(env, scanner, **options, store=False)
        model = json.loads(amap.dataset.attrs["parameters"])
        true = level(env, scanner, *PLACE, map_std=model["map_std"], tau=model["tau"], **change)
        kernel = float(np.asarray(amap.sample("level", *PLACE)))
        name = ", ".join(f"{key} {value:g}" for key, value in change.items()) or "defaults"
        rows.append((name, f"{kernel:.3f}", f"{true:.3f}"))
    body = f"{str(__doc__).split(chr(10) * 2, 1)[1].strip()}\n\n"
    body += table(("parameters", "kernel", "brute force"), rows)
    report("Turning within a cell", ["numba", "numpy"], body, args.out)


if __name__ == "__main__":
    main()
