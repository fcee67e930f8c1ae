"""`ambinav map` and `audit` of buildings in three dimensions: what they take, write and refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.demo import DEMO_BUILDING
from ambinav.maps.ambiguity_map import AmbiguityMap
from tests.buildings import plan_models

LIDAR = ["-s", "velodyne-vlp-16", "--spacing", "0.5", "--no-store"]
PLANAR = ["-s", "rplidar-a1", "--spacing", "0.25", "--no-store"]


@pytest.fixture
def runner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CliRunner:
    monkeypatch.chdir(tmp_path)
    return CliRunner()


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A closed room of 6 x 4 x 2.5 m as a file of triangles."""
    corners = [(x, y, z) for x in (0, 6) for y in (0, 4) for z in (0, 2.5)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(str(k + 1) for k in quad) for quad in quads]
    path = tmp_path / "room.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def house(tmp_path: Path) -> Path:
    return plan_models.two_storeys(tmp_path / "house.ifc")


@pytest.mark.slow
def test_a_plan_with_a_height(runner: CliRunner) -> None:
    result = runner.invoke(
        app, ["map", str(DEMO_BUILDING), *LIDAR, "--extrude", "2.5", "-o", "a.zarr"]
    )
    assert result.exit_code == 0, result.output
    amap = AmbiguityMap.open("a.zarr")
    assert amap.dataset.attrs["environment_space"]
    assert json.loads(amap.dataset.attrs["parameters"])["beams_used"] == 360


@pytest.mark.slow
def test_a_level_scanner_in_an_extruded_plan_gets_the_map_of_the_plan(runner: CliRunner) -> None:
    raised = ["--extrude", "2.5", "--scanner-height", "0.4"]
    for options, output in (([], "flat.zarr"), (raised, "solid.zarr")):
        done = runner.invoke(app, ["map", str(DEMO_BUILDING), *PLANAR, *options, "-o", output])
        assert done.exit_code == 0, done.output
    flat, solid = (AmbiguityMap.open(one).dataset["level"].values for one in
                   ("flat.zarr", "solid.zarr"))  # fmt: skip
    assert np.nanmax(np.abs(flat - solid)) < 0.02


@pytest.mark.sweep
def test_a_mesh_and_a_plan_with_a_height_in_tiles(runner: CliRunner, room: Path) -> None:
    high = [*PLANAR, "--scanner-height", "0.3"]
    for building, space in ((room, ["--floor", "0"]), (DEMO_BUILDING, ["--extrude", "2.5"])):
        coarse = [*high, *space, "--spacing", "0.45"]
        tiles = ["--tile", "6.3", "--workers", "0"]
        found = []
        for options, output in (([], "whole.zarr"), (tiles, "tiles.zarr")):
            done = runner.invoke(app, ["map", str(building), *coarse, *options, "-o", output])
            assert done.exit_code == 0, done.output
            found.append(AmbiguityMap.open(output).dataset.assign_attrs(created=""))
        assert found[0].identical(found[1])


def test_a_mesh(runner: CliRunner, room: Path) -> None:
    high = [*PLANAR, "--scanner-height", "0.3", "--floor", "0"]
    result = runner.invoke(app, ["map", str(room), *high, "-o", "room.zarr", "--json"])
    assert result.exit_code == 0, result.output
    assert 20.0 < json.loads(result.stdout)["free_area_m2"] < 25.0


@pytest.mark.sweep
@pytest.mark.parametrize("suffix", ["xyz", "txt", "ply"])
def test_a_point_cloud(runner: CliRunner, tmp_path: Path, suffix: str) -> None:
    rng, size = np.random.default_rng(1), np.array((6.0, 4.0, 2.5))
    rows = rng.random((120_000, 3)) * size
    # Each on one of the six sides.
    axis = rng.integers(0, 3, len(rows))
    rows[np.arange(len(rows)), axis] = size[axis] * rng.integers(0, 2, len(rows))
    path = tmp_path / f"room.{suffix}"
    if suffix == "ply":
        head = "ply\nformat binary_little_endian 1.0\nelement vertex 120000\n"
        head += "".join(f"property double {a}\n" for a in "xyz") + "end_header\n"
        path.write_bytes(head.encode() + rows.tobytes())
    else:
        np.savetxt(path, rows, fmt="%.4f")
    options = ["--scanner-height", "0.3", "--voxel", "0.1", "--voxel-points", "2"]
    done = runner.invoke(app, ["map", str(path), *PLANAR, *options, "-o", "a.zarr", "--json"])
    assert done.exit_code == 0, done.output
    assert 20.0 < json.loads(done.stdout)["free_area_m2"] < 25.0
    notes = AmbiguityMap.open("a.zarr").dataset.attrs["environment_notes"]
    assert "120000 points in" in notes and "voxels of 0.1 m" in notes


@pytest.mark.slow(kept=("velodyne-vlp-16",))
@pytest.mark.parametrize("preset", ["velodyne-vlp-16", "livox-mid-360"])
def test_a_building_model_in_space(runner: CliRunner, house: Path, preset: str) -> None:
    options = [str(house), "--level", "Ground", "-s", preset, "--spacing", "0.5", "--no-store"]
    done = runner.invoke(app, ["map", *options, "--in-space", "-o", "a.zarr"])
    assert done.exit_code == 0, done.output
    attrs = AmbiguityMap.open("a.zarr").dataset.attrs
    assert attrs["environment_space"]
    assert "in space: " in attrs["environment_notes"]
    flat = runner.invoke(app, ["map", *options, "-o", "b.zarr"])
    assert flat.exit_code == 2
    assert "`--in-space` for those of an .ifc file" in " ".join(flat.output.split())


