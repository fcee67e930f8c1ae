"""Building ambiguity maps: seconds, rate of the kernel, ratio to the reference, growth, memory.

Each case runs in a process of its own, `map_case.py`. Spacing 0.1 m, radius 0.5 m; if nothing
else is said the scanner has 60 beams over 360 degrees, 4 m, deviation 0.03 m, resolution 0.001 m.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from harness import arguments, environment_path, option, report, spread, table

LIBRARIES = ("ambinav", "numba", "llvmlite", "numpy", "scipy", "shapely", "xarray")
MAIN = "willow_full_005"
GROWTH = ("demo", "aces", "willow_full_005", "edmonton", "infinite-corridor")
PRESET, HEADINGS = "hokuyo-urg-04lx", 8
PART_NAMES = {
    "panorama_returns": "casting the beams",
    "neighbourhood_sums": "ambiguity kernel",
    "turning_moments": "heading",
    "assemble": "layers and dataset",
}
Measured = dict[str, Any]


def run_case(environment: str, *options: object) -> Measured:
    """Run `map_case.py` in a new process, and return what it measured."""
    print(f"measuring {environment} {' '.join(map(str, options))}", file=sys.stderr)
    script = Path(__file__).with_name("map_case.py")
    command = [sys.executable, str(script), environment, *map(str, options)]
    result = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if result.returncode != 0:
        raise SystemExit(result.returncode)
    measured: Measured = json.loads(result.stdout)
    return measured


def kernel_rate(measured: Measured, headings: int = 1) -> str:
    """Return millions of beam comparisons per second in the kernel, median and extremes."""
    compared = measured["pairs"] * measured["beams"] * headings
    return spread([compared / s / 1e6 for s in measured["parts"]["neighbourhood_sums"]], 0)


def seconds_table(measured: Measured, headings: int = 1) -> str:
    """Return a table of the time spent in each part of a map, and the rate of its kernel."""
    rows = [
        ("read and simplify the map", spread(measured["load"])),
        ("grid and triangulation", spread(measured["prepare"])),
        ("build the map", spread(measured["build"])),
    ]
    rows += [(f"- {PART_NAMES[name]}", spread(s)) for name, s in measured["parts"].items()]
    remainder = np.array(measured["build"]) - np.sum(list(measured["parts"].values()), axis=0)
    rows.append(("- lattice, links and the rest", spread(remainder.tolist())))
    total = np.array(measured["prepare"]) + np.array(measured["build"])
    rows.append(("grid, triangulation and build", spread(total.tolist())))
    return "\n\n".join(
        [
            f"{measured['segments']} segments, {measured['area']:.0f} m2 free, "
            f"{measured['poses']} free poses, {measured['beams']} beams, "
            f"{measured['pairs'] / 1e6:.2f} M pairs of poses for each heading.",
            table(("what", "s: median (extremes)"), rows),
            f"The kernel makes {kernel_rate(measured, headings)} million beam comparisons a second "
            "(pairs of poses times beams).",
        ]
    )


def reference_section(measured: Measured) -> str:
    """Return the map's time per pose compared with the reference's."""
    per_pose = np.array(measured["build"]) / measured["poses"]
    reference = np.array(measured["reference"])
    return "\n\n".join(
        [
            "## Against the NumPy reference",
            f"`reference.pose_sums` at {len(reference)} random free poses of the same map, on one "
            f"thread, against the build on {measured['threads']}; the greatest difference "
            f"in ambiguity is {measured['off']:.1e}.",
            table(
                ("what", "value: median (extremes)"),
                [
                    ("reference, ms a pose", spread((reference * 1e3).tolist(), 0)),
                    ("whole build, us a pose", spread((per_pose * 1e6).tolist(), 1)),
                    ("ratio of the medians", f"{np.median(reference) / np.median(per_pose):.0f}"),
                ],
            ),
        ]
    )


def growth_row(name: str, measured: Measured) -> tuple[object, ...]:
    """Return one row of the table of growth."""
    build = float(np.median(measured["build"]))
    return (
        name,
        measured["segments"],
        measured["poses"],
        f"{np.median(measured['load']):.2f}",
        f"{np.median(measured['prepare']):.2f}",
        spread(measured["build"]),
        f"{build / measured['poses'] * 1e6:.1f}",
        f"{measured['memory_before']:.0f}",
        f"{measured['memory']:.0f}",
    )


GROWTH_HEADER = (
    "environment", "segments", "free poses", "read s", "prepare s", "build s: median (extremes)",
    "us a pose", "MiB before", "peak MiB",
)  # fmt: skip


def main() -> None:
    """Measure as the command line says, and report."""
    args = arguments(__doc__, repeats=option(5, "builds"), threads=2, reference_poses=10)
    for name in (MAIN, *GROWTH):
        environment_path(name)
    options = ("--threads", args.threads, "--repeats", args.repeats)
    first = run_case(MAIN, *options, "--reference-poses", args.reference_poses)
    grown = {name: run_case(name, *options) for name in GROWTH}
    turned = run_case(MAIN, *options, "--scanner", PRESET, "--headings", HEADINGS)
    body = "\n\n".join(
        [
            f"{args.threads} threads, {args.repeats} builds each after a warm-up.",
            f"## {MAIN}",
            seconds_table(first),
            reference_section(first),
            "## Growth",
            "MiB before: resident when the kernels are loaded and no map is read yet.",
            table(GROWTH_HEADER, [growth_row(name, measured) for name, measured in grown.items()]),
            f"## {MAIN}, {PRESET}, {HEADINGS} headings",
            seconds_table(turned, HEADINGS),
            f"Peak memory {turned['memory']:.0f} MiB.",
        ]
    )
    report("Building ambiguity maps", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
