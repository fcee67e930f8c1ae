"""What comes between in a browser: an undo in a drag, an edit while routes are planned."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.server.test_page import at, visit
from tests.server.test_page_edits import shown, tool

pytestmark = pytest.mark.slow


@pytest.fixture
def page(chromium: Any, live: Any) -> Iterator[Any]:
    opened = visit(chromium, f"{live.url}/?map=map")
    opened.get_by_role("tab", name="Edit").click()
    yield opened
    opened.context.close()


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
