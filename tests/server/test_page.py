"""The page in a browser: layers, values, places, keyboard, contrast, and no foreign address."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import ambinav as an
from ambinav.plotting import style
from ambinav.reports.page.single_file import FOLDER, modules
from ambinav.server.access import Access
from ambinav.server.http.app import create_app
from tests.reports.widths import SIZES
from tests.server.axe import violations
from tests.server.live import running

FILES = sorted(path.name for path in FOLDER.iterdir() if path.is_file())
WAIT = 60_000
"""Milliseconds after which something did not happen."""


def visit(chromium: Any, url: str, **options: Any) -> Any:
    """A page that is open and shows its map; it notes requests, errors and whose they are."""
    context = chromium.new_context(**{"viewport": {"width": 1280, "height": 800}, **options})
    context.set_default_timeout(WAIT)
    page = context.new_page()
    page.urls, page.faults = [], []
    page.on("request", lambda request: page.urls.append(request.url))
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on("console", lambda message: message.type == "error" and page.faults.append(message.text))
    page.goto(url)
    page.wait_for_selector(".map[data-shown]")
    page.wait_for_selector(".stage:not([aria-busy])")
    return page


@pytest.fixture
def page(chromium: Any, live: Any) -> Iterator[Any]:
    opened = visit(chromium, f"{live.url}/?map=map")
    yield opened
    opened.context.close()


def at(page: Any, x: float, y: float) -> tuple[float, float]:
    """Pixels of a point of the map frame, from two points that the page tells the metres of."""
    box = page.locator(".map").bounding_box()
    known: list[tuple[float, ...]] = []
    reading: tuple[float, ...] = ()
    for share in (0.3, 0.6):
        px, py = box["x"] + share * box["width"], box["y"] + share * box["height"]
        page.mouse.move(px - 3, py - 3)
        page.mouse.move(px, py)
        readout, before, last = page.locator(".readout[data-x]"), reading, ()
        for _ in range(100):  # a busy machine is late
            page.wait_for_timeout(150)
            readout.wait_for()
            last, reading = reading, tuple(float(readout.get_attribute(f"data-{a}")) for a in "xy")
            if reading == last and reading != before:
                break
        known.append((px, py, *reading))
    (ax, ay, amx, amy), (bx, by, bmx, bmy) = known
    return (ax + (x - amx) / (bmx - amx) * (bx - ax), ay + (y - amy) / (bmy - amy) * (by - ay))


def test_files_are_served_under_a_strict_policy(live):
    for name in ("", *FILES, "leaflet/leaflet.js", "style.js"):
        answer = live.http.get(f"/{name}")
        assert answer.status_code == 200, name
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "http" not in policy


def test_the_page_names_no_address_and_each_module_is_short():
    for name in FILES:
        text = (FOLDER / name).read_text()
        # The name of SVG's language is no address that anything loads.
        assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text), name
        assert len(text.splitlines()) <= 250, name
    assert (FOLDER / "leaflet" / "LICENSE").read_text().startswith("BSD 2-Clause")


def test_colours_are_those_of_the_table(live):
    module = live.http.get("/style.js").text
    table = json.loads(module.removeprefix("export default ").rstrip().rstrip(";"))
    assert tuple(zone["colour"] for zone in table["zones"]) == style.ZONE_COLOURS
    assert table["routes"]["ambiguity"][0] == style.route_style("ambiguity")._asdict() | {
        "dashes": []
    }
    drawn = " ".join((FOLDER / name).read_text() for name in FILES if name != "icon.svg").lower()
    for colour in (*style.ZONE_COLOURS, *style.SERIES, style.SLIDE, style.ECHO):
        assert colour.lower() not in drawn


def test_all_modules_are_reached_from_the_pages():
    reached = modules("main.js").keys() | modules("report.js").keys()
    assert {name for name in FILES if name.endswith(".js")} | {"style.js"} == reached


@pytest.mark.slow
def test_it_opens_and_asks_nobody_else(page, live):
    assert page.faults == []
    assert page.urls
    assert all(url.startswith((live.url, "blob:", "data:")) for url in page.urls)
    assert page.locator("#map-name select").input_value() == "map"
    legend = page.locator(".legend li").all_inner_texts()
    assert legend == ["Localizable", "Transition", "Corridor", "Open", "Not counted"]
    assert page.locator(".leaflet-control-scale-line").inner_text().endswith("m")


@pytest.mark.slow
def test_layers_switch_and_the_legend_follows(page):
    page.get_by_text("Ambiguity level").first.click()
    page.wait_for_selector(".map[data-shown=level]")
    assert "Ambiguity level, mean of major and minor" in page.locator(".legend").inner_text()
    assert any("/layers/level/tiles/" in url for url in page.urls)
    page.get_by_text(re.compile(r"\d more layers")).click()
    page.locator("input[value=clearance]").check()
    page.wait_for_selector(".map[data-shown=clearance]")
    assert "(m)" in page.locator(".legend").inner_text()
    with page.expect_response(lambda answer: "stat=worst" in answer.url) as answered:
        page.get_by_label("A pixel shows the worst of its cells").check()
    assert answered.value.status == 200


@pytest.mark.slow
def test_values_at_the_pointer_are_those_of_the_service(page, live):
    for x, y in ((1.3, 1.7), (7.0, 1.8), (14.0, 1.5)):
        page.mouse.move(*at(page, x, y))
        readout = page.locator(".readout[data-x]")
        names = "level", "major_radius", "minor_radius", "clearance"
        for _ in range(50):  # a busy machine is late
            page.wait_for_timeout(500)
            readout.locator("dd[data-layer=level]").wait_for()
            px, py = (float(readout.get_attribute(f"data-{axis}")) for axis in "xy")
            reading = [
                float(readout.locator(f"dd[data-layer={name}]").get_attribute("data-value"))
                for name in names
            ]
            found = live.get("/v1/maps/map/values", x=f"{px:.4f}", y=f"{py:.4f}")
            expected = pytest.approx([found["values"][name] for name in names], abs=1e-9)
            if (px, py) == pytest.approx((x, y), abs=0.15) and reading == expected:
                break
        assert (px, py) == pytest.approx((x, y), abs=0.15)  # whole pixels
        assert reading == expected
        cost = float(readout.locator("dd[data-layer=cost]").get_attribute("data-value"))
        assert cost == pytest.approx(found["cost"])
        assert (found["zone"] or found["judged"]) in readout.inner_text().lower()


@pytest.mark.slow
def test_places_fly_and_hold_the_point(page, live):
    worst = live.get("/v1/maps/map/worst")
    page.get_by_role("tab", name="Places").click()
    entries = page.locator(".place-entry")
    assert entries.count() == len(worst) > 0
    entries.first.click()
    readout = page.locator(f".readout[data-x='{worst[0]['x']:g}']")
    readout.locator("dd[data-layer=level]").wait_for()
    assert entries.first.get_attribute("aria-pressed") == "true"
    assert page.locator(".badge.place.chosen").count() == 1
    page.get_by_role("button", name="Let go of this point").click()
    page.wait_for_selector(".readout.resting")


@pytest.mark.sweep
def test_another_map_takes_the_place_of_the_first(chromium, live):
    opened = visit(chromium, f"{live.url}/?map=narrow-room")
    choice = opened.get_by_label("Map", exact=True)
    for name in ("map", "narrow-room", "map"):  # faster than they open
        choice.select_option(name)
    opened.wait_for_selector(".stage:not([aria-busy])")
    opened.get_by_role("tab", name="Places").click()
    worst = live.get("/v1/maps/map/worst")
    entries = opened.locator(".place-entry")
    entries.nth(len(worst) - 1).click()  # the other map has fewer
    opened.locator(f".readout[data-x='{worst[-1]['x']:g}']").wait_for()
    assert opened.faults == []
    opened.context.close()


@pytest.mark.sweep
def test_a_mean_over_headings_has_a_cost_at_each_weight(chromium, live):
    opened = visit(chromium, f"{live.url}/?map=narrow-room")
    opened.get_by_role("tab", name="Routes").click()
    opened.get_by_label("Weight of ambiguity").press("ArrowLeft")
    x, y = at(opened, 2.0, 1.0)
    opened.mouse.move(x, y)
    opened.get_by_text("Cost at weight 3").wait_for()
    assert opened.faults == []
    opened.context.close()


@pytest.mark.sweep
def test_the_keyboard_is_enough(page):
    page.locator(".map").focus()
    page.keyboard.press("2")
    page.wait_for_selector(".map[data-shown=level]")
    page.keyboard.press("Enter")
    page.wait_for_selector(".readout[data-x]")
    page.keyboard.press("Escape")
    page.wait_for_selector(".readout.resting")
    page.keyboard.press("w")
    assert not page.locator("input[name=walls]").is_checked()
    page.keyboard.press("n")
    page.wait_for_selector(".badge.place.chosen")
    before = page.locator(".leaflet-map-pane").get_attribute("style")
    page.keyboard.press("ArrowRight")
    moved = "style => document.querySelector('.leaflet-map-pane').getAttribute('style') !== style"
    page.wait_for_function(moved, arg=before)
    page.get_by_role("tab", name="Layers").focus()
    page.keyboard.press("ArrowRight")
    assert page.get_by_role("tab", name="Places").get_attribute("aria-selected") == "true"
    page.keyboard.press("Shift+Tab")
    assert page.faults == []


@pytest.mark.slow
def test_routes_are_planned_by_clicks_and_again_after_a_drag(page):
    pytest.importorskip("ambinav_planners.registry")
    page.get_by_role("tab", name="Routes").click()
    (sx, sy), (gx, gy) = at(page, 1.5, 1.5), at(page, 10.0, 1.75)
    page.mouse.click(sx, sy)
    page.mouse.click(gx, gy)
    cards = page.locator(".route-card")
    cards.nth(1).wait_for()
    texts = cards.all_inner_texts()
    assert "Shortest" in texts[0]
    assert "Weight 5" in texts[1]
    assert all("Length" in text and "Exposure" in text for text in texts)
    page.mouse.move(gx, gy)
    page.mouse.down()
    page.mouse.move(gx - 40, gy, steps=4)
    with page.expect_response(lambda answer: answer.url.endswith("/plan")) as answered:
        page.mouse.up()
    goal = json.loads(answered.value.request.post_data)["goal"]
    assert goal[0] < 9.9
    page.get_by_role("button", name="Trade-off curve").click()
    dots = page.locator(".chart .dot")
    dots.first.wait_for()
    dots.first.focus()
    page.keyboard.press("Enter")
    assert dots.first.get_attribute("aria-pressed") == "true"


@pytest.mark.slow(kept=("390",))
@pytest.mark.parametrize("width", [1280, 768, 390])
def test_a_forecast_is_on_the_card_and_under_the_pointer(chromium, live, width):
    pytest.importorskip("ambinav_planners.registry")
    size = {"width": width, "height": 844}
    page = visit(chromium, f"{live.url}/?map=map", viewport=size, bypass_csp=True)
    page.get_by_role("tab", name="Routes").click()
    ends = {"start": (1.5, 1.5), "goal": (10.0, 2.0)}
    for name, place in ends.items():
        for axis, metres in zip("xy", place, strict=True):
            page.get_by_label(f"{name} {axis}, metres").fill(str(metres))
            page.keyboard.press("Tab")
    cards = page.locator(".route-card")
    cards.nth(1).wait_for()
    page.get_by_label("Odometry").select_option("amcl-default")
    with page.expect_response(
        lambda answer: (
            {"weight": 5, "localizer": "amcl"}.items()
            <= json.loads(answer.request.post_data or "{}").items()
        )
    ) as answered:
        page.get_by_label("Localizer").select_option("amcl")
    forecast = answered.value.json()["forecast"]
    assert (forecast["odometry"], forecast["localizer"]) == ("amcl-default", "amcl")
    page.get_by_text(re.compile(re.escape(forecast["text"]), re.I)).last.wait_for()
    # Pixels of metres, from the marks of start and goal.
    boxes = [page.locator(f".leaflet-marker-icon.badge.{name}").bounding_box() for name in ends]
    (ax, ay), (bx, _) = ((box["x"] + 13, box["y"] + 13) for box in boxes)
    scale = (bx - ax) / (ends["goal"][0] - ends["start"][0])
    clip = {"x": ax, "y": ay - 40, "width": bx - ax, "height": 80}
    pixels = np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB"))
    red = [int(style.ZONE_COLOURS[3][i : i + 2], 16) for i in (1, 3, 5)]
    assert np.sum((pixels == red).all(axis=2)) > 100  # beads; no floor there has this colour
    place = forecast["curve"][len(forecast["curve"]) // 3]
    px, py = ax + (place["x_m"] - 1.5) * scale, ay - (place["y_m"] - 1.5) * scale
    page.mouse.move(px - 2, py)
    page.mouse.move(px, py)
    tip = page.locator(".route-tip")
    tip.wait_for()
    lost = float(tip.locator("[data-lost]").get_attribute("data-lost"))
    near = [at["lost"] for at in forecast["curve"] if abs(at["x_m"] - place["x_m"]) < 0.4]
    assert min(near) <= lost <= max(near)
    assert "lost so far" in tip.inner_text()
    box, stage = tip.bounding_box(), page.locator(".map").bounding_box()
    assert stage["x"] <= box["x"] and box["x"] + box["width"] <= stage["x"] + stage["width"]
    readout = page.locator(".readout")
    if readout.is_visible():
        assert box["y"] >= sum(readout.bounding_box()[k] for k in ("y", "height"))
    assert violations(page) == []
    page.mouse.move(px, py + 60)
    tip.wait_for(state="detached")
    assert page.faults == []
    page.context.close()


@pytest.mark.slow
def test_seconds_of_a_plan_are_seen_but_not_read_out(page):
    shown = page.evaluate(
        """async () => {
            const main = document.querySelector("script[type=module]").src;
            const { saySeconds } = await import(main.replace("main.js", "dom.js"));
            const status = document.body.appendChild(document.createElement("p"));
            const end = saySeconds(status, "Planning");
            await new Promise((resolve) => setTimeout(resolve, 1500));
            end();
            const read = status.cloneNode(true);
            read.querySelectorAll("[aria-hidden=true]").forEach((part) => part.remove());
            return [status.textContent, read.textContent];
        }"""
    )
    assert shown == ["Planning 1 s", "Planning"]


@pytest.mark.slow
def test_a_goal_in_a_wall_is_told_in_a_sentence(page):
    pytest.importorskip("ambinav_planners.registry")
    page.get_by_role("tab", name="Routes").click()
    for name, x, y in (("start", 1.5, 1.5), ("goal", 12.0, 1.5)):
        page.get_by_label(f"{name} x, metres").fill(str(x))
        page.get_by_label(f"{name} y, metres").fill(str(y))
        page.keyboard.press("Tab")
    page.locator(".message.error").wait_for()
    assert "goal" in page.locator(".message.error").inner_text()


@pytest.mark.slow(kept=("dark-390",))
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(chromium, live, width, scheme):
    size = {"width": width, "height": 844}
    page = visit(chromium, live.url, viewport=size, color_scheme=scheme, bypass_csp=True)
    for tab in ("Layers", "Places", "Routes", "Edit", "About"):
        page.get_by_role("tab", name=tab).click()
        assert violations(page) == [], tab
    # Nothing is wider than the screen.
    assert page.evaluate(SIZES) == [width, width]
    page.context.close()


@pytest.mark.slow
def test_a_token_is_taken_from_the_address_and_sent(chromium, plan_map: Path):
    with running(create_app([plan_map], access=Access("s3cret"))) as live:
        page = visit(chromium, f"{live.url}/#token=s3cret")
        assert "s3cret" not in page.url
        assert page.locator("img.floor-tile").first.get_attribute("src").startswith("blob:")
        page.reload()
        page.wait_for_selector(".map[data-shown]")
        page.context.close()
        context = chromium.new_context()
        other = context.new_page()
        other.goto(live.url)
        other.locator("#failure:not([hidden])").wait_for()
        assert "#token=TOKEN" in other.locator("#failure").inner_text()
        context.close()


@pytest.mark.sweep
def test_two_scanners_are_compared_with_a_slider(
    chromium: Any, plan_map: Path, turning: an.AmbiguityMap
) -> None:
    first = an.AmbiguityMap.open(plan_map)
    changed = first.dataset.copy()
    changed["zone"] = changed["zone"].where(changed["zone"] != 0, 2)  # blue becomes orange
    second = an.AmbiguityMap(changed.assign_attrs(environment="other", scanner="another scanner"))
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01), beams=36, aperture=math.tau
    )
    coarse = an.build_map(first.environment, scanner, spacing=0.25)
    coarse = an.AmbiguityMap(coarse.dataset.assign_attrs(environment="coarse"))
    with running(create_app([plan_map, second, turning, coarse])) as live:
        page = visit(chromium, f"{live.url}/?map=map")
        select = page.get_by_label("Compare with")
        # The third map has another floor.
        offered = select.locator("option").all_inner_texts()
        assert offered == ["compare with …", "other", "coarse"]
        select.select_option(label="other")
        page.wait_for_selector(".leaflet-other-pane .leaflet-tile-loaded")
        sides = page.locator(".side").all_inner_texts()
        assert "another scanner" in sides[1] and "another" not in sides[0]
        slider = page.get_by_label("Border between both maps")
        zones = set()
        place = at(page, 1.0, 1.0)
        for key in ("End", "Home"):  # all of the first map, all of the second
            slider.press(key)
            with page.expect_response(lambda answer: "/values?" in answer.url) as answered:
                page.mouse.move(place[0] + 2, place[1])
                page.mouse.move(*place)
            zones.add((key, answered.value.url.split("/maps/")[1].split("/")[0]))
        assert zones == {("End", "map"), ("Home", "other")}
        # A map of other cells lies where it is in metres: both walls stand over each other.
        select.select_option(label="coarse")
        page.wait_for_selector(".floor-picture")
        tile, box = (
            page.locator(name).bounding_box() for name in (".floor-tile", ".floor-picture")
        )
        metre = tile["width"] / 256.5 / first.spacing  # pixels; a tile is a hair wider than 256
        (x0, _, _, y1), (left, _, _, upper) = first.bounds, coarse.bounds
        corner = tile["x"] + (left - x0) * metre, tile["y"] + (y1 - upper) * metre
        assert (box["x"], box["y"]) == pytest.approx(corner, abs=1.5)
        assert box["width"] == pytest.approx(256 * 0.25 * metre, abs=1.5)
        select.select_option(label="compare with …")
        assert page.locator(".divide").count() == 0
        assert page.faults == []
        page.context.close()


@pytest.mark.slow
def test_the_page_is_there_before_its_code_and_counts_the_tiles(chromium: Any, live: Any) -> None:
    context = chromium.new_context()
    context.set_default_timeout(WAIT)
    page = context.new_page()
    held: list[Any] = []
    for pattern in ("**/main.js", "**/tiles/**"):
        page.route(pattern, lambda route: held.append(route))
    page.goto(f"{live.url}/?map=map", wait_until="commit")
    page.get_by_text("Opening the page").wait_for()
    page.locator(".skeleton").wait_for()
    waiting = "document.querySelector('.waiting').innerText"
    tells = rf"() => /Opening the map|\d+ of \d+ tiles/.test({waiting})"
    tiles = 0
    while page.locator(".stage[aria-busy]").count():
        if held:
            route = held.pop(0)
            if "/tiles/" in route.request.url:
                page.wait_for_function(tells)
                tiles += 1
            route.continue_()
        page.wait_for_timeout(100)
    assert tiles > 0
    assert page.locator(".waiting").is_hidden()
    context.close()
