"""`ambinav serve` as a user meets it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import psutil
import pytest
from typer.testing import CliRunner

import ambinav.runtime.packages
from ambinav.cli import app
from tests.server.live import wait_until

ROOT = Path(__file__).parents[2]


@pytest.fixture
def runner() -> CliRunner:
    return CliRunner()


@contextmanager
def started(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server in a process of its own, and its address."""
    paths = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))
    process = subprocess.Popen(
        [sys.executable, "-m", "ambinav.cli", "serve", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": paths},
    )
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline().split(" ")[0].rstrip("/")
    finally:
        process.kill()
        process.communicate(timeout=60)


@pytest.mark.slow
def test_it_serves_until_it_is_interrupted(plan_map: Path, tmp_path: Path) -> None:
    store = tmp_path / "office.zarr"
    shutil.copytree(plan_map, store)
    with started(str(store), "--port", "0", "--token", "secret") as (process, url):
        assert httpx.get(f"{url}/v1/health", timeout=60).json()["maps"] == 1
        assert httpx.get(f"{url}/v1/maps").status_code == 401
        headers = {"authorization": "Bearer secret"}
        (found,) = httpx.get(f"{url}/v1/maps", headers=headers).json()["maps"]
        assert found["id"] == "office"
        ends = {"start": [1, 1], "goal": [10, 2]}
        plan = httpx.post(f"{url}/v1/maps/office/plan", json=ends, headers=headers, timeout=60)
        assert plan.status_code == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(30) in (0, 130)
        assert process.stderr is not None
        assert "Traceback" not in process.stderr.read()


@contextmanager
def audited(url: str, folder: Path) -> Iterator[httpx.Response]:
    """An audit that takes minutes, and the stream of its events."""
    plan = b'{"type": "Polygon", "coordinates": [[[0,0],[60,0],[60,60],[0,60],[0,0]]]}'
    files = [("files", ("a.geojson", plan))]
    form = {"scanner": "sick-lms200", "spacing": "0.1", "headings": "8"}
    answer = httpx.post(f"{url}/v1/audits", files=files, data=form, timeout=60)
    assert answer.status_code == 202, answer.text
    events = f"{url}{answer.headers['location']}/events"
    with httpx.stream("GET", events, timeout=60) as stream:
        yield stream


@pytest.mark.sweep
def test_who_follows_an_audit_is_told_when_the_server_ends(
    plan_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with started(str(plan_map), "--port", "0") as (process, url), audited(url, tmp_path) as stream:
        lines = stream.iter_lines()
        assert "event: progress" in lines
        process.send_signal(signal.SIGTERM)
        sent = list(lines)
        assert "event: failed" in sent and any("server is shutting down" in line for line in sent)
        assert process.wait(30) in (143, -signal.SIGTERM)
        assert process.stderr is not None and process.stderr.read() == ""
    assert not list(tmp_path.glob("ambinav-serve-*"))


@pytest.mark.sweep
def test_what_a_killed_server_leaves_is_removed_at_the_next_start(
    plan_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))

    def folders() -> set[Path]:
        return {path for path in tmp_path.glob("ambinav-serve-*") if path.is_dir()}

    with ExitStack() as stack:
        killed, first = stack.enter_context(started(str(plan_map), "--port", "0"))
        stream = stack.enter_context(audited(first, tmp_path))
        assert "event: progress" in stream.iter_lines()
        workers = psutil.Process(killed.pid).children(recursive=True)
        (left,) = folders()
        _, second = stack.enter_context(started(str(plan_map), "--port", "0"))
        # One that lives keeps what it has, whoever starts beside it.
        assert httpx.get(f"{second}/v1/maps/map/map.npz", timeout=60).status_code == 200
        assert left in folders()
        killed.kill()
        _, alive = psutil.wait_procs(workers, timeout=60)
        assert workers and not alive
        (other,) = folders() - {left}
        stack.enter_context(started(str(plan_map), "--port", "0"))
        wait_until(lambda: left not in folders())
        assert other in folders()
        assert httpx.get(f"{second}/v1/maps/map/map.npz", timeout=60).status_code == 200


def test_a_port_in_use_is_said_before_maps_are_read(runner: CliRunner, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = runner.invoke(app, ["serve", str(tmp_path / "none.zarr"), "--port", str(port)])
    assert result.exit_code == 2
    assert f"--port: {port} is in use on 127.0.0.1" in result.stderr


def test_what_is_no_map_is_said_in_a_sentence(runner: CliRunner, plan_folder: Path) -> None:
    newer = plan_folder / "map.zarr" / "zarr.json"
    for name, message in (
        ("none.zarr", "there is no such map"),
        ("notes.txt", "not an ambiguity map"),
    ):
        result = runner.invoke(app, ["serve", name, "--port", "0"])
        assert (result.exit_code, message in result.stderr) == (2, True), result.stderr
    root = json.loads(newer.read_text())
    root["attributes"]["map_format"] = 99
    newer.write_text(json.dumps(root))
    result = runner.invoke(app, ["serve", "map.zarr", "--port", "0"])
    assert result.exit_code == 2
    assert "has format 99" in result.stderr and "install a newer ambinav" in " ".join(
        result.stderr.split()
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--port", "70000"), "--port: 70000 is not a valid port"),
        (("--host", "no such host"), "--host: 'no such host' is not an address"),
        (("--host", "203.0.113.7"), "--host: '203.0.113.7' cannot be used to listen"),
        (("--token", ""), "--token"),
        (("--token", "tökén"), "--token"),
        (("--host", "0.0.0.0"), "give --token or --read-token, or --insecure"),
        (("--trusted-proxy", "10.0.0.300"), "--trusted-proxy: '10.0.0.300' is not an address"),
        (("--public-url", "maps.example"), "--public-url: 'maps.example' is not the address"),
    ],
)
def test_options_that_cannot_be_are_named(
    runner: CliRunner, plan_folder: Path, arguments: tuple[str, ...], message: str
) -> None:
    result = runner.invoke(app, ["serve", "map.zarr", "--port", "0", *arguments])
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())


def test_without_the_extra_it_says_what_to_install(
    runner: CliRunner, plan_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ambinav.runtime.packages, "find_spec", lambda name: None)
    result = runner.invoke(app, ["serve", "map.zarr"])
    assert result.exit_code == 2
    assert 'pip install "ambinav[serve]"' in result.stderr
