"""Delay until the page shows the map around an obstacle that is drawn, or dragged.

    python benchmarks/bench_edit.py MAP.zarr --at X Y [--runs 10]

In each run a wall of 2 m is drawn at another place around (X, Y), metres, and then dragged by
its number. The times are the browser's: from letting go of the pointer until all tiles of the zones
are drawn, and, while the wall is dragged, between two versions of the map. Where other programs
run, the processor's time of the work itself, in one thread, says more.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numba
from page_browser import browser, serving

from ambinav.geometry.obstacle import Obstacle
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.server.wire import read_dataset, write_dataset

WAIT = 120_000
"""Milliseconds after which something did not happen."""
HALF = 1.0
"""Half of the wall's length, metres."""
STEPS = 40
"""Steps of a drag over a metre."""
PAUSE = 50
"""Milliseconds between two of them."""
NOTES = """() => {
  window.notes = { drop: 0, shown: [] };
  const map = document.querySelector('.map');
  addEventListener('pointerup', () => (window.notes.drop = performance.now()), true);
  new MutationObserver(() => window.notes.shown.push(performance.now()))
    .observe(map, { attributeFilter: ['data-version'] });
}"""
"""Notes when the pointer is let go, and when another version of the map is shown."""


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("--at", type=float, nargs=2, required=True)
    parser.add_argument("--runs", type=int, default=10)
    args = parser.parse_args()
    seconds: dict[str, list[float]] = {
        name: [] for name in ("service", "drawn", "dropped", "dragged")
    }
    with browser() as chromium, serving([args.map]) as url:
        page = chromium.new_context(viewport={"width": 1280, "height": 800}).new_page()
        page.set_default_timeout(WAIT)
        page.goto(url)
        page.wait_for_selector(".map[data-shown]")
        page.wait_for_selector(".stage:not([aria-busy])")
        middle, metre = _scale(page, *args.at)
        with page.expect_response(lambda answer: answer.url.endswith("/edits")):
            page.get_by_role("tab", name="Edit").click()  # makes the process ready
        page.evaluate(NOTES)
        for run in range(args.runs):
            x = middle[0] + metre * (run - args.runs / 2) / args.runs
            for name, value in _edit(page, x, middle[1], metre).items():
                seconds[name] += value
    seconds["work"] = _work(args.map, *args.at, args.runs)
    print(f"load {os.getloadavg()[0]:.1f}, {args.runs} runs")
    print("\n| s | median | least | most | n |\n| --- | ---: | ---: | ---: | ---: |")
    for name, title in (
        ("service", "the service's answer to the wall"),
        ("drawn", "drawn wall let go to new tiles"),
        ("dropped", "dragged wall let go to new tiles"),
        ("dragged", "between versions while dragged"),
        ("work", "processor's time of an edit"),
    ):
        values = seconds[name]
        figures = (statistics.median(values), min(values), max(values)) if values else ()
        print(
            f"| {title} | "
            + " | ".join(f"{figure:.2f}" for figure in figures)
            + f" | {len(values)} |"
        )


def _edit(page: Any, x: float, y: float, metre: float) -> dict[str, list[float]]:
    """Draw a wall around a pixel, drag it by a metre, and delete it; return the seconds."""
    page.get_by_role("toolbar").get_by_role("button", name="Wall").click()
    with page.expect_response(lambda answer: "/edits?" in answer.url) as answered:
        page.mouse.move(x, y - HALF * metre)
        page.mouse.down()
        page.mouse.move(x, y + HALF * metre, steps=5)
        page.mouse.up()
    drawn = _shown(page)
    page.get_by_role("toolbar").get_by_role("button", name="Move").click()
    handle = page.locator(".leaflet-marker-icon.obstacle").bounding_box()
    hx, hy = handle["x"] + 12, handle["y"] + 12
    page.evaluate("window.notes.shown = []")
    page.mouse.move(hx, hy)
    page.mouse.down()
    for step in range(1, STEPS + 1):
        page.mouse.move(hx + metre * step / STEPS, hy)
        page.wait_for_timeout(PAUSE)
    versions = page.evaluate("window.notes.shown")
    page.mouse.move(hx + 1.1 * metre, hy)  # no version shown so far belongs to this position
    page.mouse.up()
    dropped = _shown(page)
    page.get_by_role("button", name="Reset").click()
    page.wait_for_selector(".map:not([data-version*='--'])")
    page.wait_for_timeout(500)
    return {
        "service": [answered.value.json()["seconds"]],
        "drawn": [drawn],
        "dropped": [dropped],
        "dragged": [(b - a) / 1e3 for a, b in pairwise(versions)],
    }


def _work(path: Path, x: float, y: float, runs: int) -> list[float]:
    """Return the processor seconds of an edit in a worker, without the first one."""
    numba.set_num_threads(1)
    amap = AmbiguityMap.open(path)
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "edited.npz"
        for run in range(runs + 1):
            at = x + (run - runs / 2) / runs
            begun = time.process_time()
            changed = amap.environment.edited(
                add=[Obstacle.wall([(at, y - HALF), (at, y + HALF)], 0.1)]
            )
            write_dataset(amap.update(changed).dataset, out)
            read_dataset(out)
            seconds.append(time.process_time() - begun)
    return seconds[1:]


def _shown(page: Any) -> float:
    """Return the seconds from releasing the pointer until the new map is shown."""
    page.wait_for_function(
        "() => window.notes.drop && window.notes.shown.some((one) => one > window.notes.drop)"
        " && !document.querySelector('#panel-edit').hasAttribute('aria-busy')"
    )
    page.wait_for_timeout(300)
    drop, shown = page.evaluate("[window.notes.drop, window.notes.shown.at(-1)]")
    page.evaluate("Object.assign(window.notes, { drop: 0, shown: [] })")
    return float(shown - drop) / 1e3


def _scale(page: Any, x: float, y: float) -> tuple[tuple[float, float], float]:
    """Return the pixel of a point in the map frame, and the pixels a metre."""
    box = page.locator(".map").bounding_box()
    known = []
    for share in (0.35, 0.6):
        at = box["x"] + share * box["width"], box["y"] + share * box["height"]
        page.mouse.move(at[0] - 3, at[1])
        page.mouse.move(*at)
        page.wait_for_timeout(1500)
        readout = page.locator(".readout[data-x]")
        readout.wait_for()
        known.append((*at, *(float(readout.get_attribute(f"data-{axis}")) for axis in "xy")))
    (ax, ay, amx, amy), (bx, _, bmx, _) = known
    metre = (bx - ax) / (bmx - amx)
    return (ax + metre * (x - amx), ay - metre * (y - amy)), metre


if __name__ == "__main__":
    main()