@pytest.mark.sweep
def test_the_audit_of_a_building_model_in_space(runner: CliRunner, house: Path) -> None:
    options = ["--level", "0", "--in-space", "--places", "1", "--no-aliasing", "-o", "out"]
    result = runner.invoke(app, ["audit", str(house), *LIDAR, *options])
    assert result.exit_code == 0, result.output
    report = json.loads(Path("out/report.json").read_text())
    assert any("in space: " in note for note in report["environment"]["notes"])


@pytest.mark.slow
@pytest.mark.usefixtures("coarse_pictures")
def test_the_audit_of_a_building_in_space(runner: CliRunner) -> None:
    options = [*LIDAR, "--extrude", "2.5", "--places", "1", "--no-aliasing", "-o", "out"]
    result = runner.invoke(app, ["audit", str(DEMO_BUILDING), *options, "--posts", "2"])
    assert result.exit_code == 0, result.output
    report = json.loads(Path("out/report.json").read_text())
    assert report["helps"]["asked"] == 2
    assert "beams return an echo" in report["places"][0]["sees"]["sentence"]


def compared(runner: CliRunner, building: Path, *options: str) -> dict[str, dict[str, object]]:
    """The rows of `design scanners`, by scanner."""
    quick = ["--spacing", "0.5", "--no-store", "--pairs", "2", "--json"]
    result = runner.invoke(app, ["design", "scanners", str(building), *quick, *options])
    assert result.exit_code == 0, result.output
    return {one["name"]: one for one in json.loads(result.stdout)["scanners"]}


TWO = ["-s", "rplidar-a1", "-s", "velodyne-vlp-16"]


@pytest.mark.slow(kept=("extra1-0.8",))
@pytest.mark.parametrize(
    ("extra", "height"), [([], "z: 0.3"), (["--scanner-height", "0.8"], "0.8")]
)
def test_planar_and_3d_scanners_side_by_side(
    runner: CliRunner, house: Path, extra: list[str], height: str
) -> None:
    rows = compared(runner, house, "--level", "0", "--in-space", *TWO, *extra)
    assert set(rows) == {"rplidar-a1", "velodyne-vlp-16"}
    assert height in str(rows["rplidar-a1"]["yaml"])
    assert "z: 0.5" in str(rows["velodyne-vlp-16"]["yaml"])
    assert all(float(str(row["mean_error_m"])) > 0.0 for row in rows.values())


@pytest.mark.slow
def test_scanners_in_an_extruded_plan_and_in_a_mesh(runner: CliRunner, room: Path) -> None:
    assert len(compared(runner, DEMO_BUILDING, *TWO, "--extrude", "2.5")) == 2
    assert len(compared(runner, room, *TWO, "--floor", "0")) == 2


@pytest.mark.parametrize(("options", "part"), [
    ([*LIDAR], "it is a plan, and the scanner looks up and down"),
    ([*PLANAR, "--extrude", "2.5"], "at z = 0 m, on its floor"),
    ([*PLANAR, "--extrude", "0"], "--extrude: 0 is not above zero"),
    ([*PLANAR, "--scanner-height", "-1"], "--scanner-height: -1 is not above zero"),
    ([*PLANAR, "--in-space"], "in_space means nothing for a drawn plan"),
    ([*LIDAR, "--in-space", "--extrude", "2"], "leave one of the two out"),
    ([*PLANAR, "--floor", "0"], "--floor: "),
    ([*PLANAR, "--robot-height", "1"], "is not a mesh"),
    ([*PLANAR, "--voxel", "0.1"], "is not a point cloud"),
    ([*PLANAR, "--voxel", "0"], "--voxel: 0 is not above zero"),
    ([*LIDAR, "--extrude", "2.5", "--layers", "gfm"], "gfm: it looks up and down"),
])  # fmt: skip
def test_refused_for_a_plan(runner: CliRunner, options: list[str], part: str) -> None:
    result = runner.invoke(app, ["map", str(DEMO_BUILDING), *options, "-o", "a.zarr"])
    assert result.exit_code == 2
    assert part in result.output
    assert not Path("a.zarr").exists()


@pytest.mark.parametrize(("options", "part"), [
    ([], "does not say how high it is mounted; give --scanner-height"),
    (["--scanner-height", "0.3", "--extrude", "2"], "has three dimensions already"),
    (["--scanner-height", "0.3", "--in-space"], "--in-space: "),
    (["--scanner-height", "0.3", "--up", "w"], "up is 'w'"),
    (["--scanner-height", "0.3", "--floor", "9"], "floor is 9"),
    (["--scanner-height", "0.3", "--voxel-points", "2"], "is not a point cloud"),
])  # fmt: skip
def test_refused_for_a_mesh(runner: CliRunner, room: Path, options: list[str], part: str) -> None:
    result = runner.invoke(app, ["map", str(room), *PLANAR, *options, "-o", "a.zarr"])
    assert result.exit_code == 2
    assert part in result.output
