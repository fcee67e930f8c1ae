"""One table of four reports, by map, before and after the fixes of walls, mounts and footprints.

Put together from benchmarks/results/walls.md, collision.md, cells.md and mounts.md. Before: commit
8cec7f4; of routes, footprints held against the fitted walls alone; of cells, the deviation that was
a cell.

- Wall cells without a segment within 3 cells (`bench_walls.py`).
- Routes of the `reference` over cells that the map calls occupied (`bench_collision.py`).
- Median difference of `level` between rasters with cells of 5 and 10 cm (`bench_cells.py`).
- Share that is localizable for the TurtleBot3's laser, 0, 3.2, 10 and 20 cm off the robot's centre
  (`bench_mounts.py`, the maps that it takes).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from harness import add_out, report, table

RESULTS = Path(__file__).with_name("results")
SCANNER = "turtlebot3-lds"
MOUNTS = ("0", "32 mm behind", "10 cm left", "20 cm ahead")
HEADER = (
    "map", "wall cells without a segment: before, now", "routes over occupied cells: before, now",
    "level, 5 and 10 cm: before, now", "localizable by mount: before", "now",
)  # fmt: skip

Rows = list[list[str]]


def main() -> None:
    """Read the reports and print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    add_out(parser)
    args = parser.parse_args()
    walls = {row[0]: row[2] for row in tables("walls.md")[0]}
    routes = {row[0]: f"{row[2]}, {row[3]}" for row in tables("collision.md")[0]}
    cells = {row[0]: row[3] for row in tables("cells.md")[0]}
    mounts = by_mount(tables("mounts.md")[0])
    rows = [
        (
            name,
            walls.get(name, ""),
            routes.get(name, ""),
            cells.get(name, ""),
            *mounts.get(name, ("", "")),
        )
        for name in dict.fromkeys([*walls, *mounts])
    ]
    body = f"{str(__doc__).split(chr(10) * 2, 1)[1].strip()}\n\n{table(HEADER, rows)}"
    report("Before and after", [], body, args.out)


def tables(name: str) -> list[Rows]:
    """Return the tables of a report, without their headers."""
    all_rows: list[Rows] = []
    within = False
    for line in (RESULTS / name).read_text(encoding="utf-8").splitlines():
        if not line.startswith("|"):
            within = False
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not within:
            all_rows.append([])
        elif not set(line) <= set("|-: "):
            all_rows[-1].append(cells)
        within = True
    return all_rows


def by_mount(rows: Rows) -> dict[str, tuple[str, str]]:
    """Return for each map the localizable shares at `MOUNTS`, before and after."""
    shares: dict[str, dict[str, tuple[str, str]]] = {}
    for place, mount, _, now, _, _, before, _ in rows:
        name, scanner = place.split(" / ")
        if scanner == SCANNER:
            shares.setdefault(name, {})[mount] = (before.split(" / ")[0], now.split(" / ")[0])
    return {
        name: tuple(", ".join(of[mount][k] for mount in MOUNTS) + " %" for k in (0, 1))  # type: ignore[misc]
        for name, of in shares.items()
    }


if __name__ == "__main__":
    main()
