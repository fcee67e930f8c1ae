"""What comes between in a browser: an undo in a drag, an edit while routes are planned."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from ambinav.server.access import Access
from ambinav.server.http.app import create_app
from tests.server.live import running
from tests.server.test_page import WAIT, at, visit
from tests.server.test_page_edits import number, shown, tool

pytestmark = pytest.mark.slow


@pytest.fixture
def page(chromium: Any, live: Any) -> Iterator[Any]:
    opened = visit(chromium, f"{live.url}/?map=map")
    opened.get_by_role("tab", name="Edit").click()
    yield opened
    opened.context.close()


@pytest.mark.sweep
def test_an_undo_during_a_drag_loses_no_step(page: Any) -> None:
    first, second, end = at(page, 3.0, 1.6), at(page, 7.0, 1.6), at(page, 3.0, 2.0)
    tool(page, "Post")
    for count, place in enumerate((first, second), start=1):
        page.mouse.click(*place)
        shown(page, count)
    tool(page, "Move")
    page.mouse.move(*first)
    page.mouse.down()
    page.mouse.move(*end, steps=4)
    page.keyboard.press("Control+z")
    page.mouse.up()
    shown(page, 2)
    page.get_by_role("button", name="Undo").click()
    shown(page, 2)
    page.get_by_role("button", name="Undo").click()
    shown(page, 1)


@pytest.mark.sweep
def test_routes_are_planned_again_though_an_edit_comes_between(page: Any) -> None:
    """Both weights are in the list of the last version, whichever was planned meanwhile."""
    pytest.importorskip("ambinav_planners.registry")
    start, goal, posts = at(page, 1.5, 1.5), at(page, 10.0, 1.75), [at(page, 3.0, 1.9)]
    posts.append(at(page, 7.0, 1.9))
    page.get_by_role("tab", name="Routes").click()
    page.mouse.click(*start)
    page.mouse.click(*goal)
    cards = page.locator(".route-card")
    cards.nth(1).wait_for()

    def late(route: Any) -> None:
        time.sleep(0.3)
        route.continue_()

    page.route("**/plan", late)
    page.get_by_role("tab", name="Edit").click()
    tool(page, "Post")
    for count, place in enumerate(posts, start=1):
        page.mouse.click(*place)
        shown(page, count)
    page.get_by_role("tab", name="Routes").click()
    page.wait_for_timeout(500)  # by then the routes of the last version are being planned
    page.wait_for_function(
        "() => document.querySelectorAll('.route-card').length === 2"
        " && !document.querySelector('#panel-routes').hasAttribute('aria-busy')"
    )
    texts = cards.all_inner_texts()
    assert "Shortest" in texts[0] and "Weight 5" in texts[1]


@pytest.mark.sweep
def test_a_map_that_is_chosen_again_has_its_obstacles(page: Any) -> None:
    """And so have others who share the session."""
    first, second = at(page, 3.0, 1.6), at(page, 7.0, 1.6)
    tool(page, "Post")
    page.mouse.click(*first)
    shown(page, 1)
    page.wait_for_function("() => location.search.includes('session=')")
    session = page.evaluate("() => new URLSearchParams(location.search).get('session')")
    maps = page.get_by_label("Map", exact=True)
    maps.select_option("narrow-room")
    page.wait_for_function("() => !location.search.includes('session=')")
    maps.select_option("map")
    shown(page, 1)
    page.wait_for_function(f"() => location.search.includes('session={session}')")
    page.get_by_role("tab", name="Edit").click()
    tool(page, "Post")
    page.mouse.click(*second)
    shown(page, 2)


@pytest.mark.sweep
def test_the_form_asks_for_a_wall_with_a_length_after_a_post(page: Any) -> None:
    place = at(page, 3.0, 1.6)
    tool(page, "Post")
    page.mouse.click(*place)
    shown(page, 1)
    page.get_by_label("Kind of obstacle").select_option(label="Wall")
    assert float(number(page, "length").input_value()) > 0.0


def test_a_heading_of_the_address_is_that_of_the_controls(chromium: Any, live: Any) -> None:
    page = visit(chromium, f"{live.url}/?map=narrow-room&heading=1.5707963")
    assert page.locator("input[name=heading][value=one]").is_checked()
    assert page.locator("#panel-layers input[type=range]").input_value() == "90"
    assert page.locator("#panel-layers output").inner_text() == "90°"
    page.context.close()


@pytest.mark.sweep
def test_beside_the_map_nothing_is_asked(page: Any) -> None:
    problems: list[str] = []
    page.on("pageerror", lambda problem: problems.append(str(problem)))
    for key in ("ArrowRight", "ArrowUp"):
        page.locator("#map, .leaflet-container").first.focus()
        for _ in range(25):
            page.keyboard.press(key)
            page.wait_for_timeout(30)
        page.wait_for_timeout(400)
    assert problems == []


def test_tokens_of_the_address(chromium: Any, plan_map: Any) -> None:
    """With a plus, added to the address of the open page, wrong, and with letters that none has."""
    with running(create_app([plan_map], access=Access("a+b/c="))) as live:
        page = chromium.new_context().new_page()
        page.set_default_timeout(WAIT)
        page.goto(live.url)
        page.get_by_text("This service asks for a token.").wait_for()
        page.evaluate("() => (location.hash = '#token=東')")
        page.wait_for_function("() => location.hash === ''")
        page.get_by_text("This service asks for a token.").wait_for()
        page.evaluate("() => (location.hash = '#token=wrong')")
        page.get_by_text("The token is not that of this service.").wait_for()
        page.evaluate("() => (location.hash = '#token=a+b/c=')")
        page.locator(".leaflet-container").wait_for()
        page.context.close()
