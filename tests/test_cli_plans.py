"""Commands on IFC and DXF plans: maps of a storey, and one sentence where a plan is of no use."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.studies.compare.scenario_file import load_scenario
from tests.buildings import plan_models, test_dxf

SCANNER = ("--scanner", "rplidar-a1", "--spacing", "0.4")


@pytest.fixture
def runner() -> CliRunner:
    return CliRunner()


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plan_models.two_storeys(tmp_path_factory.mktemp("plans") / "house.ifc")


@pytest.mark.slow
def test_a_map_of_a_storey_keeps_its_glass_and_its_holes(
    runner: CliRunner, house: Path, tmp_path: Path
) -> None:
    out = tmp_path / "map.zarr"
    done = runner.invoke(
        app, ["map", str(house), "--level", "upper", "--glass", "clear", *SCANNER, "-o", str(out)]
    )
    assert done.exit_code == 0, done.output
    kept = AmbiguityMap.open(out).environment
    assert kept.name == "house Upper"
    assert kept.drivable is not None
    assert not kept.is_free(9.6, 2.6, radius=0.2)  # the hole in the floor
    done = runner.invoke(
        app, ["map", str(house), "--level", "1", "--no-furniture", *SCANNER, "-o", str(out)]
    )
    assert done.exit_code == 0, done.output
    opened = AmbiguityMap.open(out)
    assert opened.segments.glass.sum() == 1
    assert opened.environment.is_free(7.5, 1.3)  # where the table stood


def test_a_map_of_a_drawing_whose_layers_are_named(runner: CliRunner, tmp_path: Path) -> None:
    def draw(space: object) -> None:
        test_dxf.rectangle(space, test_dxf.OUTER, "S1")
        test_dxf.rectangle(space, test_dxf.ROOM, "S1")
        test_dxf.rectangle(space, test_dxf.COLUMN, "S2")

    path = test_dxf.written(tmp_path / "plan.dxf", draw, 0)
    out = tmp_path / "map.zarr"
    given = ["map", str(path), *SCANNER, "-o", str(out), "--unit", "m"]
    done = runner.invoke(app, [*given, "--cad-layer", "S1=walls", "--cad-layer", "S2=columns"])
    assert done.exit_code == 0, done.output
    assert AmbiguityMap.open(out).environment.free.area == pytest.approx(24.0 - 0.09, abs=1e-4)


BAD = {
    "no level": ([], "0: Ground at 0 m, 1: Upper at 3 m"),
    "no such level": (["--level", "7"], "there is no level '7'"),
    "height": (["--level", "0", "--height", "-1"], "height is -1"),
    "too high": (["--level", "0", "--height", "2.9"], "no wall stands 2.9 m above"),
    "doors": (["--level", "0", "--doors", "ajar"], "doors is 'ajar'"),
    "glass": (["--level", "0", "--glass", "bullet"], "glass is 'bullet'"),
    "unit": (["--level", "0", "--unit", "m"], "unit means nothing for a building model"),
    "layer": (["--level", "0", "--cad-layer", "S1=walls"], "layers means nothing for a building"),
    "no pair": (["--level", "0", "--cad-layer", "S1"], "--cad-layer: 'S1' is not NAME=ROLE"),
}


@pytest.mark.parametrize("command", ["map", "audit", "design scanners"])
@pytest.mark.parametrize(("options", "said"), BAD.values(), ids=BAD.keys())
def test_bad_options_are_one_sentence_and_write_nothing(
    options: list[str], said: str, command: str, runner: CliRunner, house: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = runner.invoke(app, [*command.split(), str(house), *SCANNER, *options, "-o", str(out)])
    assert done.exit_code == 2
    assert said in " ".join(done.stderr.split())
    assert len(done.stderr.strip().splitlines()) == 1
    assert not out.exists()


def test_a_package_that_is_missing_is_named_with_what_brings_it(
    runner: CliRunner, house: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ambinav.runtime.packages.find_spec", lambda name: None)
    done = runner.invoke(app, ["map", str(house), "--level", "0", *SCANNER, "-o", "m.zarr"])
    assert done.exit_code == 2
    assert 'ifcopenshell; run: pip install "ambinav[plans]"' in " ".join(done.stderr.split())


@pytest.mark.slow
def test_keys_of_a_scenario(house: Path, tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    plain = {
        "environment": str(house),
        "scanner": "rplidar-a1",
        "pairs": [{"start": [1.0, 1.5], "goal": [9.0, 1.0]}],
        "routes": [{"kind": "shortest"}],
    }

    def load(**keys: object):
        path.write_text(yaml.safe_dump(json.loads(json.dumps({**plain, **keys}))))
        return load_scenario(path).environment

    assert not load(level="Upper").is_free(7.5, 1.3)
    assert load(level=1, plan={"furniture": False, "height": 0.5}).is_free(7.5, 1.3)
    with pytest.raises(InputError, match=r"1: Upper at 3 m.* choose one with the key level\.$"):
        load()
    with pytest.raises(InputError, match="glass is 'thick'"):
        load(level=0, plan={"glass": "thick"})
    with pytest.raises(InputError, match="plan"):
        load(level=0, plan={"glas": "clear"})
