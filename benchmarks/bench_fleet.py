"""Audit a fleet of generated sites with one worker and with two, then kill workers and commands.

Each run is the command itself, from its start to its end; those with one worker and with two take
turns, as other work on the machine comes and goes. What two processors can do at all is measured
beside them: two plain loops at once against one. Half of the kills (SIGKILL) are of a
random worker, half of the command with all its workers, at random moments after it has made its
first result; the same command then resumes. Whenever it comes to its end, every file is compared
with that of the undisturbed run: results without their member `run`, and all others but
runs.parquet byte for byte. Status 1: a file differs, is missing or was left behind.

    python benchmarks/bench_fleet.py --out benchmarks/results/fleet.md
    python benchmarks/bench_fleet.py --sites 1000 --rounds 1 --kills 0 --dask   # a Dask cluster
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import psutil
from harness import ROOT, arguments, option, report, table

from ambinav.buildings.plan_writer import plan_geojson
from ambinav_envs.buildings.suites import suite

SUITES = ("hall", "corridor", "office", "warehouse", "loop", "procedural")
SCANNER = "turtlebot3-lds"
MOMENTS = (0.2, 4.0)
"""Seconds between two kills, from and to."""
LOOP = "for i in range(100_000_000): i * i % 7"
"""Work for one processor without memory, files or start-up to speak of."""
UNDISTURBED = ("runs.parquet", "work/lock")
"""Files that are not compared."""


def draw_sites(folder: Path, count: int) -> None:
    """Write plans of the drawn suites in turn, in a folder for each suite."""
    for k in range(count):
        name = SUITES[k % len(SUITES)]
        path = folder / name / f"{k:04d}.geojson"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(plan_geojson(suite(name).building(1 + k // len(SUITES)))))


def started(
    sites: Path, output: Path, workers: int | str, spacing: float
) -> subprocess.Popen[bytes]:
    """Start the command in a session of its own, with so many processes or the address of Dask."""
    command = [sys.executable, "-m", "ambinav.cli", "fleet", "audit", str(sites), "-s", SCANNER]
    command += ["--dask" if isinstance(workers, str) else "--workers", str(workers)]
    command += ["--spacing", str(spacing), "-q", "-o", str(output)]
    return subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL, start_new_session=True)


def seconds_of(sites: Path, output: Path, workers: int | str, spacing: float) -> float:
    """Run the command to its end, and return its duration."""
    begun = time.monotonic()
    if started(sites, output, workers, spacing).wait():
        raise RuntimeError("ambinav fleet audit failed")
    return time.monotonic() - begun


def spread(values: list[float], form: str) -> str:
    """Format median and extremes."""
    return f"{np.median(values):{form}} ({min(values):{form}} to {max(values):{form}})"


def ceiling() -> float:
    """Return how many times as fast two loops that share nothing are at once."""
    command = [sys.executable, "-c", LOOP]

    def seconds(count: int) -> float:
        begun = time.monotonic()
        for process in [subprocess.Popen(command) for _ in range(count)]:
            process.wait()
        return time.monotonic() - begun

    return 2.0 * seconds(1) / seconds(2)


def content(output: Path) -> dict[str, bytes]:
    """Return all files that are compared, by name."""
    files = {}
    for path in sorted(output.rglob("*")):
        name = path.relative_to(output).as_posix()
        if path.is_dir() or name in UNDISTURBED:
            continue
        files[name] = path.read_bytes()
        if name.startswith("results/") and path.suffix == ".json":
            plain = json.loads(files[name])
            del plain["run"]
            files[name] = json.dumps(plain).encode()
    return files


def kill_and_resume(
    sites: Path, output: Path, spacing: float, kills: int, seed: int, expected: dict[str, bytes]
) -> tuple[Counter[str], list[str]]:
    """Kill at random until there were so many kills and the command has come to its end.

    Returns:
        What was counted, and the names of files that were not what they should be.
    """
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    while counts["workers killed"] + counts["commands killed"] < kills:
        shutil.rmtree(output, ignore_errors=True)
        counts["fleets audited"] += 1
        while (process := started(sites, output, 2, spacing)).poll() is None:
            counts["commands started"] += 1
            _await_progress(process, output)
            while process.poll() is None:
                remaining = kills - counts["workers killed"] - counts["commands killed"]
                try:
                    process.wait(rng.uniform(*MOMENTS) if remaining else None)
                except subprocess.TimeoutExpired:
                    if _kill(process, rng) == "worker":
                        counts["workers killed"] += 1
                    else:
                        counts["commands killed"] += 1
                        break
            if process.wait() == 0:
                break
        files = content(output)
        names = {*expected, *files}
        wrong += [name for name in sorted(names) if expected.get(name) != files.get(name)]
    return counts, wrong


def _await_progress(process: subprocess.Popen[bytes], output: Path) -> None:
    """Wait until a command has written a result, or has ended."""
    begun = time.time()
    while process.poll() is None:
        if any(path.stat().st_mtime > begun for path in output.glob("results/*/*/*.json")):
            return
        time.sleep(0.05)


def _kill(process: subprocess.Popen[bytes], rng: np.random.Generator) -> str:
    """Kill a worker, or the command and all its workers."""
    workers = [
        child
        for child in psutil.Process(process.pid).children(recursive=True)
        if child.ppid() != process.pid
    ]
    if workers and rng.random() < 0.5:
        workers[int(rng.integers(len(workers)))].kill()
        return "worker"
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return "command"


def main() -> int:
    """Run the benchmark; return the exit status."""
    args = arguments(
        __doc__, sites=200, spacing=0.2, rounds=3, kills=30, seed=1,
        dask=option(False, "the two workers are those of a Dask cluster", action="store_true"),
    )  # fmt: skip
    from pyarrow import parquet

    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bench-fleet-")))
        two: int | str = 2
        if args.dask:
            from distributed import LocalCluster

            two = stack.enter_context(
                LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
            ).scheduler_address
        sites, few = folder / "sites", folder / "few"
        draw_sites(sites, args.sites)
        draw_sites(few, len(SUITES))
        seconds_of(few, folder / "warm", 0, args.spacing)  # kernels are compiled
        rounds: dict[int, list[float]] = {1: [], 2: []}
        ceilings = []
        for _ in range(args.rounds):
            ceilings.append(ceiling())
            for n, workers in ((1, 1), (2, two)):
                shutil.rmtree(folder / f"w{n}", ignore_errors=True)
                rounds[n].append(seconds_of(sites, folder / f"w{n}", workers, args.spacing))
        ratio = [first / second for first, second in zip(*rounds.values(), strict=True)]
        repeated = seconds_of(sites, folder / "w2", two, args.spacing)
        first, second = content(folder / "w1"), content(folder / "w2")
        wrong = [name for name in sorted({*first, *second}) if first.get(name) != second.get(name)]
        peak = max(
            max(parquet.read_table(folder / f"w{n}" / "runs.parquet")["peak_memory_mb"].to_pylist())
            for n in (1, 2)
        )
        counts, killed = kill_and_resume(
            sites, folder / "killed", args.spacing, args.kills, args.seed, first
        )
        page = (folder / "w2" / "index.html").stat().st_size
        rows = [
            ("seconds, 1 worker", spread(rounds[1], ".1f")),
            (f"seconds, 2 workers{' of Dask' if args.dask else ''}", spread(rounds[2], ".1f")),
            ("times as fast", spread(ratio, ".2f")),
            ("times as fast, two plain loops", spread(ceilings, ".2f")),
            ("seconds, the same command again", f"{repeated:.1f}"),
            ("peak memory of a worker, MB", f"{peak:.0f}"),
            ("size of index.html, MB", f"{page / 1e6:.2f}"),
            ("files that differ between 1 and 2 workers", len(wrong)),
            *((name, number) for name, number in sorted(counts.items())),
            ("files that differ after kills", len(killed)),
        ]
        verdict = "FAILED: " + ", ".join((wrong + killed)[:10]) if wrong or killed else "Passed"
        body = (
            f"{args.sites} drawn sites, {SCANNER}, spacing {args.spacing:g} m, with advice; kills "
            f"{MOMENTS[0]:g} to {MOMENTS[1]:g} s apart, seed {args.seed}; {len(first)} files are "
            f"compared. Of {args.rounds} rounds: median, lowest and highest.\n\n"
            f"{table(('', 'figure'), rows)}\n\n**{verdict}.**"
        )
        report("A fleet of sites", ("ambinav", "numba", "numpy", "pyarrow"), body, args.out)
        return 1 if wrong or killed else 0


if __name__ == "__main__":
    sys.exit(main())
