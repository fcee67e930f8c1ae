"""From an edit on the page to the map that shows it, in a browser.

    python benchmarks/bench_page.py --out benchmarks/results/page.md

A building is opened in headless Chromium, and posts are drawn, and then dragged, at random places
of its floor. The browser itself takes the time from the last press or move of the pointer until
every tile of the edited map is shown. Also measured: when after the call of the page its skeleton,
the floor and all the rest are there.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from harness import arguments, environment_path, report, table
from numpy.typing import NDArray
from service import make_map, serving, wait_until_ready

import ambinav as an

BUILDINGS = ("belgioioso", "nav2_depot", "stata_hallways_5cm", "willow_full_005")
SPACING = 0.2
SHIFT = 1.0
"""Metres by which a post is dragged."""
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
WATCH = """() => {
  for (const kind of ["pointerdown", "pointermove"]) {
    addEventListener(kind, () => (window.moved = performance.now()), true);
  }
  new MutationObserver(() => (window.shown = performance.now())).observe(
    document.querySelector(".map"), { attributes: true, attributeFilter: ["data-version"] });
}"""
"""Notes when the pointer was pressed or moved last, and when an edited map was shown last."""
OPENED = """() => {
  const paint = performance.getEntriesByName("first-contentful-paint")[0];
  return paint ? paint.startTime : performance.now();
}"""


class Page:
    """The page of a service, opened in a browser of its own."""

    def __init__(self, browser: Any, url: str) -> None:
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        context.set_default_timeout(60_000)
        self.page = context.new_page()
        self.page.goto(url, wait_until="commit")
        self.opened = []
        self.page.wait_for_selector(".map[data-shown]")
        self.opened.append(self.page.evaluate(OPENED) / 1000)
        self.opened.append(self._seconds())
        self.page.wait_for_selector(".stage:not([aria-busy])")
        self.opened.append(self._seconds())
        self._scale = self._measured()
        self.page.get_by_role("tab", name="Edit").click()
        self.page.wait_for_selector("#panel-edit:not([aria-busy])")

    def _seconds(self) -> float:
        return float(self.page.evaluate("performance.now()")) / 1000

    def _measured(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return pixels and metres of two places, as the readout gives them."""
        box = self.page.locator(".map").bounding_box()
        pixels, metres = [], []
        for share in (0.35, 0.6):
            at = box["x"] + share * box["width"], box["y"] + share * box["height"]
            self.page.mouse.move(at[0] - 3, at[1])
            self.page.mouse.move(*at)
            self.page.wait_for_timeout(300)
            readout = self.page.locator(".readout[data-x]")
            pixels.append(at)
            metres.append([float(readout.get_attribute(f"data-{axis}")) for axis in "xy"])
        return np.array(pixels), np.array(metres)

    def pixel(self, place: NDArray[np.float64]) -> tuple[float, float]:
        """Return the pixel of a place of the map frame."""
        (a, b), (low, high) = self._scale
        x, y = a + (place - low) / (high - low) * (b - a)
        return float(x), float(y)

    def edited(self, action: Callable[[], object]) -> float:
        """Return the seconds from the last press or move of the pointer to the edited map."""
        self.page.evaluate("() => { window.shown = 0; }")
        action()
        self.page.wait_for_function("() => window.shown > window.moved")
        self.page.wait_for_selector("#panel-edit:not([aria-busy])")
        return float(self.page.evaluate("window.shown - window.moved")) / 1000

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag what is at a pixel to another one within a tenth of a second."""
        self.page.mouse.move(*start)
        self.page.mouse.down()
        for share in np.linspace(0.2, 1.0, 5):
            self.page.mouse.move(*(np.array(start) + share * np.subtract(end, start)))
            self.page.wait_for_timeout(20)
        self.page.mouse.up()


def edits(page: Page, amap: an.AmbiguityMap, count: int, seed: int) -> dict[str, list[float]]:
    """Draw and drag posts; return the seconds of each."""
    rng = np.random.default_rng(seed)
    step = max(3, round(SHIFT / amap.spacing))
    counted = amap.judged.counted
    free = np.argwhere(counted[:, :-step] & counted[:, step:])
    seconds: dict[str, list[float]] = {"drawn": [], "dragged": []}
    page.page.evaluate(WATCH)
    for _ in range(count):
        row, column = free[rng.integers(len(free))]
        place = np.array([amap.dataset["x"].values[column], amap.dataset["y"].values[row]])
        at = page.pixel(place)
        page.page.get_by_role("toolbar").get_by_role("button", name="Post").click()
        seconds["drawn"].append(page.edited(lambda: page.page.mouse.click(*at)))  # noqa: B023
        page.page.get_by_role("toolbar").get_by_role("button", name="Move").click()
        near = page.pixel(place + np.array([step * amap.spacing, 0.0]))
        seconds["dragged"].append(page.edited(lambda: page.drag(at, near)))  # noqa: B023
        page.page.get_by_role("button", name="Reset").click()
        page.page.wait_for_function("() => !document.querySelectorAll('.obstacles li').length")
        page.page.wait_for_selector("#panel-edit:not([aria-busy])")
    return seconds


def main() -> None:
    """Measure and write the report."""
    args = arguments(__doc__, edits=20, seed=1)
    from playwright.sync_api import sync_playwright

    path = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if path is None:
        raise SystemExit("bench_page.py: there is no Chromium on this machine; install chromium.")
    rows, opened = [], []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as drivers:
        browser = drivers.chromium.launch(executable_path=path, args=["--no-sandbox"])
        for name in BUILDINGS:
            file = make_map(Path(folder) / f"{name}.zarr", environment_path(name), SPACING)
            amap = an.AmbiguityMap.open(file)
            area = float(amap.judged.counted.sum()) * amap.spacing**2
            with serving(file) as (url, _):
                wait_until_ready(url)
                first, page = (Page(browser, url) for _ in range(2))
                edit_seconds = edits(page, amap, args.edits, args.seed)
            about = (name, f"{area:.0f}", f"{amap.judged.counted.size:,}")
            for kind, seconds in edit_seconds.items():
                quantiles = [f"{1000 * np.quantile(seconds, q):.0f}" for q in (0.5, 0.95, 1.0)]
                rows.append((*about, kind, *quantiles))
            for times, visit in ((first.opened, "first"), (page.opened, "second")):
                opened.append((*about, visit, *(f"{1000 * second:.0f}" for second in times)))
        browser.close()
    head = ("building", "judged floor, m²", "cells")
    body = (
        f"{args.edits} posts a building, drawn and then dragged; cells of {SPACING:g} m; server "
        "and browser on the same cores. Milliseconds from the last press or move of the pointer to "
        "the edited map:\n\n"
        + table((*head, "post", "median", "95 %", "most"), rows)
        + "\n\nMilliseconds from the call of the page to its first paint, the floor, and all of "
        "it:\n\n" + table((*head, "visit", "first paint", "floor", "all"), opened)
    )
    report("The page", ("ambinav", "playwright", "uvicorn"), body, args.out)


if __name__ == "__main__":
    main()
