"""Names of the server, origins of requests, and the rights of tokens."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

import ambinav as an
from ambinav.server.access import Access
from ambinav.server.problems import MOST_DETAIL
from tests.server.live import Live

EDIT = "/v1/maps/environment/edits"
EMPTY = {"type": "FeatureCollection", "features": []}


@pytest.mark.parametrize(
    ("access", "host", "may"),
    [
        (Access(), "127.0.0.1:8765", True),
        (Access(), "LOCALHOST", True),
        (Access(), "[::1]:80", True),
        (Access(), "localhost.", True),
        (Access(), "localhost.evil.example", False),
        (Access(), "", False),
        (Access(), "[::1", False),
        (Access(), "localhost:99999999", False),
        (Access(), "10.1.2.3:8765", False),
        (Access(any_address=True), "10.1.2.3:8765", True),
        (Access(any_address=True), "[fe80::1]", True),
        (Access(any_address=True), "rebound.example", False),
        (Access(any_address=True), "10.1.2.3.evil.example", False),
        (Access(hosts=("localhost", "maps")), "maps:8765", True),
        (Access(public_url="https://maps.example.org/floor"), "maps.example.org", True),
        (Access(public_url="https://maps.example.org/floor"), "example.org", False),
    ],
)
def test_only_names_of_the_server_are_answered(access: Access, host: str, may: bool) -> None:
    refusal = access.refusal("GET", "/v1/maps", {b"host": host.encode()})
    assert (refusal is None) == may
    assert access.refusal("GET", "/v1/ready", {b"host": host.encode()}) is None  # of a probe


@pytest.mark.parametrize(
    ("origin", "may"),
    [
        ("https://maps.example.org", True),
        ("http://maps.example.org", False),  # not as the public address has it
        ("http://127.0.0.1:8765", True),
        ("https://other.example.org", False),
        ("null", False),
        ("https://maps.example.org.evil.example", False),
    ],
)
def test_a_page_behind_a_proxy_may_ask_and_others_not(origin: str, may: bool) -> None:
    access = Access(public_url="https://maps.example.org/floor")
    headers = {b"host": b"127.0.0.1:8765", b"origin": origin.encode()}  # as nginx sends it
    assert (access.refusal("POST", EDIT, headers) is None) == may


@pytest.mark.slow
def test_a_token_for_reading_edits_nothing(serve: Any, corridor: an.AmbiguityMap) -> None:
    live: Live = serve([corridor], access=Access("write", "read"))

    def status(method: str, path: str, token: str, **content: Any) -> int:
        headers = {"authorization": f"Bearer {token}"}
        return live.http.request(method, path, headers=headers, **content).status_code

    paths = [EDIT, "/v1/audits", "/v1/maps/environment/sessions/a/undo"]
    assert [status("POST", path, "read", json=EMPTY) for path in paths] == [403] * 3
    assert status("DELETE", "/v1/audits/x", "read") == 403
    assert [status("POST", path, "other", json=EMPTY) for path in paths] == [401] * 3
    assert status("DELETE", "/v1/audits/x", "write") == 404
    at = {"x": [1.0], "y": [1.0]}
    for token in ("read", "write"):
        assert status("GET", "/v1/maps", token) == 200
        assert status("GET", "/v1/metrics", token) == 200
        assert status("POST", "/v1/maps/environment/cost", token, json=at) == 200
    assert an.Client(live.url, token="read").cost(1.0, 1.0) >= 1.0


def test_with_a_token_for_reading_alone_nobody_edits() -> None:
    refusal = Access(read_token="read").refusal(
        "POST", EDIT, {b"host": b"localhost", b"authorization": b"Bearer read"}
    )
    assert refusal is not None and refusal.status == 403 and "takes no edits" in refusal.detail


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"public_url": "maps.example.org"},
            "--public-url: 'maps.example.org' is not the address of a page",
        ),
        ({"public_url": "ftp://maps.example.org"}, "--public-url"),
        ({"public_url": "https://maps.example.org/?a=1"}, "--public-url"),
        ({"public_url": "https://[::1"}, "--public-url"),
        ({"hosts": ("maps:8765",)}, "--allowed-host: 'maps:8765' is not a host name"),
        ({"hosts": ("https://maps",)}, "--allowed-host"),
        ({"hosts": ("",)}, "--allowed-host"),
        ({"token": "one", "read_token": "one"}, "--read-token: it is the same as --token"),
    ],
)
def test_rights_that_cannot_be_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(an.InputError, match=message):
        Access(**options)


def test_an_error_is_short_whatever_was_sent(live: Live) -> None:
    long = "\u0001" * 4000
    answers = [
        live.http.get("/v1/maps/" + "a" * 20_000),
        live.http.get(f"/v1/maps/map/layers/{'%01' * 6000}"),
        live.http.post("/v1/maps/map/cost", json={"x": [1], "y": [1], "layer": long}),
        live.http.post("/v1/maps/map/cost", json={"x": [1], "y": [1], long: 1}),
        httpx.get(f"{live.url}/v1/maps", headers={"host": "x" * 30_000}),
    ]
    for answer in answers:
        assert 400 <= answer.status_code < 500, answer.text[:200]
        assert answer.json()["detail"] and len(answer.content) < 2000 < MOST_DETAIL + 600
