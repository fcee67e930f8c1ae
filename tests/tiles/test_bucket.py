"""Maps in tiles in a bucket over the S3 protocol: needs s3fs and moto, which nothing else needs.

    python -m venv s3      # without constraints.txt: botocore wants an older python-dateutil
    s3/bin/pip install -e . s3fs "moto[server]" pytest pytest-timeout hypothesis
    s3/bin/python -m pytest -o filterwarnings= -o addopts=--import-mode=importlib \\
        tests/tiles/test_bucket.py
"""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.demo import DEMO_BUILDING
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.tiles.build import TiledBuild, check_place, run_plan
from tests.tiles.tile_cases import content, demo, plan

s3fs = pytest.importorskip("s3fs")
moto = pytest.importorskip("moto.server")
pytestmark = pytest.mark.slow


class Ended(BaseException):
    """Ends a build where it is."""


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """Address of a server with the bucket `maps`."""
    running = moto.ThreadedMotoServer(port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    try:
        address = f"http://{host}:{port}"
        s3fs.S3FileSystem(key="k", secret="s", endpoint_url=address).mkdir("maps")
        yield address
    finally:
        running.stop()


@pytest.fixture(autouse=True)
def account(server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1", "AWS_ENDPOINT_URL": server,
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    s3fs.S3FileSystem.clear_instance_cache()


def built(place: str, **options: Any) -> TiledBuild:
    return run_plan(plan(demo(), 8.0), place, **{"workers": 0, **options})


@pytest.mark.parametrize("workers", [0, 2])
def test_ended_and_gone_on_with_it_is_that_of_a_folder(workers: int, tmp_path: Path) -> None:
    url = f"s3://maps/{workers}.zarr"

    def end(share: float) -> None:
        if share > 0.5:
            raise Ended

    with pytest.raises(Ended):
        built(url, progress=end)
    done = built(url, workers=workers)
    assert done.kept > 0 and done.made > 0
    s3fs.S3FileSystem().get(url, str(tmp_path / "got"), recursive=True)
    built(str(tmp_path / "folder.zarr"))
    assert content(tmp_path / "got") == content(tmp_path / "folder.zarr")


def test_a_bucket_that_is_not_there_is_said_and_not_made() -> None:
    with pytest.raises(InputError, match=r"nothing can be written there.*bucket does not exist"):
        check_place("s3://map/a.zarr", None)
    assert s3fs.S3FileSystem().ls("") == ["maps"]


def test_a_server_that_is_silent_or_not_there_is_said_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:  # it takes calls and says nothing
        port = silent.getsockname()[1]
        for address in (f"http://127.0.0.1:{port}", "http://127.0.0.1:1"):
            monkeypatch.setenv("AWS_ENDPOINT_URL", address)
            s3fs.S3FileSystem.clear_instance_cache()
            begun = time.monotonic()
            with pytest.raises(InputError, match=r"nobody answers|Could not connect"):
                check_place("s3://maps/a.zarr", None)
            assert time.monotonic() - begun < 8.0


def test_a_wrong_key_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("moto.core.responses.ActionAuthenticatorMixin.request_count", 0)
    monkeypatch.setattr("moto.settings.INITIAL_NO_AUTH_ACTION_COUNT", 0.0)
    with pytest.raises(InputError, match=r"nothing can be written there \(PermissionError"):
        check_place("s3://maps/a.zarr", None)


def test_it_opens_where_it_was_built() -> None:
    built("s3://maps/tiled.zarr")
    whole = AmbiguityMap.open("s3://maps/tiled.zarr")
    xmin, ymin, xmax, ymax = whole.bounds
    bounds = (xmin, ymin, (xmin + xmax) / 2, ymax)
    part = AmbiguityMap.open("s3://maps/tiled.zarr", bounds=bounds)
    here = whole.dataset.sel(x=slice(bounds[0], bounds[2]), y=slice(bounds[1], bounds[3]))
    assert part.dataset.identical(here)
    lazy = AmbiguityMap.open("s3://maps/tiled.zarr", lazy=True)
    assert lazy.sample("level", 5.0, 5.0) == whole.sample("level", 5.0, 5.0)
    whole.save("s3://maps/saved.zarr")
    whole.save("s3://maps/saved.zarr")
    assert AmbiguityMap.open("s3://maps/saved.zarr").dataset.identical(whole.dataset)


def test_commands_read_and_write_there(tmp_path: Path) -> None:
    office, route = "s3://maps/office.zarr", tmp_path / "route.csv"
    making = ["-s", "rplidar-a1", "--spacing", "0.5"]
    calls = (
        ["map", str(DEMO_BUILDING), *making, "-o", office],
        ["audit", str(DEMO_BUILDING), *making, "-o", str(tmp_path / "audit"), "--posts", "0",
         "--no-aliasing", "--save-map", "s3://maps/audited.zarr"],
        ["plan", office, "--start", "3", "3", "--goal", "12", "6", "--planner", "reference",
         "-o", str(route)],
        ["export", office, "--to", "nav2-speed", "-o", str(tmp_path / "speed.yaml")],
        ["diff", office, "s3://maps/audited.zarr"],
    )  # fmt: skip
    for call in calls:
        result = CliRunner().invoke(app, call)
        assert result.exit_code == 0, result.output
    result = CliRunner().invoke(app, ["plan", "s3://map/office.zarr", *calls[2][2:]])
    assert result.exit_code == 2 and "bucket does not exist" in result.output
    assert result.output.count("\n") == 1


def test_a_map_that_cannot_be_had_is_said_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="there is no ambiguity map"):
        AmbiguityMap.open("s3://maps/none.zarr")
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        for address in (f"http://127.0.0.1:{port}", "http://127.0.0.1:1"):
            monkeypatch.setenv("AWS_ENDPOINT_URL", address)
            s3fs.S3FileSystem.clear_instance_cache()
            begun = time.monotonic()
            with pytest.raises(InputError, match=r"nobody answers|Could not connect"):
                AmbiguityMap.open("s3://maps/a.zarr")
            assert time.monotonic() - begun < 8.0


def test_a_wrong_key_may_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("moto.core.responses.ActionAuthenticatorMixin.request_count", 0)
    monkeypatch.setattr("moto.settings.INITIAL_NO_AUTH_ACTION_COUNT", 0.0)
    with pytest.raises(InputError, match=r"nothing can be read there \(PermissionError"):
        AmbiguityMap.open("s3://maps/a.zarr")
