"""From an IFC file to drives: map, scanner table, three reflectors, routes, and robots' results.

The criterion, written before the first run:

- Building: the ground floor of institute.ifc, an office on paper, as `ambinav` reads it (doors
  open). Scanner: the TurtleBot3's LDS (3.5 m, all around) with an intensity channel; nobody has
  measured what its walls and reflectors read, so the example of docs/howto/my-scanner.md is taken
  (0.3 and 1.0, deviation 0.15: told apart in 99 of 100 readings).
- Commands, one after the other, with a store of maps of their own: the map; the shortest and the
  aware route along both corridors and from the entrance into the west corridor; three reflector
  posts for the shortest ones; the table of all presets. They are to take 5 minutes on two cores.
- Drives: the shortest routes, with and without the posts. The world is the building in an aged
  form: walls off by 3 cm (`with_aged_walls`), furniture moved by 1 m (`with_moved_furniture`), in
  four aged buildings with 30 seeds each, the same without and with posts, which stand where the
  tool has put them. The localizer's map is the plan, with the posts where there are some. Odometry
  of 9 degrees and 12 cm in a metre, and twice as bad, which the localizer knows; localizers
  `product` (Monte Carlo localization that multiplies its beams) and `kalman`. Told is the rate of
  lost robots (error above 0.5 m or 30 degrees for over a second). Intervals of 95 % by resampling
  aged buildings and seeds in them.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from harness import add_out, appended, commits, environment_path, kept_rows, report, table
from localizers import ROBOT, WHAT, localizer_of
from study_place import ODOMETRIES

from ambinav.buildings.load import load_environment
from ambinav.buildings.obstacle_file import load_obstacles
from ambinav.drive.ageing import with_aged_walls, with_moved_furniture
from ambinav.drive.bootstrap import paired_share
from ambinav.drive.drive import drive_route
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.map_building.build import build_map
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.files import load_route
from ambinav.routes.route import Route
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService

LEVEL = 1
ROUTES = {
    "corridors": ((1.5, 8.0), (40.3, 8.0)),
    "entrance": ((21.0, 1.2), (1.5, 8.0)),
}
SCANNER = """
name: turtlebot3-lds with intensities
robot_radius: 0.105
parts:
  - sensor: turtlebot3-lds
    intensity: {wall: 0.3, reflector: 1.0, std: 0.15}
    planar: {beams: 360, aperture_deg: 360, mount: [-0.032, 0, 0]}
"""
POSTS = 3
WALLS, FURNITURE = 0.03, 1.0
"""Displacement of the aged building's walls and furniture, standard deviations, metres."""
AGED = 4
"""Number of aged buildings."""
Row = dict[str, Any]


