"""`ambinav.Client` stands where `AmbiguityService` does, for planners and environments."""

from __future__ import annotations

import json
import math
import pickle
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import ambinav as an
from ambinav.runtime.errors import InputError
from ambinav.server import client as client_module
from ambinav.server.http.app import create_app
from ambinav_planners import RoutePlanner, pareto
from tests.server.live import Live, running
from tests.server.test_state import post_at


@pytest.fixture
def client(live: Live) -> Iterator[an.Client]:
    with an.Client(live.url, "map") as one:
        yield one


def test_answers_are_the_services_bit_for_bit(
    live: Live, turning: an.AmbiguityMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "PIECE", 30)
    service = an.AmbiguityService(turning, "major", 3.0)
    with an.Client(live.url, "narrow-room", layer="major", weight=3.0) as client:
        assert client.has_headings
        rng = np.random.default_rng(5)
        x, y = rng.uniform(-1, 5, (2, 8, 9))
        theta = rng.uniform(-4, 4, 9)
        np.testing.assert_array_equal(client.cost(x, y, theta), service.cost(x, y, theta))
        np.testing.assert_array_equal(
            client.reward(x, y, 1.0, y, theta, 0.0), service.reward(x, y, 1.0, y, theta, 0.0)
        )
        np.testing.assert_array_equal(
            client.level(x, y, theta), turning.sample("major", x, y, theta)
        )
        one = client.cost(1.0, 1.0, 0.5)
        assert isinstance(one, float) and one == service.cost(1.0, 1.0, 0.5)
        assert client.cost(-9.0, 0.0, 0.0) == math.inf
        assert np.asarray(client.cost([], [], [])).shape == (0,)
        assert "map" not in vars(client), "none of these needs the map's arrays"


@pytest.mark.slow
def test_a_client_opens_an_edited_map(live: Live) -> None:
    """It is not listed, but has an id like any other."""
    made = live.http.post("/v1/maps/map/edits", json=post_at(1.0)).json()
    with an.Client(live.url, made["id"]) as client, an.Client(live.url, "map") as original:
        assert client.id == made["id"] and client.info["digest"] != original.info["digest"]
        assert client.cost(2.0, 1.0) > 0.0
    with pytest.raises(InputError, match="has no map 'map--0123456789abcdef'; it serves "):
        an.Client(live.url, "map--0123456789abcdef")


def test_what_needs_arrays_fetches_them_once(
    client: an.Client, corridor: an.AmbiguityMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = an.AmbiguityService(corridor)
    assert client.map.dataset.identical(corridor.dataset)
    monkeypatch.setattr(client, "_http", None)
    np.testing.assert_array_equal(client.density.values, service.density.values)
    np.testing.assert_array_equal(
        client.gradient([1.0, 5.0], 2.0), service.gradient([1.0, 5.0], 2.0)
    )
    assert client.motion_cost(1, 1, 8, 2) == service.motion_cost(1, 1, 8, 2)
    other = client.with_weight(9.0)
    np.testing.assert_array_equal(other.density.values, service.with_weight(9.0).density.values)
    assert (client.weight, other.weight) == (5.0, 9.0)
    assert client.density.values.max() < other.density.values.max()


@pytest.mark.slow
def test_a_planner_finds_the_same_routes_with_either(
    client: an.Client, corridor: an.AmbiguityMap
) -> None:
    ends = (1.0, 1.0), (10.0, 2.0)
    mine, theirs = RoutePlanner(client), RoutePlanner(an.AmbiguityService(corridor))
    a, b = (robot.plan(*ends, weight=4.0) for robot in (mine, theirs))
    np.testing.assert_array_equal(a.poses, b.poses)
    assert (a.cost, a.exposure) == (b.cost, b.exposure)
    fronts = [pareto(robot, *ends, weights=(0, 5)).points for robot in (mine, theirs)]
    for one, other in zip(*fronts, strict=True):
        np.testing.assert_array_equal(one.route.poses, other.route.poses)


@pytest.mark.sweep
def test_an_ompl_planner_takes_it_too(client: an.Client) -> None:
    pytest.importorskip("ompl")
    route = RoutePlanner(client).plan(
        (1.0, 1.0), (10.0, 2.0), planner_name="rrtstar", seconds=20.0, iterations=200, seed=1
    )
    assert route.cost >= route.length > 9.0


class Walk(gym.Env[np.ndarray, int]):
    """A point that walks on a floor and is rewarded by a service, whichever it is."""

    action_space = gym.spaces.Discrete(4)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (3,), np.float64)

    def __init__(self, service: an.AmbiguityService) -> None:
        self.service = service

    def reset(self, *, seed: int | None = None, options: object = None):  # type: ignore[no-untyped-def, override]
        super().reset(seed=seed)
        self.at = np.array([2.0, 1.7])
        return self._observed(), {}

    def step(self, action: int):  # type: ignore[no-untyped-def, override]
        turn = action * math.pi / 2
        goes = self.at + 0.3 * np.array([math.cos(turn), math.sin(turn)])
        free = math.isfinite(float(self.service.cost(*goes)))
        reward = float(self.service.reward(*self.at, *goes)) if free else -1.0
        self.at = goes if free else self.at
        return self._observed(), reward, False, False, {}

    def _observed(self) -> np.ndarray:
        return np.array([*self.at, self.service.cost(*self.at)])


