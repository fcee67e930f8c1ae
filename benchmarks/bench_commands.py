"""Duration of each command, as a user types it: a fresh process, with kernels compiled before.

Maps are made from nothing (`AMBINAV_CACHE` is empty); commands that read a map read one that is
made before. The building is the bundled one unless another is named.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from harness import ROOT, arguments, environment_path, interleave, option, report, spread, table

from ambinav.demo import DEMO_GOAL, DEMO_START

HEAD = ("command", "s: median (extremes)")
COSTS = ROOT / "configs/costs-example.yaml"
SCENARIO = ROOT / "configs/compare-demo.yaml"
ENDS = ("--start", *map(str, DEMO_START[:2]), "--goal", *map(str, DEMO_GOAL[:2]))


def commands(
    building: Path, scanner: str, folder: Path
) -> Iterator[tuple[str, list[str], str | None]]:
    """Yield what is typed, shortened for the table, its words, and the name of what it writes."""
    of = [str(building), "--scanner", scanner]
    amap, route = str(folder / "made.zarr"), str(folder / "made.csv")
    yield "ambinav --help", ["--help"], None
    yield "ambinav map BUILDING", ["map", *of], "made.zarr"
    yield "ambinav audit BUILDING", ["audit", *of], "audit"
    yield "ambinav audit BUILDING --posts 3", ["audit", *of, "--posts", "3"], "posts"
    keepout = ["export", amap, "--to", "nav2-keepout", "--overwrite"]
    yield "ambinav export MAP --to nav2-keepout", keepout, "keepout.yaml"
    yield "ambinav diff MAP MAP", ["diff", amap, amap], "diff"
    if building == environment_path("demo"):
        yield "ambinav plan MAP", ["plan", amap, *ENDS], "made.csv"
        yield "ambinav forecast MAP ROUTE", ["forecast", amap, route], None
        promise = ["plan", amap, *ENDS, "--max-lost", "0.05"]
        yield "ambinav plan MAP --max-lost 0.05", promise, "promise.csv"
        yield "ambinav compare SCENARIO", ["compare", str(SCENARIO)], "compare"
    every = ["design", "scanners", str(building), "--all"]
    yield "ambinav design scanners BUILDING --all", every, "scanners"
    sweep = ["design", "sweep", *of, "--vary", "max_range=2:8:1"]
    yield "ambinav design sweep BUILDING --vary max_range=2:8:1", sweep, "sweep"
    yield "ambinav design beams BUILDING --loss 5", ["design", "beams", *of, "--loss", "5"], "beams"
    yield (
        "ambinav design place BUILDING --posts 3",
        ["design", "place", *of, "--posts", "3"],
        "place",
    )
    wanted = ["design", "for", str(building), "bad < 15 %", "--scanner", scanner]
    wanted += ["--may", "posts=8,scanner", "--cost", str(COSTS)]
    yield 'ambinav design for BUILDING "bad < 15 %" --may posts=8,scanner', wanted, "changes"


def run(words: list[str], output: Path | None) -> None:
    """Run a command of ambinav."""
    where = [] if output is None else ["-o", str(output)]
    subprocess.run(
        [sys.executable, "-m", "ambinav", *words, *where],
        cwd=ROOT, check=True, stdout=subprocess.DEVNULL, env={**os.environ, "AMBINAV_CACHE": ""},
    )  # fmt: skip


def main() -> None:
    """Time all commands in rounds, and print the table."""
    args = arguments(
        __doc__,
        repeats=option(3, "rounds"),
        environment=option("demo", "the building"),
        scanner=option("turtlebot3-lds", "preset or file"),
    )
    with tempfile.TemporaryDirectory() as scratch:
        folder, contestants = Path(scratch), {}
        building = environment_path(args.environment)
        for text, words, name in commands(building, args.scanner, folder):
            contestants[text] = partial(run, words, None if name is None else folder / name)
        times = interleave(contestants, args.repeats)
    rows = [(f"`{text}`", spread(timing.seconds, 1)) for text, timing in times.items()]
    body = f"{args.environment}, {args.scanner}.\n\n{table(HEAD, rows, 1)}"
    report("Commands", ("ambinav", "numba", "numpy", "matplotlib", "ompl"), body, args.out)


if __name__ == "__main__":
    main()
