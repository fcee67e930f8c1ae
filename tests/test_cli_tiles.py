"""`ambinav map --tile`: what it says before it starts, what it refuses, and what it writes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.demo import DEMO_BUILDING
from ambinav.maps.ambiguity_map import AmbiguityMap
from tests.tiles.tile_cases import assert_identical

MAP = ["map", str(DEMO_BUILDING), "-s", "rplidar-a1", "--spacing", "0.5"]


@pytest.fixture
def runner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CliRunner:
    monkeypatch.chdir(tmp_path)
    return CliRunner()


@pytest.mark.slow
def test_a_dry_run_says_what_the_map_takes_and_writes_nothing(
    runner: CliRunner, tmp_path: Path
) -> None:
    dry = [*MAP, "-o", "a.zarr", "--tile", "7", "--dry-run", "--workers", "3"]
    result = runner.invoke(app, dry)
    assert result.exit_code == 0, result.output
    for part in ("poses in 35 tiles (5 x 7)", "on 3 workers", "on disk", "of memory"):
        assert part in result.stdout
    figures = json.loads(runner.invoke(app, [*dry, "--json"]).stdout)
    assert (figures["tiles"], figures["workers"], figures["headings"]) == (35, 3, 1)
    assert min(figures[key] for key in ("poses", "seconds", "stored", "sent", "memory")) > 0
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_it_writes_the_map_that_it_writes_in_one_piece(runner: CliRunner) -> None:
    tiled = runner.invoke(app, [*MAP, "-o", "a.zarr", "--tile", "7", "--workers", "0", "--json"])
    assert tiled.exit_code == 0, tiled.output
    runner.invoke(app, [*MAP, "-o", "b.zarr"])
    amap = AmbiguityMap.open("a.zarr")
    assert_identical(amap, AmbiguityMap.open("b.zarr"))
    done = json.loads(tiled.stdout)
    assert (done["tiles"], done["made"]) == (35, 35)
    assert done["poses"] == int(amap.dataset["free"].sum())


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (["--tile", "nan"], "--tile: nan"),
        (["--tile", "0.1"], "at least one spacing"),
        (["--tile", "7", "--workers", "-1"], "--workers: -1"),
        (["--tile", "7", "--workers", "1", "--scheduler", "tcp://a:1"], "give one of them"),
        (["--tile", "7", "--layers", "fisher"], "fisher cannot be made tile by tile"),
        (["--tile", "7", "-o", "nosuch://maps/a.zarr"], "nothing can be read or written there"),
        (["-o", "nosuch://maps/a.zarr"], "nothing can be read or written there"),
        (["--dry-run"], "--dry-run: this is for maps in tiles"),
        (["--workers", "2"], "--workers: this is for maps in tiles"),
        (["--scheduler", "tcp://a:1"], "--scheduler: this is for maps in tiles"),
    ],
)
def test_what_cannot_be_is_refused(
    runner: CliRunner, tmp_path: Path, options: list[str], part: str
) -> None:
    result = runner.invoke(app, [*MAP, "-o", "a.zarr", *options])
    assert result.exit_code == 2
    assert part in result.output and result.output.count("\n") == 1
    assert not list(tmp_path.iterdir())
