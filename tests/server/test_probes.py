"""Readiness, metrics and the log of requests."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numba.core.event as numba_events
import pytest
from prometheus_client.parser import text_string_to_metric_families

from ambinav.server.observer import ACCESS_LOG, JsonLines
from tests.server.live import Live, wait_until
from tests.server.test_cli_serve import ROOT, started


def samples(live: Live) -> dict[tuple[str, ...], float]:
    """Return all figures, by name and labels."""
    text = live.http.get("/v1/metrics").text
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_it_is_ready_when_its_code_is_compiled(serve: Callable[..., Live], plan_map: Path) -> None:
    live = serve([plan_map])
    wait_until(lambda: live.http.get("/v1/ready").status_code == 200)
    assert live.get("/v1/ready")["seconds"] == live.context.warming.seconds > 0.0
    live.context.warming.seconds = None
    answer = live.http.get("/v1/ready")
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
    assert "steps are done" in answer.json()["detail"]
    assert live.http.get("/v1/startup").status_code == 503
    assert live.get("/v1/health")["status"] == "ok"
    live.context.warming.seconds = 1.0
    live.context.end()
    assert live.http.get("/v1/ready").status_code == 503
    assert live.http.get("/v1/startup").status_code == 200


def test_when_it_is_ready_nothing_is_compiled_in_the_event_loop(live: Live) -> None:
    wait_until(lambda: live.http.get("/v1/ready").status_code == 200)
    threads: list[str] = []

    class Noted(numba_events.Listener):
        def on_start(self, event: Any) -> None:
            threads.append(threading.current_thread().name)

        def on_end(self, event: Any) -> None:
            pass

    listener = Noted()
    numba_events.register("numba:compile", listener)
    try:
        ends = {
            "x0": [1.0],
            "y0": [1.0],
            "x1": [1.5],
            "y1": [1.2],
            "theta0": [0.0],
            "theta1": [1.0],
        }
        for id in ("map", "narrow-room"):
            for space, radius in (("r2", 0), ("se2", 0), ("dubins", 0.3), ("reeds-shepp", 0.3)):
                what = ends | {"steering": space, "turning_radius": radius}
                assert live.http.post(f"/v1/maps/{id}/reward", json=what).status_code == 200
            at = {"x": [1.0], "y": [1.0], "theta": [0.0]}
            for path in ("cost", "level"):
                assert live.http.post(f"/v1/maps/{id}/{path}", json=at).status_code == 200
            live.get(f"/v1/maps/{id}/cost", x=1.0, y=1.0, theta=0.0)
    finally:
        numba_events.unregister("numba:compile", listener)
    assert threads == []


def test_metrics_count_requests_by_route(live: Live) -> None:
    wait_until(lambda: live.http.get("/v1/ready").status_code == 200)
    before = samples(live)
    for x in (1.0, 1.2):
        live.get("/v1/maps/map/cost", x=x, y=1.0)
    live.http.get("/v1/maps/none/cost", params={"x": 1, "y": 1})
    live.http.head("/v1/maps")
    live.http.get("/v1/nothing/here")
    live.http.get("/v1/maps", headers={"host": "other"})
    after = samples(live)

    def more(method: str, route: str, status: str) -> float:
        key = ("ambinav_requests_total", method, route, status)
        return after.get(key, 0.0) - before.get(key, 0.0)

    assert more("GET", "/v1/maps/{id}/cost", "200") == 2
    assert more("GET", "/v1/maps/{id}/cost", "404") == 1
    assert more("HEAD", "/v1/maps", "200") == 1
    assert more("GET", "other", "404") == 1
    assert more("GET", "other", "403") == 1
    assert after["ambinav_request_seconds_count", "/v1/maps/{id}/cost"] >= 3
    assert after["ambinav_maps",] == 2 and after["ambinav_ready",] == 1
    assert after["ambinav_requests_open",] == 1  # the one that asks
    assert after["process_resident_memory_bytes",] > 1e7


def test_a_request_is_one_line_of_json(live: Live, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, ACCESS_LOG):
        live.get("/v1/maps/map/cost", x=1.0, y=1.0)
        live.http.get('/v1/maps/a"%0Ab')
        wait_until(lambda: len(caplog.records) == 2)
    lines = [JsonLines().format(record) for record in caplog.records]
    assert not any("\n" in line for line in lines)
    first, second = map(json.loads, lines)
    assert first["client"] == "127.0.0.1" and first["path"] == "/v1/maps/map/cost"
    assert (first["status"], first["method"], second["status"]) == (200, "GET", 404)
    assert first["bytes"] > 10 and first["ms"] > 0.0 and first["time"].endswith("+00:00")


@pytest.mark.slow
def test_a_check_ends_when_the_server_is_ready(plan_map: Path) -> None:
    with started(str(plan_map), "--port", "0", "--check") as (process, _):
        assert process.stdout is not None
        assert process.stdout.read().startswith("ready after ")
        assert process.wait(30) == 0


@pytest.mark.slow
def test_a_check_fails_where_no_process_for_plans_starts(plan_map: Path, tmp_path: Path) -> None:
    script = tmp_path / "unguarded.py"  # each process that it starts runs it again, and ends
    script.write_text("from ambinav.cli import app\napp()\n")
    command = [sys.executable, str(script), "serve", str(plan_map), "--port", "0", "--check"]
    paths = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))
    ended = subprocess.run(
        command, capture_output=True, text=True, timeout=120, env=os.environ | {"PYTHONPATH": paths}
    )
    assert ended.returncode == 1
    assert ended.stderr.endswith("the server is not fully prepared; its log above says why.\n")


@pytest.mark.sweep
def test_the_log_of_a_server_is_json(plan_map: Path) -> None:
    with started(str(plan_map), "--port", "0", "--log") as (process, url):
        assert httpx.get(f"{url}/v1/maps", timeout=60).status_code == 200
        assert process.stderr is not None
        line = json.loads(process.stderr.readline())
    assert line["logger"] == ACCESS_LOG and line["path"] == "/v1/maps"
