"""Scenarios whose building is in three dimensions: what they say, and what comes of them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from ambinav.casting.prisms.prisms import Prisms
from ambinav.cli import app
from ambinav.runtime.errors import InputError
from ambinav.studies.compare.scenario_file import load_scenario
from tests.buildings import plan_models
from tests.studies.compare.conftest import write

Plain = dict[str, Any]
SENSOR = {"max_range": 3.0, "std": 0.02, "resolution": 0.001}
# Turned by a hair: no beam looks along a wall.
LEVEL = {"sensor": SENSOR, "planar": {"beams": 24, "aperture_deg": 360, "mount": [0, 0, 0.2]}}
LAYERS = {"columns": 24, "aperture_deg": 360, "elevation_deg": [-15, 0, 10], "z": 0.5}


def scanner(part: Plain) -> Plain:
    return {"name": "laser", "parts": [part]}


def test_a_plan_with_a_height_and_a_scanner_at_its_own(scenario: Plain, tmp_path: Path) -> None:
    scenario |= {"space": {"extrude": 2.5}, "scanner_height": 0.4}
    read = load_scenario(write(tmp_path, scenario))
    assert isinstance(read.environment.space, Prisms)
    assert read.environment.space.ceiling == 2.5
    assert read.scanner.upright[:, 0].tolist() == [0.4] * 24


@pytest.mark.slow
def test_a_building_model_in_space(scenario: Plain, tmp_path: Path) -> None:
    plan_models.two_storeys(tmp_path / "house.ifc")
    scenario |= {"environment": "house.ifc", "level": "Ground", "scanner_height": 0.3}
    flat = load_scenario(write(tmp_path, scenario)).environment
    solid = load_scenario(write(tmp_path, scenario | {"space": {"in_space": True}})).environment
    assert flat.space is None and isinstance(solid.space, Prisms)
    assert solid.free.equals(flat.free)


@pytest.mark.slow
def test_an_extruded_plan_is_compared_as_the_plan_is(scenario: Plain, tmp_path: Path) -> None:
    scenario |= {"scanner": scanner(LEVEL), "drive": {"runs": 4}, "scanner_height": 0.4}
    rows = []
    for name, more in (("flat", {}), ("solid", {"space": {"extrude": 2.5}})):
        folder = tmp_path / name
        folder.mkdir()
        words = ["compare", str(write(folder, scenario | more)), "-o", str(folder / "out")]
        done = CliRunner().invoke(app, [*words, "--no-store", "--jobs", "1"])
        assert done.exit_code == 0, done.output
        report = json.loads((folder / "out" / "report.json").read_text())
        assert ("space" in report["parameters"]) == bool(more)
        rows.append(
            [
                figure["value"]["value"]
                for row in report["rows"]
                for figure in row["figures"].values()
            ]
        )
    flat, solid = (np.array(one, dtype=float) for one in rows)
    assert np.allclose(flat, solid, rtol=1e-4, atol=1e-4, equal_nan=True)


@pytest.mark.sweep
def test_a_3d_scanner_is_compared(scenario: Plain, tmp_path: Path) -> None:
    scenario |= {"scanner": scanner({"sensor": SENSOR, "layers": LAYERS})}
    scenario |= {"space": {"extrude": 2.5}, "drive": {"runs": 2}, "exports": {"runs": 1}}
    words = ["compare", str(write(tmp_path, scenario)), "-o", str(tmp_path / "out"), "--no-store"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["rows"][0]["figures"]["arrived"]["value"]["value"] == 100.0


BAD: dict[str, tuple[Plain, str]] = {
    "unknown": ({"space": {"extrud": 2}}, "space: the key 'extrud' is unknown; did you mean extr"),
    "height": ({"space": {"extrude": 0}}, "space: extrude is 0; give a number above 0"),
    "not finite": ({"space": {"floor": math.inf}}, "space: floor is inf"),
    "both": ({"space": {"extrude": 2, "in_space": True}}, "leave one of the two out"),
    "up": ({"space": {"up": "w"}}, "space: up is 'w'"),
    "no mesh": ({"space": {"floor": 0.0}}, "environment: floor: "),
    "no model": ({"space": {"in_space": True}}, "in_space means nothing for a drawn plan"),
    "on the floor": ({"space": {"extrude": 2}}, "the key scanner_height, in Python"),
    "scanner": ({"scanner_height": -1}, "scanner_height is -1; give a number above 0"),
    "no heights": (
        {"scanner": scanner({"sensor": SENSOR, "layers": LAYERS})},
        "give the building heights: the key space: extrude, or the key space: in_space",
    ),
}


@pytest.mark.parametrize(("more", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_sentence(
    scenario: Plain, tmp_path: Path, more: Plain, message: str
) -> None:
    with pytest.raises(InputError) as error:
        load_scenario(write(tmp_path, scenario | more))
    text = str(error.value)
    assert str(tmp_path) in text and message in text and text.endswith(".") and "\n" not in text


def test_a_mesh_of_a_scanner_without_a_height(scenario: Plain, tmp_path: Path) -> None:
    corners = [(x, y, z) for x in (0, 6) for y in (0, 4) for z in (0, 2.5)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines += ["f " + " ".join(str(k + 1) for k in quad) for quad in quads]
    (tmp_path / "room.obj").write_text("\n".join(lines) + "\n")
    scenario |= {"environment": "room.obj"}
    with pytest.raises(InputError, match=r"give the key scanner_height, e\.g"):
        load_scenario(write(tmp_path, scenario))
    with pytest.raises(InputError, match=r"in_space: .* has three dimensions already"):
        load_scenario(write(tmp_path, scenario | {"space": {"in_space": True}}))
    mesh = scenario | {"scanner_height": 0.3, "space": {"floor": 0.0}}
    assert load_scenario(write(tmp_path, mesh)).environment.space is not None
