"""Build times against another commit's, alternating in one run, and levels on all maps.

Give checkouts: `--base` is timed against this one; `--before`, one that reads maps the same as this
one does, is what levels are compared with. Each build runs in a process of its own on 2 threads.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from harness import ROOT, add_out, environment_path, report, spread, table
from kernel_case import CELLS, scanner_of
from numpy.typing import NDArray

from ambinav.ambiguity import reference
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.ambiguity.tensor import relative_radii
from ambinav.buildings.load import load_environment
from ambinav.geometry.lattice import Lattice
from ambinav.map_building.build import BEAMS_PER_TURN, HEADINGS

MAIN = "willow_full_005"
CASES = (("plain", None), ("hokuyo-urg-04lx", 8))
SCANNERS = ("plain", "rplidar-a1", "polaroid-6500-ring", "hokuyo-urg-04lx")
# Permitted difference of the level.
ALLOWED = 1e-3
# Of the poses of one map and scanner that differ by more, so many are held against the reference.
HELD = 2


def run_case(checkout: Path, *words: object) -> str:
    """Run `kernel_case.py` with the ambinav of a checkout."""
    script = Path(__file__).with_name("kernel_case.py")
    folders = [checkout, checkout / "envs", checkout / "planners"]
    done = subprocess.run(
        [sys.executable, str(script), *map(str, words)],
        # Without the store: a map that was built before would be opened.
        env={
            **os.environ, "PYTHONPATH": os.pathsep.join(map(str, folders)), "AMBINAV_CACHE": "",
        },
        stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    return done.stdout


def speed(base: Path, rounds: int) -> str:
    """Return a table of seconds of the base and of this checkout, and their ratio."""
    rows = []
    for scanner, headings in CASES:
        extra = ["--headings", headings] if headings else []
        seconds: dict[Path, list[tuple[float, float]]] = {base: [], ROOT: []}
        for k in range(rounds):
            print(f"{scanner}: round {k + 1} of {rounds}", file=sys.stderr)
            for checkout in (base, ROOT):
                said = run_case(checkout, environment_path(MAIN), scanner, *extra)
                seconds[checkout] += json.loads(said)
        for k, what in enumerate(("wall clock", "processor")):
            old, new = ([pair[k] for pair in seconds[c]] for c in (base, ROOT))
            name = f"{scanner}, {headings or 1} heading{'s' if headings else ''}"
            rows.append(
                (
                    name, what, spread(old), spread(new), f"{min(old) / min(new):.2f}",
                    f"{np.median(old) / np.median(new):.2f}",
                )
            )  # fmt: skip
    header = ("map", "seconds", "base", "now", "least by least", "median by median")
    return table(header, rows, words=2)


def all_maps() -> list[Path]:
    """Return the environments of the recorded data."""
    data = Path(os.environ["AMBINAV_DATA"])
    return sorted(data.glob("*/*.yaml"))


def agreement(before: Path, names: list[str]) -> str:
    """Return a table of the level differences of all maps to those of another checkout."""
    rows, held, worst = [], [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{k}.npz" for k in range(2)]
        for path in all_maps():
            if names and path.stem not in names:
                continue
            print(path.stem, file=sys.stderr)
            for checkout, file in zip((before, ROOT), files, strict=True):
                run_case(checkout, path, *SCANNERS, "--levels", file)
            first, other = (np.load(file) for file in files)
            for scanner in SCANNERS:
                a, b = first[scanner], other[scanner]
                if a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
                    raise SystemExit(f"{path.stem}, {scanner}: not the same poses.")
                off = np.abs(a - b)[np.isfinite(a)]
                spacing = float(first["spacing"])
                for at in np.argwhere(np.abs(a - b) >= ALLOWED)[:HELD]:
                    true = true_level(path, scanner, spacing, at)
                    held.append((path.stem, scanner, a[tuple(at)], b[tuple(at)], true))
                worst = max(worst, float(off.max()))
                rows.append(
                    (
                        path.stem, scanner, f"{spacing:g}", off.size,
                        f"{off.max():.1e}", f"{np.quantile(off, 0.999):.1e}",
                        int((off >= ALLOWED).sum()),
                    )
                )  # fmt: skip
    header = ("map", "scanner", "spacing, m", "poses", "greatest", "99.9 %", f"from {ALLOWED:g} on")
    parts = [f"The greatest difference is {worst:.1e}.", table(header, rows, words=2)]
    if held:
        parts += [
            f"Of poses from {ALLOWED:g} on, at most {HELD} of a map and scanner, against the NumPy "
            "reference:",
            table(
                ("map", "scanner", "before", "now", "reference"),
                [(*row[:2], *(f"{value:.5f}" for value in row[2:])) for row in held],
                words=2,
            ),
        ]
    return "\n\n".join(parts)


def true_level(path: Path, name: str, spacing: float, at: NDArray[np.intp]) -> float:
    """Return the level by `reference.pose_sums` at a cell (row, column, and heading if any)."""
    env, full = load_environment(path), scanner_of(name)
    turned = len(at) > 2
    mounted = full if turned else full.centred
    share = mounted.aperture / math.tau
    scanner = mounted.thinned(max(round(BEAMS_PER_TURN * share), len(mounted.parts)))
    tau = independent_tau(scanner)
    model = AmbiguityModel(radius=CELLS * spacing, map_std=env.map_std, tau=tau)
    lattice = Lattice.over(env, spacing)
    theta = math.tau * at[2] / HEADINGS if turned else 0.0
    x, y = float(lattice.x[at[1]]), float(lattice.y[at[0]])
    sums = reference.pose_sums(env, scanner, model, spacing, x, y, theta)
    return float(relative_radii(sums[None])["level"][0])


def main() -> None:
    """Measure as the command line says, and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--base", type=Path, help="checkout to time this one against")
    parser.add_argument("--before", type=Path, help="checkout to compare levels with")
    parser.add_argument("--maps", nargs="+", default=[], help="to compare (default: all)")
    parser.add_argument("--rounds", type=int, default=5, help="of 3 builds (default: %(default)s)")
    add_out(parser)
    args = parser.parse_args()
    parts = []
    if args.base:
        parts.append(f"## Seconds, {MAIN}\n\n{speed(args.base, args.rounds)}")
    if args.before:
        parts.append(f"## Levels\n\n{agreement(args.before, args.maps)}")
    libraries = ("ambinav", "numba", "llvmlite", "numpy")
    report("The ambiguity kernel against another commit", libraries, "\n\n".join(parts), args.out)


if __name__ == "__main__":
    main()
