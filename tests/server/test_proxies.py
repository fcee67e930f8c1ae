"""The page and the service behind nginx and Caddy, configured as docs/howto/hosting.md has it."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

import ambinav as an
from ambinav.server.access import Access
from ambinav.server.http.app import create_app
from tests.server.live import Live, running, wait_until
from tests.server.test_page import at, visit
from tests.server.test_page_edits import drag, shown, tool

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "hosting.md"
PREFIX = "/floor"


def block(language: str) -> str:
    """Return the code block of a language in the page."""
    found = re.search(f"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert found is not None
    return found[1]


def nginx(folder: Path, port: int, server: int) -> list[str]:
    """Write nginx's configuration for one port without TLS; return its command."""
    text = re.sub(r".*ssl_certificate.*\n", "", block("nginx"))
    text = text.replace("443 ssl", f"127.0.0.1:{port}").replace(
        "127.0.0.1:8765", f"127.0.0.1:{server}"
    )
    kinds = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    folders = "".join(f"{kind}_temp_path {folder}/{kind};\n" for kind in kinds)
    (folder / "nginx.conf").write_text(
        f"daemon off; pid {folder}/pid; error_log {folder}/error.log;\n"
        f"events {{}}\nhttp {{\naccess_log off;\n{folders}{text}}}\n"
    )
    return ["nginx", "-c", str(folder / "nginx.conf"), "-p", str(folder)]


def caddy(folder: Path, port: int, server: int) -> list[str]:
    """Write Caddy's configuration for one port without TLS; return its command."""
    text = block("caddyfile").replace("maps.example.org", f"http://127.0.0.1:{port}")
    text = text.replace("127.0.0.1:8765", f"127.0.0.1:{server}")
    (folder / "Caddyfile").write_text("{\nadmin off\n}\n" + text)
    return ["caddy", "run", "--config", str(folder / "Caddyfile")]


PROXIES = {"nginx": nginx, "caddy": caddy}


@pytest.fixture(params=PROXIES)
def proxied(
    request: pytest.FixtureRequest, plan_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[str, Live]]:
    """The public address of a server behind a proxy, and the server."""
    if shutil.which(request.param) is None:
        pytest.skip(f"{request.param} is not installed")
    monkeypatch.setenv("HOME", str(tmp_path))
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    url = f"http://127.0.0.1:{port}{PREFIX}"
    first = an.AmbiguityMap.open(plan_map)
    second = an.AmbiguityMap(first.dataset.assign_attrs(environment="other"))
    app = create_app([plan_map, second], access=Access("write", public_url=url))
    with (
        running(app, proxies=["127.0.0.1"]) as live,
        process(PROXIES[request.param](tmp_path, port, live.address[1]), url),
    ):
        yield url, live


@contextmanager
def process(command: list[str], url: str) -> Iterator[None]:
    """Run a proxy until it answers."""
    proxy = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_until(lambda: proxy.poll() is not None or _answers(url))
        assert proxy.poll() is None, command
        yield
    finally:
        proxy.terminate()
        proxy.wait(30)


def _answers(url: str) -> bool:
    try:
        return httpx.get(f"{url}/v1/health").status_code == 200
    except httpx.HTTPError:
        return False


@pytest.mark.slow(kept=("caddy",))
def test_the_service_works_behind_a_proxy(proxied: tuple[str, Live]) -> None:
    url, live = proxied
    headers = {"authorization": "Bearer write"}
    with httpx.Client(headers=headers, timeout=60.0) as http:
        assert http.get(url, follow_redirects=True).url.path == f"{PREFIX}/"
        assert http.get(f"{url}/v1/maps").json()["maps"][0]["id"] == "map"
        origin = url.removesuffix(PREFIX)
        at = {"x": [1.0], "y": [1.0]}
        for sent, status in ((origin, 200), ("https://other.example", 403)):
            answer = http.post(
                f"{url}/v1/maps/map/cost", json=at, headers={**headers, "origin": sent}
            )
            assert answer.status_code == status
        plan = b'{"type": "Polygon", "coordinates": [[[0,0],[9,0],[9,3],[0,3],[0,0]]]}'
        answer = http.post(
            f"{url}/v1/audits",
            files=[("files", ("room.geojson", plan))],
            data={"scanner": "sick-lms200", "spacing": "0.5"},
        )
        assert answer.status_code == 202, answer.text
        place = answer.headers["location"]
        assert place.startswith(f"{PREFIX}/v1/audits/")
        # Events come one by one: the first while the audit runs.
        with http.stream("GET", f"{origin}{place}/events") as stream:
            lines = stream.iter_lines()
            assert next(lines) == "event: progress"
            assert "event: done" in list(lines)
        report = http.get(f"{origin}{place}").json()["report"]
        assert "<html" in http.get(origin + report).text
    (owner,) = {audit.client for audit in live.context.audits._all.values()}
    assert owner == "127.0.0.1"


@pytest.mark.sweep
def test_all_of_the_page_works_behind_a_proxy(chromium: Any, proxied: tuple[str, Live]) -> None:
    url, _ = proxied
    page = visit(chromium, f"{url}/?map=map#token=write")
    try:
        page.get_by_label("Compare with").select_option(label="other")
        page.wait_for_selector(".leaflet-other-pane .leaflet-tile-loaded")
        page.get_by_label("Compare with").select_option(label="compare with …")
        place = at(page, 1.0, 1.0)
        with page.expect_response(lambda answer: "/values?" in answer.url) as answered:
            page.mouse.move(place[0] + 2, place[1])
        assert answered.value.status == 200

        # An edit, by session and events.
        page.get_by_role("tab", name="Edit").click()
        ends = at(page, 5.0, 2.2), at(page, 5.0, 1.2)
        tool(page, "Wall")
        drag(page, *ends)
        edited = shown(page, 1)
        assert edited["before"] != edited["after"]
        page.wait_for_function("() => /session=page-.*/.test(location.search)")
        page.reload()
        page.get_by_role("tab", name="Edit").click()
        assert shown(page, 1) == edited
        page.get_by_role("button", name="Undo").click()
        shown(page, 0)

        page.get_by_role("tab", name="Routes").click()
        start, goal = at(page, 1.5, 1.5), at(page, 10.0, 1.75)
        page.mouse.click(*start)
        page.mouse.click(*goal)
        page.locator(".route-card").nth(1).wait_for()
        page.get_by_role("button", name="Trade-off curve").click()
        page.locator(".chart .dot").first.wait_for()
        page.get_by_role("tab", name="Places").click()
        page.locator(".place-entry").first.click()
        assert all(address.startswith((url, "blob:", "data:")) for address in page.urls)
        assert page.faults == []
    finally:
        page.context.close()
