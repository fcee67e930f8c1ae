"""Added layers in pictures, in the audit and on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from typer.testing import CliRunner

import ambinav as an
from ambinav.cli import app
from ambinav.cli.map_options import MapOptions
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting.maps import plot_layer
from ambinav.sensing import RangeScanner
from tests.geometry import scenes

LASER = {
    "name": "short laser",
    "parts": [
        {
            "sensor": {"max_range": 2.0, "std": 0.02, "resolution": 0.01},
            "planar": {"beams": 12, "aperture_deg": 360},
        }
    ],
}
SONAR = {
    "name": "four sonars",
    "parts": [
        {
            "sensor": {"max_range": 2.0, "std": 0.02, "resolution": 0.01, "aperture_deg": 30},
            "ring": {"count": 4, "radius": 0.1},
        }
    ],
}
ARGUMENTS = ("plan.geojson", "--spacing", "0.25")


@pytest.fixture(scope="module")
def amap(laser: RangeScanner) -> AmbiguityMap:
    names = ("fisher", "localizability", "wall_normals")
    return build_map(scenes.room(20.0, 3.0), laser, 0.25, layers=names)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    room = shapely.geometry.mapping(shapely.box(0, 0, 4, 2))
    feature = {"type": "Feature", "properties": {}, "geometry": room}
    plan = {"type": "FeatureCollection", "features": [feature]}
    (tmp_path / "plan.geojson").write_text(json.dumps(plan))
    (tmp_path / "laser.yaml").write_text(yaml.safe_dump(LASER))
    (tmp_path / "sonar.yaml").write_text(yaml.safe_dump(SONAR))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def figure(axes: object) -> Figure:
    found = axes.figure  # type: ignore[attr-defined]
    assert isinstance(found, Figure)
    return found


def dark(axes: object, x: float, y: float) -> float:
    """Luminance at a point, 0 to 1."""
    image = axes.images[-1]  # type: ignore[attr-defined]
    left, right, low, high = image.get_extent()
    rows, columns = image.get_array().shape
    row = int((y - low) / (high - low) * rows)
    column = int((x - left) / (right - left) * columns)
    red, green, blue, _ = image.to_rgba(image.get_array())[row, column]
    return float(0.2126 * red + 0.7152 * green + 0.0722 * blue)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["fisher", "localizability", "localizability_determinant", "wall_normals"]
)
def test_dark_is_badly_localized(amap: AmbiguityMap, name: str) -> None:
    axes = plot_layer(amap, name)
    assert dark(axes, 10.0, 1.5) < dark(axes, 1.0, 1.5) - 0.2
    label = axes.child_axes[-1].get_ylabel()
    attrs = amap.dataset[name].attrs
    assert label == f"{attrs['long_name']} ({attrs['units']})"


@pytest.mark.slow
def test_what_spans_powers_is_drawn_by_powers(amap: AmbiguityMap) -> None:
    norm = plot_layer(amap, "localizability_determinant").images[-1].norm
    assert isinstance(norm, LogNorm)
    assert norm.vmax == pytest.approx(np.nanmax(amap.dataset["localizability_determinant"].values))
    assert not isinstance(plot_layer(amap, "fisher").images[-1].norm, LogNorm)


def test_what_goes_below_zero_is_drawn_whole(amap: AmbiguityMap) -> None:
    below = AmbiguityMap(amap.dataset.assign(fisher=amap.dataset["fisher"] - 0.1))
    norm = plot_layer(below, "fisher").images[-1].norm
    assert norm.vmin == pytest.approx(float(below.dataset["fisher"].min()))


def test_axes_are_drawn_in_degrees(amap: AmbiguityMap) -> None:
    assert plot_layer(amap, "fisher_direction").images[-1].norm.vmax == 180.0


def test_map_command(folder: Path) -> None:
    arguments = ["map", *ARGUMENTS, "-s", "laser.yaml", "-o", "m.zarr", "--json"]
    result = CliRunner().invoke(app, [*arguments, "--layers", "fisher, wall_normals"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["layers"] == ["fisher", "wall_normals"]
    assert {"fisher", "wall_normals"} <= set(an.AmbiguityMap.open("m.zarr").layers)


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_pictures")
def test_audit_command(folder: Path) -> None:
    arguments = ["audit", *ARGUMENTS, "-s", "laser.yaml", "-o", "out", "--layers", "fisher"]
    for _ in range(2):  # a report is replaced by the next
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 0, result.output
    assert (folder / "out/floor-layer-fisher.png").stat().st_size > 1000
    report = json.loads((folder / "out/report.json").read_text())
    assert [layer["name"] for layer in report["layers"]] == ["fisher"]
    for name in ("report.md", "report.html"):
        text = (folder / "out" / name).read_text()
        assert "Other measures" in text
        assert "high is badly localized" in text
        assert "Censi 2007" in text
    plain = ["audit", *ARGUMENTS, "-s", "laser.yaml", "-o", "out"]
    assert CliRunner().invoke(app, plain).exit_code == 0
    assert "Other measures" not in (folder / "out/report.md").read_text()


@pytest.mark.parametrize("command", ["map", "audit"])
@pytest.mark.parametrize(
    ("scanner", "names", "message"),
    [
        ("laser.yaml", "fishr", "there is no layer 'fishr'; did you mean fisher"),
        (
            "laser.yaml",
            "fisher,",
            "there is no layer ''; choose from aliasing, beacons, best_aperture, ",
        ),
        (
            "sonar.yaml",
            "fisher,wall_normals",
            "cannot have wall_normals: wall normals need a laser",
        ),
    ],
)
def test_bad_layers_are_one_sentence_and_status_2(
    folder: Path, monkeypatch: pytest.MonkeyPatch, command: str, scanner: str, names: str,
    message: str,
) -> None:  # fmt: skip
    def never(*arguments: object, **values: object) -> None:
        raise AssertionError("the map was built for nothing")

    monkeypatch.setattr(MapOptions, "build", never)
    before = sorted(folder.iterdir())
    arguments = [command, *ARGUMENTS, "-s", scanner, "-o", "out.zarr", "--layers", names]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("ambinav: error: layers: ")
    assert len(result.stderr.splitlines()) == 1
    assert message in result.stderr
    assert sorted(folder.iterdir()) == before