@pytest.mark.slow
def test_an_environment_is_the_same_with_either(
    client: an.Client, corridor: an.AmbiguityMap
) -> None:
    both = [Walk(client), Walk(an.AmbiguityService(corridor))]
    rng = np.random.default_rng(3)
    for env in both:
        env.reset(seed=1)
    for _ in range(60):
        action = int(rng.integers(4))
        (a, ra, *_), (b, rb, *_) = (env.step(action) for env in both)
        np.testing.assert_array_equal(a, b)
        assert ra == rb


def test_a_client_goes_to_another_process(client: an.Client) -> None:
    other = pickle.loads(pickle.dumps(client.with_weight(2.0)))
    assert (other.weight, other.id) == (2.0, "map")
    assert other.cost(1.0, 1.0) == client.with_weight(2.0).cost(1.0, 1.0)


def test_odd_arguments_are_refused_as_by_the_service(
    client: an.Client, corridor: an.AmbiguityMap
) -> None:
    service = an.AmbiguityService(corridor)
    odd: list[tuple[Any, Any]] = [
        ("a", 3.0), ([3.0, [4.0]], 3.0), ([1.0, 2.0], [1.0, 2.0, 3.0]), (3 + 1j, 3.0),
    ]  # fmt: skip
    for x, y in odd:
        for ask in (client.cost, service.cost):
            with pytest.raises(InputError, match="x"):
                ask(x, y)
    nowhere: Any = None
    assert client.cost(nowhere, 3.0) == service.cost(nowhere, 3.0) == math.inf


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda url: an.Client(url), "map, narrow-room; name one of them"),
        (lambda url: an.Client(url, "mop"), "has no map 'mop'"),
        (lambda url: an.Client(url, "map", layer="levl"), "no layer 'levl'"),
        (lambda url: an.Client(url, "map", weight=-1), "at least 0"),
        (lambda url: an.Client("no address", "map"), "no address"),
        (lambda url: an.Client(url, "map").with_weight(math.nan), "weight"),
        (lambda url: an.Client(url, "narrow-room").cost(1, 1), "give theta"),
        (lambda url: an.Client(url, "map").reward(0, 0, math.nan, 0), "x1 is not finite"),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(
    live: Live, make: Callable[[str], object], message: str
) -> None:
    with pytest.raises(an.InputError, match=message):
        make(live.url)


def test_a_server_that_is_not_there_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(an.InputError, match=r"no server answers there .* Start `ambinav serve`"):
        an.Client(f"http://127.0.0.1:{port}")


@contextmanager
def answering(*answers: bytes) -> Iterator[str]:
    """A server that gives these answers, each on a connection of its own; nothing after them."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            for answer in answers:
                line, _ = listening.accept()
                with line:
                    line.recv(65536)
                    line.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        thread.join(30)


def _answer(status: str, body: object, *headers: str) -> bytes:
    text = json.dumps(body).encode()
    lines = [f"HTTP/1.1 {status}", "connection: close", f"content-length: {len(text)}", *headers]
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + text


@pytest.mark.parametrize("body", [{}, [], {"maps": [{"name": "a"}]}, {"maps": [{"id": "a"}]}])
def test_another_program_is_no_server(body: object) -> None:
    with (
        answering(_answer("200 OK", body)) as url,
        pytest.raises(InputError, match="not an ambinav server"),
    ):
        an.Client(url)


def test_what_is_no_token_is_said() -> None:
    for token in ("größe", "a\nb"):
        with pytest.raises(InputError, match="token has characters that no token has"):
            an.Client("http://127.0.0.1:1", token=token)


LAYER = {"name": "level", "has_theta": False}
MAPS = _answer(
    "200 OK", {"maps": [{"id": "a", "digest": "d", "cost_layer": "level", "layers": [LAYER]}]}
)
BUSY = _answer("503 Service Unavailable", {"detail": "Too many."}, "retry-after: 1")


def _number(value: float) -> bytes:
    body = np.float64(value).tobytes()
    head = f"HTTP/1.1 200 OK\r\nconnection: close\r\ncontent-length: {len(body)}\r\n\r\n"
    return head.encode() + body


@pytest.mark.slow
def test_a_client_waits_for_a_busy_server_as_long_as_it_asks() -> None:
    with answering(MAPS, BUSY, b"", _number(2.5)) as url, an.Client(url) as client:
        begun = time.monotonic()
        assert client.cost(1.0, 1.0) == 2.5
        assert time.monotonic() - begun >= 1.0
    with answering(MAPS, BUSY) as url, an.Client(url, patience=0.5) as client:
        begun = time.monotonic()
        with pytest.raises(an.ServerError, match="Too many"):
            client.cost(1.0, 1.0)
        assert time.monotonic() - begun < 0.9  # the server's second would be too long


@pytest.mark.slow
def test_a_client_finds_a_server_that_was_started_again(
    plan_map: Path, turning: an.AmbiguityMap
) -> None:
    with running(create_app([plan_map])) as live:
        client = an.Client(live.url, patience=20.0)
        value, port = client.cost(1.0, 1.0), live.address[1]
    found: list[float] = []
    asking = threading.Thread(target=lambda: found.append(client.cost(1.0, 1.0)))
    asking.start()
    time.sleep(0.3)
    with running(create_app([plan_map]), port=port):
        asking.join(30)
        assert found == [value]
    changed = an.AmbiguityMap(turning.dataset.assign_attrs(environment="map"))
    with running(create_app([changed]), port=port), client:
        for ask in (lambda: client.cost(1.0, 1.0), lambda: client.map):
            with pytest.raises(an.ServerError, match="'map' is another one since"):
                ask()
