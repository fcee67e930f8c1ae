"""Floor of each map that counts in an audit: explored, and reachable by a robot.

Zones by a laser of 60 beams and 5 m (4 spacings where that is more), on a lattice of about `POSES`
points of reachable floor: before, of all free floor; after, of what counts.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import warnings
from pathlib import Path

from harness import ROOT, add_out, report, table

from ambinav.buildings.load import load_environment
from ambinav.geometry.collision.reach import ROBOT_RADIUS, find_reach
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.zones import ZoneShare
from ambinav.runtime.errors import InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

FOLDERS = ("maps", "maps_from_logs", "maps_research_only", "planner_maps")
POSES = 3000
MOST_POSES = 30_000
FINEST = 0.2
LIBRARIES = ("ambinav", "numba", "numpy", "scipy", "shapely", "xarray")
MAX_RANGE = 5.0
HEAD = (
    "map", "spacing, m", "free, m²", "counted, m²", "unexplored, m²", "cut off, m²",
    "beside walls, m²", "rim", "localizable", "transition", "corridor", "open",
)  # fmt: skip


def row(environment: Environment, radius: float) -> tuple[str, ...]:
    """Return the row of one map."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        reach = find_reach(environment, radius)
    spacing = max(
        math.sqrt(reach.floor.area / POSES), math.sqrt(environment.free.area / MOST_POSES), FINEST
    )
    sensor = RangeSensor(max_range=max(MAX_RANGE, 4.0 * spacing), std=0.03, resolution=0.001)
    scanner = RangeScanner.planar(sensor, 60, math.tau)
    amap = build_map(
        environment, scanner, spacing=spacing, radius=max(0.5, 1.5 * spacing), store=False
    )
    parts = amap.judged_by(reach)
    areas = (parts.counted, parts.unexplored, parts.cut_off, parts.beside_walls)
    rim = ("", "touched", "margin")[len(reach.notes)]
    pairs = zip(amap.zone_shares(), amap.zone_shares(mask=parts.counted), strict=True)
    return (
        environment.name,
        f"{spacing:.2g}",
        f"{amap.free_area:,.0f}",
        *(f"{parts.area(cells):,.1f}" for cells in areas),
        rim,
        *map(_change, pairs),
    )


def _change(pair: tuple[ZoneShare, ZoneShare]) -> str:
    before, after = pair
    return f"{before.share * 100:.0f} → {after.share * 100:.0f} %"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot-radius", type=float, default=ROBOT_RADIUS, metavar="M")
    parser.add_argument("maps", nargs="*", help="names of maps; default: all")
    add_out(parser)
    arguments = parser.parse_args()
    folder = os.environ.get("AMBINAV_DATA")
    if not folder:
        parser.exit(2, "AMBINAV_DATA is not set; set it to the folder that holds maps/.\n")
    files = [ROOT / "configs" / "demo.geojson"]
    for name in FOLDERS:
        files += sorted((Path(folder) / name).glob("*.yaml"))
    rows = []
    for file in files:
        if arguments.maps and file.stem not in arguments.maps:
            continue
        print(f"measuring {file.stem}", file=sys.stderr)
        rows.append(row(load_environment(file), arguments.robot_radius))
    text = (
        f"Robot of radius {arguments.robot_radius:g} m, setting out in the largest piece of "
        "floor. *counted*: explored and reached, what the shares of an audit are of. *cut off*: "
        "the robot fits but cannot get there: page margins, insides of crates, rooms behind "
        "narrow doors. *beside walls*: nearer to a wall than its centre comes. *rim*: floor "
        "touches the rim of the map; *margin*: and the largest piece was passed over, as the "
        "margin of a page.\n\nZones: share of all free floor → share of what counts.\n\n"
    )
    report("Floor that counts", LIBRARIES, text + table(HEAD, rows), arguments.out)


if __name__ == "__main__":
    main()
