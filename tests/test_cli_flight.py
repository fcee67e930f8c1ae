"""`ambinav map --heights` and `ambinav plan --space r3` as a user meets them."""

from __future__ import annotations

import csv
import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.cli.positions import joined
from ambinav.cli.volume_options import VolumeOptions
from ambinav.maps.ambiguity_volume import AmbiguityVolume
from tests.buildings import plan_models

# Two rooms with a door.
FLOOR = shapely.box(0, 0, 6, 4) - shapely.box(2.9, 0, 3.1, 2.6)
MAP = ("map", "rooms.wkt", "-s", "rplidar-a1", "--spacing", "0.4", "--no-store")
HIGH = ("--extrude", "2.4", "--heights", "0.5:1.9:0.7", "--robot-radius", "0.15")
ENDS = ("--start", "1", "1", "0.6", "--goal", "5", "1", "1.7")
PLAN = ("plan", "v.zarr", "--space", "r3", *ENDS, "--time", "20", "--iterations", "1500")
BUDGET = ("--seed", "1", "--planner", "informed-rrtstar")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan, its volume and its map."""
    folder = tmp_path_factory.mktemp("flight")
    (folder / "rooms.wkt").write_text(FLOOR.wkt)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = CliRunner().invoke(app, [*MAP, *HIGH, "-o", "v.zarr"])
        assert done.exit_code == 0, done.output
        assert "at 3 heights from z = 0.5 to 1.9 m" in done.stdout
        assert "volume: v.zarr" in done.stdout
        flat = CliRunner().invoke(app, [*MAP, "-o", "flat.zarr"])
        assert flat.exit_code == 0, flat.output
    return folder


@pytest.fixture
def runner(folder: Path, monkeypatch: pytest.MonkeyPatch) -> CliRunner:
    monkeypatch.chdir(folder)
    return CliRunner()


@pytest.mark.sweep
def test_a_flight_is_certified(runner: CliRunner) -> None:
    done = runner.invoke(app, [*PLAN, *BUDGET, "--weight", "1", "--certify", "-o", "c.csv"])
    assert done.exit_code == 0, done.output
    text = " ".join(done.stdout.split())
    proved = re.search(r"certified: no route costs less than (\S+), so this one, (\S+), is", text)
    assert proved is not None
    bound, cost = map(float, proved.groups())
    assert 0.7 * cost < bound <= cost


@pytest.mark.slow
def test_a_route_from_the_file_alone(runner: CliRunner, folder: Path) -> None:
    (folder / "rooms.wkt").rename(folder / "moved.wkt")
    try:
        done = runner.invoke(app, [*PLAN, *BUDGET, "-o", "r.csv", "--picture", "r.png", "--json"])
    finally:
        (folder / "moved.wkt").rename(folder / "rooms.wkt")
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert (document["output"], document["picture"]) == ("r.csv", "r.png")
    figures = document["routes"]["weight 5"]
    lines = (folder / "r.csv").read_text().splitlines()
    written = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# "))
    assert {name: json.loads(value) for name, value in written.items()} == figures
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert list(rows[0]) == ["x", "y", "z", "distance", "cost", "level"]
    points = np.array([[float(row[name]) for name in "xyz"] for row in rows])
    np.testing.assert_allclose(points[[0, -1]], [[1, 1, 0.6], [5, 1, 1.7]], atol=1e-9)
    # The plan's walls, which reach from floor to ceiling, are a disc away.
    assert shapely.LineString(points[:, :2]).distance(FLOOR.boundary) >= 0.15 - 1e-6
    assert points[:, 2].min() >= 0.5 and points[:, 2].max() <= 1.9
    length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(points))
    assert figures["length_m"] == pytest.approx(length) == float(rows[-1]["distance"])
    assert figures["cost"] == pytest.approx(float(rows[-1]["cost"]))
    assert figures["cost"] == pytest.approx(length * (1 + 5 * figures["mean_level"]), rel=1e-5)
    assert figures["curve"][-1][1] == pytest.approx(figures["cost"], rel=1e-5)
    assert (folder / "r.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_path_message_and_a_table(runner: CliRunner, folder: Path) -> None:
    done = runner.invoke(app, [*PLAN, "--time", "0.5", "-w", "0", "-o", "r.json"])
    assert done.exit_code == 0, done.output
    assert "weight 0" in done.stdout and "route: r.json" in done.stdout
    message = json.loads((folder / "r.json").read_text())
    places = [entry["pose"]["position"] for entry in message["poses"]]
    points = message["ambinav"]["points"]
    assert places == [{name: point[name] for name in "xyz"} for point in points]
    assert message["ambinav"]["cost"] == pytest.approx(message["ambinav"]["length_m"])
    # It may be planned anew, and a plan of the floor may take its place; other files stay.
    assert runner.invoke(app, [*PLAN, "--time", "0.5", "-o", "r.json"]).exit_code == 0
    flat = runner.invoke(app, ["plan", "flat.zarr", *FLAT_ENDS[:-1], "r.json"])
    assert flat.exit_code == 0, flat.output
    (folder / "r.json").write_text("{}")
    done = runner.invoke(app, [*PLAN, "-o", "r.json"])
    assert done.exit_code == 2 and "exists and is not a route" in done.stderr
    assert (folder / "r.json").read_text() == "{}"
    (folder / "r.json").unlink()


def test_a_flat_robot(runner: CliRunner) -> None:
    """A disc of 0.65 m and 0.2 m high passes the door 1.4 m wide, where such a sphere cannot."""
    flat = ("--robot-radius", "0.65", "--half-height", "0.1", "--time", "2", "-w", "0", "--json")
    done = runner.invoke(app, [*PLAN, *flat, "-o", "r.csv"])
    assert done.exit_code == 0, done.output
    figures = json.loads(done.stdout)["routes"]["weight 0"]
    assert (figures["robot_radius_m"], figures["half_height_m"]) == (0.65, 0.1)
    floor = runner.invoke(app, ["plan", "flat.zarr", *FLAT_ENDS, "--half-height", "0.1"])
    assert (floor.exit_code, "--half-height is for --space r3" in floor.stderr) == (2, True)


BAD = {
    "two numbers": (["--start", "1", "1"], "--start: '1 1' is not 3 numbers; give --start X Y Z"),
    "a letter": (["--goal", "5", "a", "1"], "--goal: '5 a 1' is not 3 numbers"),
    "too high": (["--goal=5", "1", "2.1"], "z is 2.1 m and v.zarr covers heights from 0.5 to 1.9"),
    "in a wall": (["--start", "3", "1", "1"], "or in a wall; the nearest free place is ("),
    "near the floor": (["--robot-radius", "0.65"], "nearer to a surface than the radius of 0.65 m"),
    "via": (["--via", "2,2"], "--via is for robots on the floor"),
    "promise": (["--max-lost", "0.1"], "--max-lost is for robots on the floor"),
    "front": (["--pareto"], "--pareto is for robots on the floor"),
    "graph": (["--from-graph", "g.json"], "--from-graph is for robots on the floor"),
    "lanes": (["--one-way", "l.json"], "--one-way is for robots on the floor"),
    "speed": (["--max-speed", "1"], "--max-speed is for robots on the floor"),
    "walls": (["--clearance-weight", "1"], "--clearance-weight is for robots on the floor"),
    "planner": (
        ["--planner", "reference"],
        "--planner is 'reference', which does not plan in space",
    ),
    "layer": (["--layer", "zone"], "--layer is 'zone'; give one of"),
    "start": (["--start", "3", "1", "1"], "error: --start (3, 1, 1) is nearer to a surface than"),
    "nan": (["--start", "nan", "1", "1"], "--start: 'nan 1 1' is not finite; give --start X Y Z"),
    "trust": (["--trust"], "--trust is for robots on the floor"),
    "weight": (["--weight", "-1"], "--weight: -1 is not zero or above"),
    "file": (["-o", "r.geojson"], "r.geojson ends in '.geojson'; give a file that ends in .csv"),
    "picture": (["--picture", "r.gif"], "r.gif ends in '.gif'"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_flights(runner: CliRunner, folder: Path, case: str) -> None:
    options, message = BAD[case]
    before = {item.name for item in folder.iterdir()}
    result = runner.invoke(app, [*PLAN, "-o", "bad.csv", *options])
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert {item.name for item in folder.iterdir()} == before


FLAT_ENDS = ("--start", "1", "1", "--goal", "5", "1", "-o", "r.csv")
OTHER = {
    "map in space": (["plan", "flat.zarr", "--space", "r3", *ENDS, "-o", "r.csv"],
                     "flat.zarr: this is an ambiguity map of one height, and a volume is needed"),
    "volume on the floor": (["plan", "v.zarr", *FLAT_ENDS],
                            "v.zarr: this is an ambiguity volume, over several heights"),
    "three numbers": (["plan", "flat.zarr", *FLAT_ENDS, "--start", "1", "1", "1"],
                      "'1 1 1' is not 2 numbers; give --start X Y in metres; three are for"),
    "export": (["export", "v.zarr", "--to", "npz", "-o", "a.npz"], "plan in it with `ambinav plan"),
    "diff": (["diff", "v.zarr", "flat.zarr"], "v.zarr: this is an ambiguity volume"),
    "serve": (["serve", "v.zarr"], "v.zarr: this is an ambiguity volume"),
    "plan": ([*MAP, "--heights", "0.5,1.2", "-o", "a.zarr"],
             "--heights: rooms.wkt is a plan, without heights; give --extrude"),
    "tiles": ([*MAP, *HIGH, "--tile", "9", "-o", "a.zarr"], "--tile is for a robot on the floor"),
    "raised": ([*MAP, *HIGH, "--scanner-height", "1", "-o", "a.zarr"], "--scanner-height is for"),
    "in the ceiling": ([*MAP, *HIGH, "--heights", "1,2.3", "-o", "a.zarr"], "the ceiling at 2.4 m"),
}  # fmt: skip


@pytest.mark.parametrize("case", OTHER)
def test_maps_and_volumes_of_no_use(runner: CliRunner, folder: Path, case: str) -> None:
    arguments, message = OTHER[case]
    before = {item.name for item in folder.iterdir()}
    result = runner.invoke(app, arguments)
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert {item.name for item in folder.iterdir()} == before


@pytest.mark.parametrize("text", ["0.5", "0.5:1.9", "2:1:0.5", "1,a", "0:1:0", "0:nan:1", "1:2:3"])
def test_heights_of_no_use(runner: CliRunner, text: str) -> None:
    result = runner.invoke(app, [*MAP, *HIGH, "--heights", text, "-o", "a.zarr"])
    assert result.exit_code == 2, result.output
    assert f"--heights: {text!r} is not a row of two or more heights" in result.stderr


def test_heights() -> None:
    for text in ("0.5:1.9:0.35", "0.5,0.85,1.2,1.55,1.9"):
        assert VolumeOptions(heights=text).values() == pytest.approx([0.5, 0.85, 1.2, 1.55, 1.9])
    assert VolumeOptions(heights="0.3:0.9:0.1").values() == pytest.approx(np.arange(3, 10) / 10)
    assert VolumeOptions(heights="1:2:0.3").values() == pytest.approx([1.0, 1.3, 1.6, 1.9])


def test_heights_that_end_below_the_last_one_are_named(runner: CliRunner) -> None:
    result = runner.invoke(
        app, [*MAP, "--extrude", "2.4", "--heights", "0.5:1.9:0.8", "--tile", "5", "-o", "a.zarr"]
    )
    assert "note: --heights: the steps end at 1.3 m, not at 1.9 m." in result.stderr


def test_positions_of_two_and_three_numbers() -> None:
    for given, made in (
        ("m --start 1 -2 --goal 3 4 5 -o r", "m|--start=1 -2|--goal=3 4 5|-o|r"),
        ("--start=1 2 m --goal 3 4", "--start=1 2|m|--goal=3 4"),
        ("--start 1 --goal 3 4 m", "--start=1|--goal=3 4|m"),
        ("--start", "--start"),
        ("--weight 1 2 3", "--weight|1|2|3"),
    ):
        assert joined(given.split()) == made.split("|")


@pytest.mark.slow
def test_the_volume_of_a_building_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    house = str(plan_models.two_storeys(tmp_path / "house.ifc"))
    options = ["--level", "Ground", "--in-space", "--heights", "0.6,1.2", "--spacing", "0.5"]
    arguments = ["map", house, "-s", "livox-mid-360", *options, "--no-store", "--json", "-o", "h"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert [row["z_m"] for row in document["heights"]] == [0.6, 1.2]
    assert document["robot_radius_m"] == 0.2
    volume = AmbiguityVolume.open("h")
    assert len(volume.surfaces) == document["triangles"] > 10
    assert [row["cells"] for row in document["heights"]] == volume.free.sum(axis=(1, 2)).tolist()