def main() -> None:
    """Run the missing commands and drives, then report."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("out/office"))
    parser.add_argument("--localizers", nargs="+", default=("product", "kalman"))
    parser.add_argument("--odometry", type=float, nargs="+", default=tuple(ODOMETRIES))
    parser.add_argument("--runs", type=int, default=30, help="in each aged building")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--report-only", action="store_true")
    add_out(parser)
    args = parser.parse_args()
    path = args.folder / "rows.jsonl"
    if not args.report_only:
        with appended(path) as append:
            if not kept_rows(path):
                for row in command_rows(args.folder):
                    append(row)
            for row in drive_rows(args, kept_rows(path)):
                append(row)
    title = "From an IFC file alone: an office's map, scanners, reflectors and routes"
    report(title, ["numpy", "numba", "shapely", "ifcopenshell"], body(args), args.out)


def command_rows(folder: Path) -> list[Row]:
    """Run each command; return its duration and output.

    Its files are left in the folder.
    """
    ifc = str(environment_path("institute"))
    (folder / "lds.yaml").write_text(SCANNER, encoding="utf-8")
    store = folder / "store"
    shutil.rmtree(store, ignore_errors=True)
    building = (ifc, "--level", str(LEVEL))
    places = {
        name: [f"{value:g}" for value in (*start, *goal)] for name, (start, goal) in ROUTES.items()
    }
    commands = {
        "map": ("map", *building, "-s", "lds.yaml", "-o", "office.zarr"),
        **{
            f"route {name}, weight {weight}": (
                "plan", "office.zarr", "--start", *ends[:2], "--goal", *ends[2:],
                "-w", str(weight), "-o", f"{name}-{weight}.csv",
            )
            for (name, ends), weight in product(places.items(), (0, 5))
        },
        "three reflectors": (
            "design", "place", *building, "-s", "lds.yaml", "--posts", str(POSTS), "-o", "posts",
            *(word for name in ROUTES for word in ("--route", f"{name}-0.csv")),
        ),
        "scanner table": ("design", "scanners", *building, "--all", "-o", "scanners"),
    }  # fmt: skip
    rows = []
    for what, words in commands.items():
        begun = time.perf_counter()
        said = subprocess.run(
            [sys.executable, "-m", "ambinav.cli", *words, "--json"],
            cwd=folder, env={**os.environ, "AMBINAV_CACHE": str(store.resolve())},
            stdout=subprocess.PIPE, text=True, check=True,
        ).stdout  # fmt: skip
        seconds = round(time.perf_counter() - begun, 1)
        row: Row = {"what": what, "command": " ".join(words), "seconds": seconds}
        if words[0] == "plan":
            row["route"] = json.loads(said)
        rows.append(row)
    return rows


def drive_rows(args: argparse.Namespace, kept: Sequence[Row]) -> Iterator[Row]:
    """Yield the missing drives: a row for each route, localizer and odometry."""
    office = load_environment(environment_path("institute"), level=LEVEL)
    scanner = RangeScanner.from_yaml(args.folder / "lds.yaml")
    drawn = load_obstacles(args.folder / "posts" / "placement.geojson")
    posts = [entry.obstacle for entry in drawn]
    done = {(row["what"], row.get("localizer"), row.get("odometry")) for row in kept}
    for name, localizer, scale in product(ROUTES, args.localizers, args.odometry):
        if (name, localizer, scale) in done:
            continue
        route = load_route(args.folder / f"{name}-0.csv")
        go = partial(driven, args, scanner=scanner, route=route, localizer=localizer, scale=scale)
        row: Row = {"what": name, "localizer": localizer, "odometry": scale}
        for kind, obstacles in (("without", []), ("with", posts)):
            known = office.edited(add=obstacles)
            row[kind] = [
                go(known, aged(office, number).edited(add=obstacles), number=number)
                for number in range(AGED)
            ]
        yield row


def aged(plan: Environment, number: int) -> Environment:
    """Return one of the aged forms of a building."""
    rng = np.random.default_rng([number, 25])
    walls = with_aged_walls(plan, WALLS, rng)
    return with_moved_furniture(walls, FURNITURE, rng, 2.0 * ROBOT.radius + 0.2)


def driven(
    args: argparse.Namespace,
    known: Environment,
    world: Environment,
    *,
    number: int,
    scanner: RangeScanner,
    route: Route,
    localizer: str,
    scale: float,
) -> Mapping[str, list[float]]:
    """Return the results of drives on the route in one aged building."""
    noise = OdometryNoise(scale=scale)
    # A drive does not need the map; the route's figures on it are not used.
    service = AmbiguityService(build_map(known, scanner, 0.5, store=False))
    shape = evaluate_route(service, route.poses, Steering(), planner="reference")
    measured = metrics(
        drive_route(
            world, scanner, ROBOT, shape,
            localizer_of(localizer, known, scanner, noise, args.runs),
            np.random.default_rng([args.seed, number]), args.runs, noise=noise,
        )
    )  # fmt: skip
    names = ("lost", "collided", "arrived", "position_p95")
    return {name: np.round(getattr(measured, name).astype(float), 4).tolist() for name in names}


def body(args: argparse.Namespace) -> str:
    """Return the report's tables."""
    rows = kept_rows(args.folder / "rows.jsonl")
    ran, drives = ([row for row in rows if has in row] for has in ("seconds", "with"))
    total = sum(row["seconds"] for row in ran)
    names = dict.fromkeys(row["localizer"] for row in drives)
    return "\n\n".join([
        str(__doc__).split("\n\n", 1)[1].strip(),
        "## The commands",
        f"Made at: {commits(rows)}. All together: {total:.0f} s.",
        table(
            ("what", "s", "command"),
            [(row["what"], row["seconds"], f"`ambinav {named(row['command'])}`") for row in ran],
        ),
        "## Drives in the aged building",
        "\n".join(f"- `{name}`: {WHAT[name]}" for name in names),
        table(
            ("route", "odometry errs in a metre by", "localizer", "runs", "lost without posts",
             "with", "difference, points (95 %)", "95 % error without, m", "with, m",
             "collided without", "with"),
            [drive_line(row) for row in drives],
            words=3,
        ),
    ])  # fmt: skip


def named(command: str) -> str:
    """Return a text without the folder of the data."""
    return " ".join(Path(word).name if word.endswith(".ifc") else word for word in command.split())


def drive_line(row: Row) -> tuple[object, ...]:
    """Return a line of the second table."""
    lost, errors, bumps = (
        [np.array([run[name] for run in row[kind]]) for kind in ("without", "with")]
        for name in ("lost", "position_p95", "collided")
    )
    building = np.repeat(np.arange(len(lost[0])), lost[0].shape[1])
    change = paired_share(lost[1].ravel(), lost[0].ravel(), group=building).scaled(100.0)
    rates = [float(losses.mean()) for losses in lost]
    return (
        row["what"], ODOMETRIES[row["odometry"]], row["localizer"], lost[0].size,
        *(f"{rate:.0%}" for rate in rates),
        f"{100.0 * (rates[1] - rates[0]):+.0f} ({change.low:+.0f} to {change.high:+.0f})",
        *(f"{np.median(values):.2f}" for values in errors),
        *(f"{values.mean():.0%}" for values in bumps),
    )  # fmt: skip


if __name__ == "__main__":
    main()
