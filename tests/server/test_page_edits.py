"""Edits in a browser: drawn, dragged, undone, by the keyboard, saved and opened again."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import shapely

import ambinav as an
from ambinav.buildings.obstacle_file import DrawnObstacle, collection, obstacles_of
from ambinav.server.access import Access
from ambinav.server.http.app import create_app
from tests.reports.widths import SIZES
from tests.server.axe import violations
from tests.server.live import running
from tests.server.test_page import at, visit

pytestmark = pytest.mark.slow


@pytest.fixture
def page(chromium: Any, live: Any) -> Iterator[Any]:
    opened = visit(chromium, f"{live.url}/?map=map")
    opened.get_by_role("tab", name="Edit").click()
    yield opened
    opened.context.close()


def tool(page: Any, name: str) -> None:
    page.get_by_role("toolbar").get_by_role("button", name=name).click()


def drag(page: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=4)
    page.mouse.up()


def number(page: Any, name: str) -> Any:
    """A field of the form."""
    return page.locator(f".numbers input[name={name}]")


def shown(page: Any, count: int) -> dict[str, Any]:
    """What the service said of the edit of so many obstacles, when its map is shown."""
    if count == 0:
        page.wait_for_selector(".map[data-version=map]")
        return {}
    page.wait_for_function(
        "count => document.querySelectorAll('.obstacles li').length === count"
        " && !document.querySelector('#panel-edit').hasAttribute('aria-busy')",
        arg=count,
    )
    page.wait_for_selector(".gain")
    gain = page.locator(".gain")
    return {key: float(gain.get_attribute(f"data-{key}")) for key in ("before", "after")}


def test_a_drawn_wall_changes_the_map_and_can_be_undone(page: Any, live: Any) -> None:
    top, bottom = at(page, 5.0, 2.2), at(page, 5.0, 1.2)
    tool(page, "Wall")
    with page.expect_response(lambda answer: "/edits?session=" in answer.url) as answered:
        drag(page, top, bottom)
    found = shown(page, 1)
    asked = json.loads(answered.value.request.post_data)["features"][0]
    assert asked["properties"] == {"kind": "wall", "thickness": 0.1}
    ends = asked["geometry"]["coordinates"]
    assert ends[0] == pytest.approx([5.0, 2.2], abs=0.1)
    assert ends[1] == pytest.approx([5.0, 1.2], abs=0.1)
    answer = answered.value.json()
    assert (found["before"], found["after"]) == pytest.approx(
        (answer["bad_before_m2"], answer["bad_after_m2"])
    )
    page.wait_for_selector(f".map[data-version='{answer['id']}']")
    assert any(f"/{answer['id']}/layers/zone/tiles/" in url for url in page.urls)
    worst = live.get(f"/v1/maps/{answer['id']}/worst")
    page.get_by_role("tab", name="Places").click()
    page.wait_for_function(
        "count => document.querySelectorAll('.place-entry').length === count", arg=len(worst)
    )
    page.get_by_role("tab", name="Edit").click()
    page.get_by_label("Show the original").click()
    page.wait_for_selector(".map[data-version=map]")
    page.get_by_label("Show the original").click()
    page.wait_for_selector(f".map[data-version='{answer['id']}']")
    page.get_by_role("button", name="Undo").click()
    shown(page, 0)
    assert page.locator(".gain").count() == 0
    assert page.faults == []


def test_all_kinds_are_drawn_dragged_and_deleted(page: Any) -> None:
    middle = at(page, 7.0, 1.7)
    one_metre = at(page, 8.0, 1.7)[0] - middle[0]
    tool(page, "Post")
    page.mouse.click(*middle)
    tool(page, "Reflector")
    page.mouse.click(middle[0] + one_metre, middle[1])
    drag(page, (middle[0] + 2 * one_metre, middle[1]), (middle[0] + 3 * one_metre, middle[1]))
    shown(page, 3)
    tool(page, "Panel")
    page.mouse.click(*middle)  # a click is no panel
    assert "Press, pull and let go" in page.locator("#panel-edit .message").inner_text()
    drag(page, (middle[0] - one_metre, middle[1]), (middle[0] - one_metre, middle[1] - 20))
    shown(page, 4)
    texts = page.locator(".obstacle-entry").all_inner_texts()
    assert [re.sub(r"^\d+\s*", "", text).split(",")[0] for text in texts] == [
        "Post", "Reflector", "Reflector", "Panel",
    ]  # fmt: skip
    tool(page, "Move")
    handle = page.locator(".leaflet-marker-icon.obstacle").first.bounding_box()
    start = (handle["x"] + 12, handle["y"] + 12)
    before = page.locator(".obstacle-entry").first.inner_text()
    with page.expect_response(lambda answer: "/edits?session=" in answer.url):
        drag(page, start, (start[0] - one_metre, start[1]))
    shown(page, 4)
    assert page.locator(".obstacle-entry").first.inner_text() != before
    page.get_by_role("button", name="Undo").click()  # a drag is one thing to undo
    shown(page, 4)
    assert page.locator(".obstacle-entry").first.inner_text() == before
    page.locator(".obstacle-entry").nth(3).click()
    corner = page.locator(".corner").first.bounding_box()
    start = (corner["x"] + 12, corner["y"] + 12)
    drag(page, start, (start[0], start[1] - 30))
    shown(page, 4)
    page.locator(".map").focus()
    page.keyboard.press("Delete")
    shown(page, 3)
    page.keyboard.press("Control+z")
    shown(page, 4)
    page.get_by_label("Delete obstacle 2").click()
    shown(page, 3)
    page.get_by_role("button", name="Reset").click()
    shown(page, 0)
    # What each map was drawn on is gone: a page that keeps it is slower with each edit.
    assert page.locator(".leaflet-layer").count() == 1
    assert page.locator("canvas").count() <= 3
    assert page.faults == []


@pytest.mark.sweep
def test_the_keyboard_adds_and_changes_obstacles(page: Any, live: Any) -> None:
    page.get_by_label("Kind of obstacle").select_option(label="Panel")
    for name, value in (("x", 6), ("y", 1.75), ("length", 1), ("angle", 90)):
        number(page, name).fill(str(value))
    with page.expect_response(lambda answer: "/edits?session=" in answer.url) as answered:
        number(page, "angle").press("Enter")
    shown(page, 1)
    asked = json.loads(answered.value.request.post_data)["features"][0]["geometry"]
    assert asked["coordinates"] == [[6, 1.25], [6, 2.25]]
    number(page, "y").fill("1.5")
    with page.expect_response(lambda answer: "/edits?session=" in answer.url) as answered:
        page.get_by_role("button", name="Change obstacle 1").press("Enter")
    shown(page, 1)
    asked = json.loads(answered.value.request.post_data)["features"]
    assert asked[0]["geometry"]["coordinates"] == [[6, 1], [6, 2]]


def test_what_the_service_refuses_is_said(page: Any) -> None:
    page.get_by_label("Kind of obstacle").select_option(label="Post")
    number(page, "x").fill("99")
    number(page, "y").fill("1")
    page.get_by_role("button", name="Add").click()
    message = page.locator("#panel-edit .message.error")
    message.wait_for()
    assert "outside of the map" in message.inner_text()


def test_files_are_saved_and_opened(page: Any, tmp_path: Path) -> None:
    drawn = (
        DrawnObstacle("post", ((7.0, 1.6),), radius=0.2),
        DrawnObstacle("wall", ((5.0, 1.1), (5.0, 1.6), (5.2, 1.6)), thickness=0.05),
    )
    path = tmp_path / "obstacles.geojson"
    path.write_text(json.dumps(collection(drawn)))
    page.get_by_label("File of obstacles").set_input_files(path)
    shown(page, 2)
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the obstacles").click()
    saved.value.save_as(tmp_path / "saved.geojson")
    assert obstacles_of(json.loads((tmp_path / "saved.geojson").read_text()), "saved") == drawn
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the building").click()
    assert saved.value.suggested_filename == "building.geojson"
    path.write_text("no JSON")
    page.get_by_label("File of obstacles").set_input_files(path)
    page.locator("#panel-edit .message.error").wait_for()


@pytest.mark.sweep
def test_a_map_that_was_forgotten_comes_back(page: Any, live: Any) -> None:
    page.get_by_label("Kind of obstacle").select_option(label="Post")
    number(page, "x").fill("7.5")
    number(page, "y").fill("1.7")
    page.get_by_role("button", name="Add").click()
    shown(page, 1)
    page.wait_for_selector(".map[data-version*='--']")
    id = page.locator(".map").get_attribute("data-version")
    live.context.forget(live.context.maps.get(id))
    page.get_by_role("tab", name="Layers").click()
    page.get_by_text("Ambiguity level").first.click()
    page.wait_for_selector(".map[data-shown=level]")
    assert page.locator(".map").get_attribute("data-version") == id
    assert id in [one.name for one in live.context.maps.edited]


@pytest.mark.sweep
def test_another_map_has_no_obstacles_of_the_first(page: Any) -> None:
    number(page, "x").fill("7.5")
    number(page, "y").fill("1.7")
    page.get_by_role("button", name="Add").click()
    page.get_by_label("Map", exact=True).select_option("narrow-room")  # before it is worked out
    page.wait_for_selector(".map[data-version=narrow-room]")
    page.wait_for_selector(".stage:not([aria-busy])")
    shown_version = "() => document.querySelector('.map').dataset.version"
    page.wait_for_timeout(1500)
    assert page.evaluate(shown_version) == "narrow-room"
    assert page.locator(".obstacles li").count() == 0
    assert page.get_by_role("button", name="Undo").is_disabled()
    assert page.faults == []


@pytest.mark.sweep
@pytest.mark.parametrize("width", [1280, 768, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(chromium: Any, live: Any, width: int, scheme: str) -> None:
    size = {"width": width, "height": 844}
    page = visit(chromium, live.url, viewport=size, color_scheme=scheme, bypass_csp=True)
    page.get_by_role("tab", name="Edit").click()
    assert violations(page) == []
    number(page, "x").fill("7.0")
    number(page, "y").fill("1.7")
    page.get_by_role("button", name="Add").click()
    shown(page, 1)
    assert violations(page) == []
    assert page.evaluate(SIZES) == [width, width]
    page.context.close()


def entries(page: Any) -> list[str]:
    return [str(text) for text in page.locator(".obstacle-entry").all_inner_texts()]


@pytest.mark.sweep
def test_an_obstacle_is_dragged_by_itself_and_all_is_undone_by_the_keyboard(page: Any) -> None:
    middle = at(page, 7.0, 1.7)
    one_metre = at(page, 8.0, 1.7)[0] - middle[0]
    tool(page, "Wall")
    drag(page, middle, (middle[0] + one_metre, middle[1]))
    shown(page, 1)
    (before,) = entries(page)
    tool(page, "Move")
    start = (middle[0] + 0.25 * one_metre, middle[1])
    page.mouse.click(*start)  # a click picks it, and pins no point of the floor
    assert page.locator(".obstacle-entry").get_attribute("aria-pressed") == "true"
    assert page.locator(".readout .close").count() == 0
    centre = page.evaluate("() => document.querySelector('.leaflet-map-pane').style.transform")
    drag(page, start, (start[0], start[1] + 0.3 * one_metre))
    shown(page, 1)
    (after,) = entries(page)
    assert after != before
    # The floor did not move with it.
    assert centre == page.evaluate(
        "() => document.querySelector('.leaflet-map-pane').style.transform"
    )
    page.keyboard.press("Control+z")
    assert entries(page) == [before]
    page.keyboard.press("Control+z")
    shown(page, 0)
    page.keyboard.press("Control+y")
    page.keyboard.press("Control+Shift+Z")
    shown(page, 1)
    assert entries(page) == [after]
    page.get_by_text("Changes", exact=True).click()
    steps = page.locator(".steps button")
    assert steps.all_inner_texts() == ["Move wall 1", "Add wall 1"]
    steps.nth(1).click()
    shown(page, 0)
    assert page.faults == []


@pytest.mark.sweep
def test_an_address_brings_back_the_view_and_the_edits_after_a_restart(
    chromium: Any, plan_map: Path, tmp_path: Path
) -> None:
    with running(create_app([plan_map], state=tmp_path)) as live:
        page, port = visit(chromium, live.url), live.address[1]
        page.context.set_default_timeout(120_000)  # the process for edits starts twice
        page.get_by_role("tab", name="Edit").click()
        place = at(page, 7.0, 1.7)
        tool(page, "Post")
        page.mouse.click(*place)
        shown(page, 1)
        page.keyboard.press("Escape")
        page.get_by_role("button", name="Zoom in").click()
        page.wait_for_function("() => /session=page-.*/.test(location.search)")
        page.wait_for_function("() => /at=/.test(location.search)")
        drawn = entries(page)
    # The server is gone: the page says so, and goes on when it is back.
    page.get_by_role("tab", name="Places").click()
    page.mouse.move(*at_middle(page, 0))
    page.mouse.move(*at_middle(page, 40))
    page.wait_for_selector("#connection:not([hidden])")
    with running(create_app([plan_map], state=tmp_path), port=port) as live:
        page.wait_for_selector("#connection", state="hidden")
        page.mouse.move(*at_middle(page, 80))
        page.locator(".readout[data-x]").wait_for()
        other = visit(chromium, page.url)
        other.context.set_default_timeout(120_000)
        other.get_by_role("tab", name="Edit").click()
        shown(other, 1)
        assert entries(other) == drawn
        assert re.findall("at=[^&]*", other.url) == re.findall("at=[^&]*", page.url)
        assert other.faults == []
        for each in (page, other):
            each.context.close()


@pytest.mark.sweep
def test_two_people_edit_one_session(chromium: Any, plan_map: Path) -> None:
    with running(create_app([plan_map])) as live:
        pages = [visit(chromium, f"{live.url}/?map=map&session=shared") for _ in range(2)]
        for page in pages:
            page.context.set_default_timeout(60_000)
            page.get_by_role("tab", name="Edit").click()
        one, two = pages
        first, second, third = at(one, 7.0, 1.7), at(one, 4.0, 1.7), at(two, 9.0, 1.7)
        for page in pages:
            tool(page, "Post")
        one.mouse.click(*first)
        shown(one, 1)
        shown(two, 1)  # without being asked for
        assert "Somebody else has changed" in two.locator("#panel-edit .message").inner_text()
        assert entries(two) == entries(one)
        # Both at once: one of them is first, and both show the same in the end.
        one.mouse.click(*second)
        two.mouse.click(*third)
        for page in pages:
            page.wait_for_function("() => !document.querySelector('#panel-edit[aria-busy]')")
        end = time.monotonic() + 30.0
        while entries(one) != entries(two):
            assert time.monotonic() < end, [entries(page) for page in pages]
            one.wait_for_timeout(200)
        assert len(entries(one)) == 2
        late = next(
            page
            for page in pages
            if "Somebody else" in page.locator("#panel-edit .message").inner_text()
        )
        shared = entries(late)
        late.get_by_role("button", name="Undo").click()  # brings back what the other one outran
        shown(late, 2)
        assert entries(late) != shared
        one.get_by_role("button", name="Reset").click()
        for page in pages:
            page.wait_for_selector(".map[data-version=map]")
            assert [fault for fault in page.faults if "(Conflict)" not in fault] == []
            page.context.close()


@pytest.mark.sweep
def test_who_may_only_read_sees_the_edits_of_a_session(chromium: Any, plan_map: Path) -> None:
    with running(create_app([plan_map], access=Access("write", "read"))) as live:
        place = f"{live.url}/?map=map&session=shared"
        writer, reader = (visit(chromium, f"{place}#token={name}") for name in ("write", "read"))
        for page in (writer, reader):
            page.context.set_default_timeout(60_000)
            page.get_by_role("tab", name="Edit").click()
        middle = at(writer, 7.0, 1.7)
        tool(writer, "Post")
        writer.mouse.click(*middle)
        shown(writer, 1)
        edited = writer.locator(".map").get_attribute("data-version")
        reader.wait_for_selector(f".map[data-version='{edited}']")
        assert entries(reader) == entries(writer)
        assert "for reading only" in reader.locator("#panel-edit .message").inner_text()
        again = visit(chromium, f"{place}#token=read")
        again.wait_for_selector(f".map[data-version='{edited}']")
        for page in (writer, reader, again):
            page.context.close()


def at_middle(page: Any, right: float) -> tuple[float, float]:
    """Pixels so far to the right of the middle of the map."""
    box = page.locator(".map").bounding_box()
    return box["x"] + 0.5 * box["width"] + right, box["y"] + 0.5 * box["height"]


def test_in_space_obstacles_have_heights(chromium: Any) -> None:
    """By numbers, moved with the pointer, saved and opened again; in a plan nobody is asked."""
    plan = an.environment_from_shapes([shapely.box(0, 0, 8, 6)], name="hall")
    scanner = an.RangeScanner.from_preset("turtlebot3-lds").raised(0.2)
    building = plan.in_space(an.extruded(plan, 2.5))
    maps = [an.build_map(env, scanner, 0.25, store=False) for env in (building, plan)]
    maps[1].dataset.attrs["environment"] = "flat"
    with running(create_app(maps)) as live:
        page = visit(chromium, f"{live.url}/?map=hall")
        page.get_by_role("tab", name="Edit").click()
        page.locator(".numbers select").select_option(label="Post")
        for name, value in (("x", "4"), ("y", "3"), ("top", "1.2")):
            number(page, name).fill(value)
        page.get_by_role("button", name="Add").click()
        shown(page, 1)
        entry = page.locator(".obstacle-entry").inner_text().replace("\xa0", " ")
        assert "0.00 m to 1.20 m above the floor" in entry
        tool(page, "Move")
        with page.expect_response(lambda answer: "/edits?session=" in answer.url) as answered:
            drag(page, at(page, 4.0, 3.0), at(page, 5.0, 3.0))
        shown(page, 1)
        properties = json.loads(answered.value.request.post_data)["features"][0]["properties"]
        assert properties == {"kind": "post", "radius": 0.15, "bottom": 0, "top": 1.2}
        assert page.faults == []
        page.context.close()
        flat = visit(chromium, f"{live.url}/?map=flat")
        flat.get_by_role("tab", name="Edit").click()
        assert number(flat, "x").is_visible()
        assert not number(flat, "top").is_visible()
        flat.context.close()
