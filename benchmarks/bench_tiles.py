"""Maps in tiles: time per pose, memory of each process, scaling with workers, and kills.

    python benchmarks/bench_tiles.py --out benchmarks/results/tiles.md
    python benchmarks/bench_tiles.py --kills 100 --out benchmarks/results/tiles-kills.md

The first needs an idle machine with two cores and some 15 minutes; AMBINAV_DATA must be set. Each
build runs in a process of its own, so that its peak of memory and those of its workers are its own.
Spacing 0.1 m, radius 0.5 m, 60 beams over 360 degrees, 4 m, deviation 0.03 m. Status 1 of the
second: a map was another than that of a build that nobody disturbed.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from harness import arguments, environment_path, option, report, spread, table
from lasers import laser
from map_case import RADIUS, SPACING

from ambinav.buildings.load import load_environment
from ambinav.map_building.build import MapSettings
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.tiles.build import run_plan
from ambinav.tiles.plan import TilePlan

LARGE, SMALL = "stata_tiled_2x9_huge", "willow_full_005"
KILL_CASE = {"spacing": 0.2, "tile": 3.0, "scanner": "hokuyo-urg-04lx"}
PAUSE = 9.0  # seconds at most between two kills: it takes some to begin


def path_of(name: str) -> Path:
    """Return the file of an environment; the large one's is beside the others."""
    if name != LARGE:
        return environment_path(name)
    return environment_path(SMALL).with_name(f"{LARGE}.yaml")


