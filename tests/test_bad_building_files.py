"""Buildings in damaged files or in other units, and gates that judge nothing, at the commands."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh
import yaml
from PIL import Image
from typer.testing import CliRunner

from ambinav.cli import app
from tests.buildings import plan_models, test_dxf
from tests.buildings.mesh import cloud_files, test_octomap
from tests.buildings.mesh.test_read import house
from tests.test_bad_input import (
    FROM_MAP,
    FROM_PLAN,
    HEADER,
    Case,
    Change,
    case,
    cells,
    check_refusal,
    fill,
    inventory,
    nothing,
)

HALF, NEARLY = 0.5, 0.999


def of(name: str, *more: str) -> tuple[str, ...]:
    """An audit of a building."""
    return ("audit", name, *FROM_PLAN[2:], *more)


def of_space(name: str, *more: str) -> tuple[str, ...]:
    """An audit of a building in space."""
    return of(name, "--scanner-height", "0.3", *more)


def ifc(folder: Path) -> Path:
    return plan_models.two_storeys(folder / "house.ifc")


def dxf(folder: Path) -> Path:
    return test_dxf.written(folder / "plan.dxf", test_dxf.room)


def mesh(suffix: str, scale: float = 1.0) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / f"house.{suffix}"
        house(scale).export(path)
        return path

    return write


def ascii_ply(folder: Path) -> Path:
    path = folder / "house.ply"
    path.write_bytes(trimesh.exchange.ply.export_ply(house(), encoding="ascii"))
    return path


def cloud(folder: Path) -> Path:
    path = folder / "scan.ply"
    trimesh.PointCloud(cloud_files.room(400)).export(path)
    return path


def las(folder: Path) -> Path:
    pytest.importorskip("laspy")
    cloud_files.write_las(folder / "scan.las", cloud_files.room(400))
    return folder / "scan.las"


def octomap(folder: Path) -> Path:
    inner, unknown = test_octomap.INNER, test_octomap.UNKNOWN
    down = [test_octomap.node(*[unknown] * 7, inner), *[test_octomap.node(inner)] * 14]
    last = test_octomap.node(test_octomap.OCCUPIED)
    return test_octomap.written(folder / "house.bt", [*down, last])


def cut(write: Callable[[Path], Path], share: float) -> Change:
    """Write a file and cut it off."""

    def change(folder: Path) -> None:
        path = write(folder)
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])

    return change


def replaced(write: Callable[[Path], Path], old: bytes, new: bytes) -> Change:
    def change(folder: Path) -> None:
        path = write(folder)
        content = re.sub(old, new, path.read_bytes(), count=1)
        assert content != path.read_bytes()
        path.write_bytes(content)

    return change


def gate(condition: str, *named: str) -> Case:
    return case((*FROM_PLAN, "--fail-if", condition), nothing, "--fail-if", condition, *named)


def image(mode: str, alpha: int) -> Change:
    """The map with an image that has an alpha channel."""

    def change(folder: Path) -> None:
        colour = Image.fromarray(cells()).convert(mode)
        colour.putalpha(alpha)
        colour.save(folder / "map.png")
        (folder / "map.yaml").write_text(yaml.safe_dump(HEADER | {"image": "map.png"}))

    return change


CASES = {
    "half of an IFC file": case(of("house.ifc"), cut(ifc, HALF), "cut off", "END-ISO-10303-21"),
    "nearly an IFC file": case(of("house.ifc"), cut(ifc, NEARLY), "cut off"),
    "an IFC file without a level": case(of("house.ifc"), ifc, "Ground", "--level"),
    "an IFC file in another unit than it names": case(
        of("house.ifc", "--level", "Ground"),
        replaced(ifc, rb"IFCSIUNIT\(\*,\.LENGTHUNIT\.,\$", b"IFCSIUNIT(*,.LENGTHUNIT.,.KILO."),
        "IfcUnitAssignment"),
    "half of a DXF file": case(of("plan.dxf"), cut(dxf, HALF), "export it again"),
    "nearly a DXF file": case(of("plan.dxf"), cut(dxf, NEARLY), "export it again"),
    "half of a PLY file": case(of_space("house.ply"), cut(mesh("ply"), HALF), "copy it again"),
    "nearly a PLY file": case(of_space("house.ply"), cut(mesh("ply"), NEARLY), "copy it again"),
    "half of a PLY file in text": case(of_space("house.ply"), cut(ascii_ply, HALF), "cut off",
                                       "copy it again"),
    "the head of a PLY file": case(of_space("house.ply"), cut(mesh("ply"), 0.05), "header"),
    "half of an STL file": case(of_space("house.stl"), cut(mesh("stl"), HALF), "again"),
    "half of a GLB file": case(of_space("house.glb"), cut(mesh("glb"), HALF), "again"),
    "half of a cloud": case(of_space("scan.ply"), cut(cloud, HALF), "cut off"),
    "half of a LAS file": case(of_space("scan.las"), cut(las, HALF), "again"),
    "half of an OctoMap": case(of_space("house.bt"), cut(octomap, HALF), "not an OctoMap"),
    "nearly an OctoMap": case(of_space("house.bt"), cut(octomap, 0.99), "cut off"),
    "a mesh in millimetres": case(of_space("house.stl"), mesh("stl", 1000.0), "--unit", "mm"),
    "a mesh in inches": case(of_space("house.ply"), mesh("ply", 39.37), "--unit", "in"),
    "a mesh in kilometres": case(of_space("house.obj"), mesh("obj", 0.001), "--unit"),
    "a mesh in yards": case(of_space("house.ply", "--unit", "yd"), mesh("ply"), "'yd'", "ft"),
    "a transparent image": case(FROM_MAP, image("L", 0), "map.png", "free"),
    "a transparent colour image": case(FROM_MAP, image("RGB", 0), "map.png", "free"),
    "a share in square metres": gate("open > 2 m2", "open area > 2 m²"),
    "a length in centimetres": gate("longest open stretch > 400 cm", "longest open stretch > 4 m"),
    "an area in hectares": gate("open area > 0.5 ha", "open area > 5000 m²"),
    "a share without a unit": gate("open > 0.02", "open > 2 %"),
    "a number with a unit": gate("places > 2 m", "without a unit"),
    "a condition that never holds": gate("open > 100 %", "never holds"),
    "a condition that always holds": gate("places > -1", "always holds"),
    "no such figure": gate("opne > 2 %", "did you mean 'open'"),
    "a change that never comes": case(
        ("diff", "a.zarr", "b.zarr", "--fail-if", "open change > 100 %"), nothing, "--fail-if",
        "never holds"),
    "a fleet's change in another unit": case(
        ("fleet", "diff", "a", "b", "--fail-if", "bad area rise > 1 ha"), nothing, "--fail-if"),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    fill(tmp_path)
    return tmp_path


def map_figures(*arguments: str) -> Any:
    result = CliRunner().invoke(app, [*FROM_MAP, "--json", *arguments])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_an_opaque_image_is_one_without_alpha(folder: Path, mode: str) -> None:
    areas = [map_figures()["judged_area_m2"]]
    image(mode, 255)(folder)
    areas.append(map_figures("-o", "new/alpha.zarr")["judged_area_m2"])
    assert areas[0] == areas[1] > 3.0


@pytest.mark.slow
def test_feet_that_may_be_metres_are_warned_about(folder: Path) -> None:
    mesh("ply", 3.2808)(folder)
    words = (*of_space("house.ply"), "--no-advice", "--no-aliasing", "--places", "0")
    for more, is_asked in (((), True), (("--unit", "ft"), False)):
        result = CliRunner().invoke(app, [*words, "-o", f"new/{is_asked}", *more])
        assert result.exit_code == 0, result.output
        asked = [line for line in result.stderr.splitlines() if "say with --unit" in line]
        assert len(asked) == is_asked
        assert not is_asked or asked[0].startswith(
            "ambinav: note: house.ply: as metres its storey is"
        )


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_it_is_refused(folder: Path, case: Case) -> None:
    case.change(folder)
    before = inventory(folder)
    result = CliRunner().invoke(app, case.arguments)
    assert result.exit_code == 2, result.output
    file = () if "--fail-if" in case.named else (case.arguments[1],)
    check_refusal(result.stderr, result.stdout, (*file, *case.named))
    assert inventory(folder) == before
