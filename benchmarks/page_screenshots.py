"""Screenshots of the page and of a report, light and dark, 1280 and 390 pixels wide.

    python benchmarks/page_screenshots.py MAP.zarr --report DIR/report.html --out out/page

They are for people to look at: nothing is compared. `--start` and `--goal` are for the routes,
`--obstacles` names a file of them for an edit.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from page_browser import browser, serving

SIZES = ((1280, 800), (390, 844))
SCHEMES = ("light", "dark")


def main() -> None:
    """Take all screenshots."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("--report", type=Path, action="append", default=[])
    parser.add_argument("--start", type=float, nargs=2)
    parser.add_argument("--goal", type=float, nargs=2)
    parser.add_argument("--obstacles", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/page"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    with browser() as chromium, serving([args.map]) as url:
        for width, height in SIZES:
            for scheme in SCHEMES:
                name = f"{width}-{scheme}.png"
                size = {"width": width, "height": height}
                context = chromium.new_context(viewport=size, color_scheme=scheme)
                page = context.new_page()
                page.goto(url)
                _ready(page)
                _page(page, args, name)
                for report in args.report:
                    page.goto(report.resolve().as_uri())
                    _ready(page)
                    kind = report.resolve().parent.name
                    page.screenshot(path=args.out / f"report-{kind}-{name}", full_page=True)
                context.close()
                print(name, flush=True)


def _page(page: Any, args: argparse.Namespace, name: str) -> None:
    """Take zones, a layer with a scan, a place, and routes where ends are given."""
    page.screenshot(path=args.out / f"zones-{name}")
    page.locator("input[value=level]").check()
    page.wait_for_selector(".map[data-shown=level]")
    page.get_by_role("tab", name="Places").click()
    if page.locator(".place-entry").count():
        page.locator(".place-entry").first.click()
        page.locator(".readout dd").first.wait_for()
        page.wait_for_timeout(2500)
    page.screenshot(path=args.out / f"place-{name}")
    page.get_by_role("tab", name="About").click()
    page.screenshot(path=args.out / f"about-{name}")
    if args.start and args.goal:
        page.get_by_role("tab", name="Routes").click()
        page.locator(".map").focus()
        page.keyboard.press("Escape")
        page.keyboard.press("0")
        for end, place in (("start", args.start), ("goal", args.goal)):
            for axis, value in zip("xy", place, strict=True):
                field = page.get_by_label(f"{end} {axis}, metres")
                field.fill(str(value))
                field.press("Tab")
        page.locator(".route-card").nth(1).wait_for(timeout=120_000)
        page.get_by_role("button", name="Trade-off curve").click()
        page.locator(".chart .dot").first.wait_for(timeout=300_000)
        page.locator(".chart .dot").nth(1).click()
        page.wait_for_timeout(500)
        page.screenshot(path=args.out / f"routes-{name}")
    if args.obstacles:
        page.locator(".map").focus()
        page.keyboard.press("Escape")
        page.keyboard.press("0")
        page.keyboard.press("1")
        page.get_by_role("tab", name="Edit").click()
        page.wait_for_timeout(500)
        page.screenshot(path=args.out / f"edit-before-{name}")
        page.get_by_label("File of obstacles").set_input_files(args.obstacles)
        page.locator(".gain").wait_for(timeout=120_000)
        page.wait_for_selector("#panel-edit:not([aria-busy])")
        page.wait_for_timeout(800)
        page.screenshot(path=args.out / f"edit-after-{name}")


def _ready(page: Any) -> None:
    page.wait_for_selector(".map[data-shown]")
    page.wait_for_selector(".stage:not([aria-busy])")
    page.wait_for_timeout(800)


if __name__ == "__main__":
    main()