def case(name: str, workers: int, tile: float) -> None:
    """Build one map in this process and its workers, and print its costs as JSON."""
    begun = time.perf_counter()
    env = load_environment(path_of(name))
    loaded = time.perf_counter() - begun
    plan = TilePlan.of(env, MapSettings.of(env, laser(), SPACING, RADIUS), tile)
    tiles = list(plan.tiles())
    sample = tiles[:: max(len(tiles) // 40, 1)]
    plan.estimate(workers)  # loads the kernels
    begun = time.perf_counter()
    sent = [len(pickle.dumps(plan.input(tile))) for tile in sample]
    cut = (time.perf_counter() - begun) / len(sample)
    watch = Watch()
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        built = run_plan(plan, f"{folder}/a.zarr", workers=workers, progress=watch)
        seconds = time.perf_counter() - begun
        stored = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
        free = AmbiguityMap.open(f"{folder}/a.zarr", lazy=True).dataset["free"]
        before = int(free[: plan.cells, : plan.cells].sum())
    # Without the start of the workers and the tiles made until then.
    counted = built.poses - before
    print(
        json.dumps(
            {
                "poses": built.poses, "tiles": built.tiles, "seconds": seconds, "loaded": loaded,
                "wall": (watch.last - watch.first) * workers / counted,
                "cpu": (watch.used - watch.used_first) / counted,
                "sent": sent, "cut": cut, "stored": stored,
                "giver": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
                "worker": watch.peak,
            }
        )
    )  # fmt: skip


class Watch:
    """Measures the workers whenever a tile is done.

    Attributes:
        first: When the first was done.
        last: When the last was done.
        used_first: Processor time of all workers when the first was done, seconds.
        used: The same when the last was done.
        peak: Most memory of a worker, bytes. (The system's account of children that have ended
            begins with what this process held when they began.)
    """

    def __init__(self) -> None:
        self.first = self.last = self.used = self.used_first = 0.0
        self.peak = 0

    def __call__(self, share: float) -> None:
        """Record processor time and peak memory of the workers."""
        used = 0.0
        for worker in psutil.Process().children():
            times = worker.cpu_times()
            used += times.user + times.system
            for line in Path(f"/proc/{worker.pid}/status").read_text().splitlines():
                if line.startswith("VmHWM"):
                    self.peak = max(self.peak, int(line.split()[1]) * 1024)
        now = time.perf_counter()
        if not self.first:
            self.first, self.used_first = now, used
        self.last, self.used = now, used


def run_case(name: str, workers: int, tile: float) -> dict[str, Any]:
    """Run `case` in a new process, and return what it measured."""
    print(f"measuring {name}, {workers} workers", file=sys.stderr)
    command = [sys.executable, __file__, "--case", name, str(workers), str(tile)]
    result = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    measured: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    return measured


def measure(tile: float, repeats: int, out: Path | None) -> None:
    """Time both maps on one worker, and the large one on two."""
    cases = [(SMALL, 1), (LARGE, 1), (LARGE, 2)]
    by_case: dict[tuple[str, int], list[dict[str, Any]]] = {case_key: [] for case_key in cases}
    for _ in range(repeats):
        for case_key in cases:
            by_case[case_key].append(run_case(*case_key, tile))
    rows = []
    for (name, workers), runs in by_case.items():
        case_key = runs[0]
        rows.append(
            [
                name, workers, case_key["poses"], case_key["tiles"],
                spread([run["seconds"] for run in runs], 1),
                *(spread([1e6 * run[clock] for run in runs], 1) for clock in ("wall", "cpu")),
                *(f"{max(run[who] for run in runs) / 2**30:.2f}" for who in ("giver", "worker")),
                f"{np.mean(case_key['sent']) / 1e3:.1f} ({max(case_key['sent']) / 1e3:.1f})",
                f"{1e3 * case_key['cut']:.1f}", f"{case_key['stored'] / 1e6:.0f}",
            ]
        )  # fmt: skip
    header = [
        "map", "workers", "poses", "tiles", "s", "us per pose and worker", "of the processor",
        "GiB, this process", "GiB, a worker", "kB sent a tile (most)", "ms to cut a tile",
        "MB stored",
    ]  # fmt: skip
    ratios = [
        a["seconds"] / b["seconds"]
        for a, b in zip(by_case[LARGE, 1], by_case[LARGE, 2], strict=True)
    ]
    per_pose = [
        a["wall"] / b["wall"] for a, b in zip(by_case[LARGE, 1], by_case[SMALL, 1], strict=True)
    ]
    body = (
        f"Tiles of {tile:g} m; {repeats} repeats, one after the other.\n\n"
        f"{table(header, rows)}\n\n"
        f"- 2 workers to 1, {LARGE}: {spread(ratios)} times as fast (asked: 1.8).\n"
        f"- Time per pose, {LARGE} to {SMALL}: {spread(per_pose)} (asked: within 20 %).\n"
    )
    report("Maps in tiles", ("ambinav", "numba", "numpy", "xarray", "zarr"), body, out)


def command(output: Path) -> list[str]:
    """Return the command of the build that is killed."""
    file = Path(__file__).parents[1] / "ambinav" / "demo" / "demo.geojson"
    options = [f"--{name}={value}" for name, value in KILL_CASE.items()]
    start = [sys.executable, "-m", "ambinav.cli", "map", str(file), *options]
    return [*start, "--workers=2", "-o", str(output)]


def kill_often(count: int, seed: int, out: Path | None) -> bool:
    """Kill workers and whole builds at random moments, and compare the resulting maps."""
    rng = np.random.default_rng(seed)
    kills = {"worker": 0, "build": 0}
    maps = same = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run(command(folder / "ref.zarr"), check=True, capture_output=True)
        expected = AmbiguityMap.open(folder / "ref.zarr").dataset.assign_attrs(created="")
        output = folder / "a.zarr"
        while sum(kills.values()) < count or not maps:
            build = subprocess.Popen(
                command(output), stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
            )
            killing = sum(kills.values()) < count
            while killing and build.poll() is None:
                try:
                    build.wait(float(rng.uniform(0.0, PAUSE)))
                except subprocess.TimeoutExpired:
                    victim = "worker" if rng.random() < 0.6 else "build"
                    kills[victim] += end(build, victim, rng)
                killing = sum(kills.values()) < count
            build.wait()
            if build.returncode == 0:
                maps += 1
                dataset = AmbiguityMap.open(output).dataset.assign_attrs(created="")
                same += int(dataset.identical(expected))
                shutil.rmtree(output)
    rows = [[kills["worker"], kills["build"], maps, same]]
    header = ["workers killed", "builds killed", "maps that came of it", "of these identical"]
    body = f"Demo, {KILL_CASE}, seed {seed}, 2 workers.\n\n{table(header, rows, 0)}"
    report("Killed builds of maps in tiles", ("ambinav", "zarr"), body, out)
    return maps == same


def end(build: subprocess.Popen[bytes], victim: str, rng: np.random.Generator) -> int:
    """Kill a build or one of its workers; return 1 if there was one."""
    try:
        target = psutil.Process(build.pid)
        if victim == "worker":
            # The others belong to multiprocessing.
            workers = [
                child for child in target.children() if "spawn_main" in " ".join(child.cmdline())
            ]
            if not workers:
                return 0
            target = workers[int(rng.integers(len(workers)))]
        os.kill(target.pid, signal.SIGKILL)
    except (psutil.NoSuchProcess, ProcessLookupError):
        return 0
    return 1


def main() -> None:
    """Read the command line and run what it asks for."""
    args = arguments(
        __doc__,
        tile=option(20.0, "metres"),
        repeats=3,
        kills=option(0, "kill so often instead of timing"),
        seed=25,
        case=option(None, argparse.SUPPRESS, nargs=3),
    )
    if args.case:
        case(args.case[0], int(args.case[1]), float(args.case[2]))
    elif args.kills:
        raise SystemExit(0 if kill_often(args.kills, args.seed, args.out) else 1)
    else:
        measure(args.tile, args.repeats, args.out)


if __name__ == "__main__":
    main()
