"""What the service refuses: tokens, other sites, bodies that are too large or too slow."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import Any

import httpx
import pytest

import ambinav as an
from ambinav.server.access import Access
from ambinav.server.limits import Limits
from tests.server.live import Live, wait_until

COST = "/v1/maps/environment/cost"


@pytest.fixture
def guarded(serve: Any, corridor: an.AmbiguityMap) -> Live:
    found: Live = serve(
        [corridor], access=Access("s3cret"), limits=Limits(body=1000, upload=5000, body_seconds=0.3)
    )
    found.http.headers["authorization"] = "Bearer s3cret"
    return found


@pytest.mark.slow
def test_without_the_token_nothing_is_told_of_maps(guarded: Live) -> None:
    for headers in ({}, {"authorization": "Bearer other"}, {"authorization": "Basic s3cret"}):
        answer = httpx.get(f"{guarded.url}/v1/maps", headers=headers)
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == "Bearer"
        assert "Authorization: Bearer" in answer.json()["detail"]
        for path in ("/v1/maps/environment/map.npz", "/v1/audits/x", "/v1/no-such-path"):
            assert httpx.get(guarded.url + path, headers=headers).status_code == 401
        for path in ("/v1/health", "/openapi.json", "/docs"):
            assert httpx.get(guarded.url + path, headers=headers).status_code == 200
    assert guarded.http.get("/v1/maps").status_code == 200
    assert guarded.get("/openapi.json")["security"] == [{"token": []}]
    assert an.Client(guarded.url, token="s3cret").id == "environment"
    with pytest.raises(an.InputError, match="token"):
        an.Client(guarded.url, token="other")


def test_pages_of_other_sites_are_refused(guarded: Live) -> None:
    own = guarded.url
    assert guarded.http.get("/v1/maps", headers={"origin": own}).status_code == 200
    for origin in ("https://elsewhere.example", "null", "http://[bad"):
        assert guarded.http.get("/v1/maps", headers={"origin": origin}).status_code == 403
    assert guarded.http.get("/v1/maps", headers={"host": "evil.example:80"}).status_code == 403
    assert guarded.http.get("/v1/maps", headers={"host": "localhost:9"}).status_code == 200


@pytest.mark.parametrize("declared", [True, False])
def test_a_body_that_is_too_large_is_refused(guarded: Live, declared: bool) -> None:
    body = b"0" * 1001
    content: Any = body if declared else iter([body[:600], body[600:]])  # chunks tell no length
    answer = guarded.http.post(COST, content=content)
    assert answer.status_code == 413
    assert answer.json()["detail"].startswith("The body is larger than 1000 bytes")


def test_a_body_that_does_not_come_is_not_waited_for(guarded: Live) -> None:
    with socket.create_connection(guarded.address, timeout=60.0) as line:
        line.sendall(
            f"POST {COST} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer s3cret\r\n"
            "Content-Type: application/json\r\nContent-Length: 500\r\n\r\n{".encode()
        )
        assert line.recv(100).startswith(b"HTTP/1.1 408 ")
    assert guarded.http.get("/v1/maps").status_code == 200


def test_a_connection_that_ends_within_a_body_harms_nobody(
    guarded: Live, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.create_connection(guarded.address, timeout=60.0) as line:
        line.sendall(
            f"POST {COST} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer s3cret\r\n"
            "Content-Type: application/json\r\nContent-Length: 500\r\n\r\n{".encode()
        )
    assert guarded.http.get("/v1/maps").status_code == 200
    assert not caplog.records


@pytest.mark.parametrize("line", [b"X: " + b"a" * 300_000, b"X: a\r\n" * 60_000])
def test_a_head_that_does_not_end_is_refused(guarded: Live, line: bytes) -> None:
    with socket.create_connection(guarded.address, timeout=60.0) as connection:
        try:
            connection.sendall(b"GET /v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n" + line)
            answer = connection.recv(100)
        except ConnectionError:  # it was closed before all was sent
            answer = b"HTTP/1.1 400 "
        assert answer.startswith(b"HTTP/1.1 400 ")
    long = {"x-long": "a" * 30_000}  # of each request on a connection
    for _ in range(4):
        assert guarded.http.get("/v1/health", headers=long).status_code == 200


@pytest.mark.slow
def test_a_head_is_answered_as_a_get_without_its_body(guarded: Live) -> None:
    for path in ("/v1/maps", "/v1/maps/environment/layers/level/tiles/0/0/0.png", "/"):
        head, get = guarded.http.head(path), guarded.http.get(path)
        assert (head.status_code, head.content) == (200, b"")
        for name in ("content-length", "content-type"):
            assert head.headers[name] == get.headers[name]
    assert guarded.http.head("/v1/maps/none").status_code == 404


def test_what_no_route_takes_is_a_problem_with_a_remedy(guarded: Live) -> None:
    none, other = guarded.http.get("/v1/none"), guarded.http.delete("/v1/maps")
    assert none.status_code == 404 and "/docs" in none.json()["detail"]
    assert other.status_code == 405 and other.headers["allow"] == "GET"


def test_what_is_no_http_is_refused(guarded: Live) -> None:
    with socket.create_connection(guarded.address, timeout=60.0) as line:
        line.sendall(b"\x00\x01\x02 no request\r\n\r\n")
        assert line.recv(100).startswith(b"HTTP/1.1 400 ")


def test_many_idle_connections_hold_nobody_up(guarded: Live) -> None:
    lines = [socket.create_connection(guarded.address, timeout=60.0) for _ in range(100)]
    try:
        assert guarded.http.get("/v1/maps").status_code == 200
    finally:
        for line in lines:
            line.close()


def test_a_plan_in_too_much_json_is_refused(serve: Any, corridor: an.AmbiguityMap) -> None:
    live = serve([corridor], limits=Limits(json=100))
    body = {"start": [1, 1], "goal": [2, 2], "weights": [1.0] * 100}
    answer = live.http.post("/v1/maps/environment/pareto", json=body)
    assert answer.status_code == 413
    assert answer.json()["detail"].startswith("The body is larger than 100 bytes")


def test_connections_that_send_no_request_are_closed(serve: Any, corridor: an.AmbiguityMap) -> None:
    live = serve([corridor], limits=Limits(head_seconds=0.4, connections=20))
    with contextlib.ExitStack() as stack:
        lines = [
            stack.enter_context(socket.create_connection(live.address, timeout=60.0))
            for _ in range(19)
        ]
        for line in lines[:9]:
            line.sendall(b"GET /v1/health HT")  # half a head
        lines[-1].sendall(b"GET /v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert lines[-1].recv(1000).startswith(b"HTTP/1.1 200 ")
        lines[-1].sendall(b"GET")  # of the next request
        assert [line.recv(10) for line in lines] == [b""] * 19
    assert live.http.get("/v1/maps").status_code == 200


def test_a_client_has_so_many_connections_and_no_more(
    serve: Any, corridor: an.AmbiguityMap
) -> None:
    live = serve([corridor], limits=Limits(connections=5))
    lines = [socket.create_connection(live.address, timeout=60.0) for _ in range(5)]
    with socket.create_connection(live.address, timeout=60.0) as sixth:
        assert sixth.recv(1000).startswith(b"HTTP/1.1 503 ")
    for line in lines:
        line.close()
    wait_until(lambda: _answers(live))


def _answers(live: Live) -> bool:
    try:
        return live.http.get("/v1/health").status_code == 200
    except httpx.HTTPError:
        return False


def test_who_does_not_read_an_answer_is_not_waited_for(
    serve: Any, corridor: an.AmbiguityMap
) -> None:
    live = serve([corridor], limits=Limits(write_seconds=0.3))
    with socket.socket() as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        line.connect(live.address)
        request = b"GET /v1/maps/environment HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
        for _ in range(400):  # pipelined: more than the buffers of both ends hold
            line.sendall(request)
        wait_until(lambda: _open_requests(live) <= 1)
    assert live.http.get("/v1/maps").status_code == 200


def test_who_goes_away_within_many_answers_is_no_error(
    serve: Any, corridor: an.AmbiguityMap, caplog: pytest.LogCaptureFixture
) -> None:
    live = serve([corridor])
    with socket.socket() as line:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        line.connect(live.address)
        for _ in range(400):
            line.sendall(b"GET /v1/maps/environment/map.npz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        wait_until(lambda: _open_requests(live) >= 1)
    wait_until(lambda: _open_requests(live) == 0)
    assert [record.getMessage() for record in caplog.records] == []


def _open_requests(live: Live) -> float:
    return float(live.context.metrics.open._value.get())


@pytest.mark.sweep
def test_a_client_has_so_many_jobs_and_no_more(serve: Any, corridor: an.AmbiguityMap) -> None:
    live = serve([corridor], limits=Limits(client_jobs=1, plans=1))
    ends = {"start": [1, 1], "goal": [2, 1], "planner": "rrtstar", "time_s": 20}
    with httpx.Client(base_url=live.url) as other:
        slow = threading.Thread(target=_give_up, args=(other, ends))
        slow.start()
        wait_until(lambda: _open_requests(live) >= 1)
        answer = live.http.post("/v1/maps/environment/plan", json=ends)
        slow.join()
    assert answer.status_code == 429
    assert answer.json()["detail"] == "127.0.0.1 has 1 jobs here already; wait for one of them."
    assert answer.headers["retry-after"] == "5"


def _give_up(http: httpx.Client, ends: dict[str, Any]) -> None:
    with contextlib.suppress(httpx.TimeoutException):
        http.post("/v1/maps/environment/plan", json=ends, timeout=3.0)
