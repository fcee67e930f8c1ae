"""Delay until the page shows its first picture on loopback, and the amount of data requested.

    python benchmarks/bench_page.py MAP.zarr [--runs 10]

Each run is a browser context of its own, so that nothing is in its cache. The time is the
browser's, from the start of the navigation until all tiles of the first layer are drawn.
"""

from __future__ import annotations

import argparse
import statistics
from pathlib import Path
from typing import Any

from page_browser import browser, serving


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("--runs", type=int, default=10)
    args = parser.parse_args()
    with browser() as chromium, serving([args.map]) as url:
        timings = [_open(chromium, url) for _ in range(args.runs)]
    print("| | first run | median | least | most |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for name, digits in (
        ("first tile (s)", 2),
        ("first picture (s)", 2),
        ("requests", 0),
        ("kB", 0),
    ):
        values = [timing[name] for timing in timings]
        figures = (values[0], statistics.median(values), min(values), max(values))
        print(f"| {name} | " + " | ".join(f"{value:.{digits}f}" for value in figures) + " |")


def _open(chromium: Any, url: str) -> dict[str, float]:
    context = chromium.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.goto(url, wait_until="commit")
    page.wait_for_selector(".map[data-shown]", timeout=60_000)
    shown = page.evaluate("performance.now()")
    entries = page.evaluate(
        "performance.getEntriesByType('resource').map(e => [e.name, e.responseEnd, e.transferSize])"
    )
    tiles = [end for name, end, _ in entries if "/tiles/" in name]
    # Values computed once by the server must not slow the next run.
    page.wait_for_selector(".stage:not([aria-busy])", timeout=120_000)
    page.wait_for_timeout(1000)
    context.close()
    return {
        "first tile (s)": min(tiles) / 1e3,
        "first picture (s)": shown / 1e3,
        "requests": len(entries) + 1,
        "kB": sum(size for _, _, size in entries) / 1e3,
    }


if __name__ == "__main__":
    main()
