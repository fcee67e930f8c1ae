"""How near are certified bounds to the routes of `reference`, and how long does a proof take?

Ends of the first routes of `lost-routes` in every eighth of its buildings, weight 5 and a disc of
0.2 m, for a laser that looks all around and one that looks ahead over half a circle,
whose cost depends on the heading. A gap is the share of a route's cost by which any route could be
cheaper; proofs end where it is below 0.5 %, or before a grid of more than so many cells.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from harness import appended, arguments, kept_rows, option, report, spread, table
from lost_case import building, building_names, routes_of
from plan_case import RADIUS, WEIGHT

import ambinav as an
from ambinav_planners import RoutePlanner, certify

APERTURES = {"all around": 2.0 * math.pi, "ahead": math.pi}
CELLS = (10_000, 50_000)


def main() -> None:
    """Certify routes and print one table."""
    args = arguments(
        __doc__, routes=1, every=8, file=option(Path("out/certify.jsonl"), "keeps results")
    )
    names = building_names()[:: args.every]
    with appended(args.file) as append:
        finished = {(row["building"], row["scanner"]) for row in kept_rows(args.file)}
        for name in names:
            for scanner, aperture in APERTURES.items():
                if (name, scanner) not in finished:
                    for row in certified(name, aperture, args.routes):
                        append({"building": name, "scanner": scanner, **row})
            print(name, file=sys.stderr, flush=True)
    rows = [row for row in kept_rows(args.file) if row["building"] in names]
    body = f"{str(__doc__).split(chr(10) * 2, 1)[1].strip()}\n\n"
    cells = []
    for scanner in APERTURES:
        for limit in CELLS:
            cases = [row for row in rows if (row["scanner"], row["cells"]) == (scanner, limit)]
            gaps, seconds = (np.array([row[key] for row in cases]) for key in ("gap", "seconds"))
            quantiles = (f"{100.0 * np.quantile(gaps, q):.2f}" for q in (0.5, 0.95, 1.0))
            buildings = len({row["building"] for row in cases})
            cells.append((scanner, f"{limit}", buildings, len(cases), *quantiles, spread(seconds)))
    header = (
        "laser", "cells", "buildings", "routes", "gap % median", "95th", "most", "seconds"
    )  # fmt: skip
    report("Certified routes", ["ambinav", "numpy"], body + table(header, cells, words=1), args.out)


def certified(name: str, aperture: float, count: int) -> list[dict[str, float]]:
    """Return gaps and times of a building's routes."""
    scanner = an.RangeScanner.planar(
        an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001), 60, aperture
    )
    amap = an.build_map(building(name), scanner, store=False)
    robot = RoutePlanner(an.AmbiguityService(amap, weight=WEIGHT), footprint=RADIUS)
    rows = []
    fits = robot.checker.poses_free
    routes = [route for route in routes_of(building(name), name) if fits(route.poses).all()]
    for driven in routes[:count]:
        route = robot.plan(driven.start, driven.goal)
        for cells in CELLS:
            proof = certify(robot, route, cells=cells)
            rows.append(
                {
                    "cells": cells,
                    "gap": proof.gap,
                    "seconds": proof.seconds,
                    "length": route.length,
                    "edge": proof.cell,
                }
            )
    return rows


if __name__ == "__main__":
    main()
