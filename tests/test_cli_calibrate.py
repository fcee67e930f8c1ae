"""`ambinav calibrate localizer`: its output, the class that it writes, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from ambinav.cli import app, calibrate_localizer
from ambinav.forecasting import localizer_study
from ambinav.forecasting.kept_drives import KeptDrives
from ambinav.forecasting.localizer_class import LocalizerClass

SCANNER = """
name: short laser
parts:
  - sensor: {max_range: 1.5, std: 0.03, resolution: 0.001}
    planar: {beams: 24, aperture_deg: 360}
"""
LOCALIZER = "{type: amcl, min_particles: 60, max_particles: 120}\n"
DEPTHS = (1.6, 1.8, 2.0, 7.0, 9.0)
DRIVES = ("--routes", "2", "--runs", "16", "--spacing", "0.5", "--odometry", "poor")
RUN = ("calibrate", "localizer", "mine.yaml", "-s", "short.yaml", "-o", "class.yaml", *DRIVES)
MAPS = tuple(word for k in range(len(DEPTHS)) for word in ("--map", f"hall-{k}.geojson"))


def hall(depth: float) -> str:
    corners = [[0, 0], [20, 0], [20, depth], [0, depth], [0, 0]]
    room = {"type": "Polygon", "coordinates": [corners]}
    properties = {"kind": "room", "name": "hall"}
    feature = {"type": "Feature", "properties": properties, "geometry": room}
    return json.dumps({"type": "FeatureCollection", "features": [feature]})


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "short.yaml").write_text(SCANNER)
    (tmp_path / "mine.yaml").write_text(LOCALIZER)
    for k, depth in enumerate(DEPTHS):
        (tmp_path / f"hall-{k}.geojson").write_text(hall(depth))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def invoke(*words: str) -> Result:
    return CliRunner().invoke(app, words)


@pytest.mark.slow
def test_writes_a_class_that_forecasts(folder: Path) -> None:
    result = invoke(*RUN, *MAPS)
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "scanner routes lost forecast short.yaml " in text
    assert "Brier skill in 5 buildings, each forecast by a fit without it" in text
    assert "class: class.yaml" in text
    entry = LocalizerClass.load("class.yaml")
    assert (entry.name, entry.localizer["type"]) == ("mine", "amcl")  # type: ignore[index]
    assert not (folder / "class.yaml.drives").exists()
    document = json.loads(invoke(*RUN, *MAPS, "--json").stdout)
    assert document["made"] == entry.made
    assert document["buildings"] == 5
    assert f"{document['scanners'][0]['routes']} routes with short.yaml" in entry.made
    invoke("map", "hall-3.geojson", "-s", "short.yaml", "-o", "hall.zarr", "--spacing", "0.5")
    invoke("plan", "hall.zarr", "--start", "1", "2", "--goal", "18", "5", "-o", "route.csv")
    forecast = invoke("forecast", "hall.zarr", "route.csv", "--localizer", "class.yaml", "--json")
    assert forecast.exit_code == 0, forecast.output
    assert json.loads(forecast.stdout)["localizer"] == "mine"


@pytest.mark.slow
def test_interrupted_it_keeps_the_drives(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(localizer_study, "calibrate", stop)
    result = invoke(*RUN, *MAPS)
    assert result.exit_code == 130
    assert "interrupted; the drives so far are in class.yaml.drives" in result.stderr
    assert len(KeptDrives(Path("class.yaml.drives"))) > len(DEPTHS)
    assert not (folder / "class.yaml").exists()


def test_draws_buildings_of_suites(folder: Path) -> None:
    asked = calibrate_localizer.DrivenBuildings(suite=["hall", "loop"], buildings=2)
    drawn = asked.load(calibrate_localizer.BuildingOptions())
    assert list(drawn) == ["hall-1", "loop-1", "hall-2", "loop-2"]
    assert drawn["loop-2"].name == "loop-2"


def test_a_class_is_calibrated_as_the_localizer_that_it_drives() -> None:
    """`product` is the name of a class, and of no localizer."""
    begin, kind = calibrate_localizer._uncalibrated("product"), LocalizerClass.load("product")
    assert begin.localizer == kind.localizer != "product"
    assert (begin.distance, begin.angle, begin.made) == (kind.distance, kind.angle, "")
    assert calibrate_localizer._uncalibrated("ekf").localizer == "ekf"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("gps", *RUN[3:]), "there is no localizer 'gps'; "),
        (("short.yaml", *RUN[3:]), "short.yaml holds {'name': 'short laser'"),
        (("none.yaml", *RUN[3:]), "none.yaml: the file cannot be read"),
        ((*RUN[2:], "-s", "sonic"), "sonic"),
        ((*RUN[2:], "-o", "class.txt"), "--output: class.txt is not a .yaml file; give e.g. "),
        ((*RUN[2:], *MAPS[:4]), "there are 2 buildings; give at least 5"),
        ((*RUN[2:], "--odometry", "wheels"), "--odometry: odometry is 'wheels'; "),
        ((*RUN[2:], "-o", "short.yaml"), "short.yaml is also the input; name another file"),
        ((*RUN[2:], "--suite", "garden"), "there is no suite 'garden'; "),
        ((*RUN[2:], "--buildings", "0"), "--buildings: 0 is too few"),
        ((*RUN[2:], "--runs", "1"), "--runs: 1 is too few; give 2 or more"),
        ((*RUN[2:], "--routes", "0"), "--routes: 0 is too few"),
        ((*RUN[2:], "--seed", "-1"), "--seed: -1 is negative"),
        ((*RUN[2:], "--unit", "cm"), "--unit: 'cm' describes a plan"),
    ],
)
def test_bad_input(folder: Path, words: tuple[str, ...], message: str) -> None:
    result = invoke(*RUN[:2], *words)
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert not (folder / "class.yaml").exists()


def test_a_parameter_that_there_is_not(folder: Path) -> None:
    (folder / "mine.yaml").write_text("{type: amcl, particles: 3}\n")
    result = invoke(*RUN, *MAPS)
    assert result.exit_code == 2
    assert "mine.yaml: the key 'particles' is unknown" in result.stderr
