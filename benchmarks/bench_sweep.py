"""Duration of a sweep of 200 settings compared with one map of the present scanner.

The map is built before and after each sweep, and the sweep is divided by the mean of the two.
Processor time counts both threads, and says more than wall clock where other work runs. *all
alike*: eight headings count; *kept*: the robot keeps one heading, as it does where yaw is varied
and nothing else is said. A sweep looks at 1000 places unless it is told otherwise. What the choice
of places does to the result: the mean level of each setting with 1000 places, less that with all.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from harness import arguments, environment_of, option, report, table

from ambinav.map_building.build import build_map
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.sweep.sweep import SweepResult, sweep_scanner

VARY = ("aperture=60:330:30", "yaw=0:342:18")
SCANNER = "hokuyo-urg-04lx"
LIBRARIES = ("ambinav", "numba", "numpy")


def timed(run: Callable[[], Any]) -> tuple[float, float, Any]:
    """Call a function; return wall-clock seconds, processor seconds, and its result."""
    wall, processor = time.perf_counter(), time.process_time()
    result = run()
    return time.perf_counter() - wall, time.process_time() - processor, result


def main() -> None:
    """Measure, and print the report."""
    args = arguments(
        __doc__, environment="willow_full_005", all=option(False, "sweep all places too")
    )
    env = environment_of(args.environment)
    scanner = RangeScanner.from_preset(SCANNER)

    def one_map() -> tuple[float, float]:
        wall, processor, _ = timed(lambda: build_map(env, scanner, store=False))
        return wall, processor

    def swept(places: int, headings: int | None) -> SweepResult:
        return sweep_scanner(env, scanner, VARY, places=places, headings=headings)

    cases: dict[str, tuple[int, int | None]] = {
        "1000 places, heading kept": (1000, None),
        "1000 places, 8 headings all alike": (1000, 8),
    }
    if args.all:
        cases["all places, heading kept"] = (0, None)
    build_map(env, scanner, 0.4, store=False)  # compiles
    swept(20, None)
    rows, results = [], {}
    for name, (places, headings) in cases.items():
        before = one_map()
        wall, processor, results[name] = timed(partial(swept, places, headings))
        after = one_map()
        unit = [(a + b) / 2 for a, b in zip(before, after, strict=True)]
        levels = results[name].levels
        rows.append(
            (name, len(results[name].outcomes), len(levels.places), f"{unit[0]:.1f}",
             f"{unit[1]:.1f}", f"{wall:.1f}", f"{processor:.1f}", f"{wall / unit[0]:.1f}",
             f"{processor / unit[1]:.1f}")
        )  # fmt: skip
    head = (
        "sweep", "settings", "places", "map, s", "map, processor s", "sweep, s",
        "sweep, processor s", "maps", "maps, processor",
    )  # fmt: skip
    body = f"Varied: {', '.join(VARY)}.\n\n{table(head, rows)}"
    if args.all:
        body += f"\n\n{_sampling(*(results[name] for name in list(cases)[::2]))}"
    report(f"Sweeps of {SCANNER} on {args.environment}", LIBRARIES, body, args.out)


def _sampling(sample: SweepResult, every: SweepResult) -> str:
    """Describe the effect of sampling 1000 places on the means of all settings."""
    few, all_of_them = (result.grid(lambda figures: figures.mean) for result in (sample, every))
    off = few - all_of_them
    margin, true = sample.margin(None), every.margin(None)
    rank = every.order.index(sample.order[0]) + 1
    return (
        f"1000 places against all {len(every.levels.places)}: the mean level of a setting is "
        f"{off.mean():+.4f} off in the mean, between {off.min():+.4f} and {off.max():+.4f}; "
        f"differences between settings by {np.std(off):.4f} (standard deviation). The best setting "
        f"of the sample, {sample.best.setting.values}, has rank {rank} among all places; its "
        f"margin over the present scanner is {margin.value:.4f} "
        f"[{margin.low:.4f}, {margin.high:.4f}], "
        f"with all places {true.value:.4f}."
    )


if __name__ == "__main__":
    main()
