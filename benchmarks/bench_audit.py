"""Duration of an audit compared with that of its map: whole commands, one after the other.

`ambinav map` and `ambinav audit --no-aliasing`, each in a fresh process and from nothing
(`--no-store`), in rounds. Aliased pairs are a layer of their own, and left out. The warehouse is
40 x 26 m with five racks; the other buildings are recorded.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from harness import ROOT, add_out, environment_path, interleave, report, spread, table

RACKS = [(6.0, 3.0 + 4.2 * k, 34.0, 4.2 + 4.2 * k) for k in range(5)]
SHORT_SIGHTED = """
name: 4 m laser
parts:
  - sensor: {max_range: 4.0, std: 0.03, resolution: 0.001}
    planar: {beams: 60, aperture_deg: 360}
"""
RECORDED = ("freiburg-079", "nav2_depot", "intel", "aws_small_house")
SCANNERS = ("rplidar-a1", "turtlebot3-lds", "hokuyo-urg-04lx")
HEAD = ("building", "scanner", "map, s", "audit, s", "more, s")


def ring(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    """Return the corners of a box, with the first one repeated at the end."""
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def warehouse(folder: Path) -> Path:
    """Write a file of a hall with racks."""
    rings = [ring(0.0, 0.0, 40.0, 26.0), *(ring(*rack) for rack in RACKS)]
    room = {"type": "Polygon", "coordinates": rings}
    feature = {"type": "Feature", "properties": {"kind": "room"}, "geometry": room}
    path = folder / "warehouse.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


def row(building: Path, scanner: str, name: str, repeats: int, folder: Path) -> list[str]:
    """Return one line of the table."""

    def command(verb: str, output: str, *options: str) -> None:
        words = [verb, str(building), "-s", scanner, "--no-store", *options]
        words += ["-o", str(folder / output)]
        subprocess.run(
            [sys.executable, "-m", "ambinav.cli", *words], cwd=ROOT, check=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    timings = interleave(
        {
            "map": lambda: command("map", "map.zarr"),
            "audit": lambda: command("audit", "audit", "--no-aliasing"),
        },
        repeats,
    )
    made, audited = timings["map"].seconds, timings["audit"].seconds
    more = [b - a for a, b in zip(made, audited, strict=True)]
    called = name if name in SCANNERS else Path(name).stem
    return [building.stem, called, *(spread(values, 1) for values in (made, audited, more))]


def main() -> None:
    """Run all cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    add_out(parser)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        short = folder / "4 m laser.yaml"
        short.write_text(SHORT_SIGHTED)
        cases = [(environment_path("demo"), preset, preset) for preset in SCANNERS]
        cases.append((warehouse(folder), str(short), str(short)))
        cases += [
            (environment_path(environment), "rplidar-a1", "rplidar-a1") for environment in RECORDED
        ]
        rows = []
        for building, scanner, name in cases:
            rows.append(row(building, scanner, name, args.repeats, folder))
            print(" | ".join(rows[-1]), file=sys.stderr)
    body = table(HEAD, rows, 2) + f"\n\nMedian and range of {args.repeats} rounds of both commands."
    report("Audits", ("ambinav", "numba", "numpy", "matplotlib"), body, args.out)


if __name__ == "__main__":
    main()
