"""Duration of an audit beside that of its map: whole commands, in turn.

`ambinav map` and `ambinav audit`, each in a fresh process and from nothing (`--no-store`), with
advice, forecasts of routes, pictures, and posts and aliased pairs where an audit looks for them by
itself. The goal: an audit takes at most 3 s more than its map.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import shapely
from harness import ROOT, arguments, environment_path, interleave, option, report, spread, table

HALL = shapely.box(0.0, 0.0, 40.0, 26.0)
RACKS = [shapely.box(6.0, 3.0 + 4.2 * k, 34.0, 4.2 + 4.2 * k) for k in range(5)]
SHORT_SIGHTED = """
name: 4 m laser
parts:
  - sensor: {max_range: 4.0, std: 0.03, resolution: 0.001}
    planar: {beams: 60, aperture_deg: 360}
"""
CASES = (
    ("demo", "rplidar-a1"), ("demo", "hokuyo-urg-04lx"), ("warehouse", "4 m laser"),
    ("freiburg-079", "rplidar-a1"), ("nav2_depot", "turtlebot3-lds"), ("intel", "hokuyo-urg-04lx"),
    ("aws_small_house", "rplidar-a1"),
)  # fmt: skip
HEAD = ("building", "scanner", "map, s", "audit, s", "more, s")


def run(folder: Path, command: str, building: Path, scanner: str) -> None:
    """Run a command of ambinav from nothing."""
    words = [command, str(building), "--scanner", scanner, "--no-store"]
    words += ["--output", str(folder / ("out.zarr" if command == "map" else "out"))]
    command_line = [sys.executable, "-m", "ambinav", *words]
    subprocess.run(command_line, cwd=ROOT, check=True, capture_output=True)


def main() -> None:
    """Run all cases and print the table."""
    args = arguments(__doc__, repeats=option(3, "rounds of both commands"))
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        files = {"warehouse": folder / "warehouse.geojson", "4 m laser": folder / "laser.yaml"}
        floor = HALL.difference(shapely.union_all(RACKS))
        files["warehouse"].write_text(shapely.to_geojson(floor))
        files["4 m laser"].write_text(SHORT_SIGHTED)
        for name, preset in CASES:
            building, scanner = files.get(name) or environment_path(name), files.get(preset, preset)
            times = interleave(
                {
                    command: partial(run, folder, command, building, str(scanner))
                    for command in ("map", "audit")
                },
                args.repeats,
            )
            made, audited = times["map"].seconds, times["audit"].seconds
            added = [b - a for a, b in zip(made, audited, strict=True)]
            rows.append((name, preset, *(spread(part, 1) for part in (made, audited, added))))
            print(" | ".join(rows[-1]), file=sys.stderr)
    body = f"{table(HEAD, rows, 2)}\n\nMedian and range of {args.repeats} rounds."
    report("Audits", ("ambinav", "numba", "numpy", "matplotlib"), body, args.out)


if __name__ == "__main__":
    main()
