"""`ambinav plan` as a user meets it: routes, pictures, figures, and what it says to bad input."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image
from typer.testing import CliRunner

import ambinav as an
from ambinav.cli import app
from ambinav.routes.files import load_route
from ambinav_planners import planners

ENDS = ("--start", "1", "1", "--goal", "10", "2")
PLAN = ("plan", "map.zarr", *ENDS, "--time", "0.3")
NO_WAY = ("plan", "map.zarr", "--start", "1", "1", "--goal", "14", "1", "--time", "0.2")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of a room with a corridor, and of a room that no door leads to."""
    floor = [(0, 0), (3, 0), (3, 1), (11, 1), (11, 2.5), (3, 2.5), (3, 3), (0, 3)]
    environment = an.environment_from_shapes(
        [shapely.Polygon(floor), shapely.box(13, 0, 15, 3)],
        openings=[shapely.LineString([(0, 1), (0, 2)])],
    )
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01), beams=36, aperture=math.tau
    )
    path = tmp_path_factory.mktemp("cli") / "map.zarr"
    an.build_map(environment, scanner, spacing=0.2).save(path)
    return path


@pytest.fixture
def folder(stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(stored, tmp_path / "map.zarr")
    (tmp_path / "notes.txt").write_text("not ours")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def runner() -> CliRunner:
    return CliRunner()


def files(folder: Path) -> set[str]:
    return {item.name for item in folder.iterdir()}


def is_picture(path: Path) -> bool:
    with Image.open(path) as picture:
        return min(picture.size) > 100 and len(set(picture.convert("L").resize((64, 64)).tobytes()))


@pytest.mark.parametrize("name", ["route.csv", "route.geojson", "route.json", "new/route.CSV"])
def test_a_route_is_written_and_loads_again(runner: CliRunner, folder: Path, name: str) -> None:
    result = runner.invoke(app, [*PLAN, "-o", name])
    assert result.exit_code == 0, result.output
    route = load_route(folder / name)
    np.testing.assert_allclose(route.poses[[0, -1], :2], [[1, 1], [10, 2]], atol=1e-9)
    assert (route.planner, route.weight, route.layer) == ("prmstar", 5.0, "level")
    assert f"{route.length:.2f} m" in result.stdout
    assert f"{route.cost:.2f} m" in result.stdout
    assert f"route: {name}" in result.stdout
    assert result.stderr == ""


def test_a_picture_and_the_shortest_route(runner: CliRunner, folder: Path) -> None:
    result = runner.invoke(app, [*PLAN, "-o", "r.csv", "--picture", "r.png", "--shortest"])
    assert result.exit_code == 0, result.output
    assert is_picture(folder / "r.png")
    assert "weight 5" in result.stdout
    assert "shortest" in result.stdout
    assert "picture: r.png" in result.stdout
    assert files(folder) == {"map.zarr", "notes.txt", "r.csv", "r.png"}


def test_json_prints_nothing_else(runner: CliRunner, folder: Path) -> None:
    result = runner.invoke(
        app, [*PLAN, "-o", "r.csv", "--picture", "r.svg", "--shortest", "--json", "-w", "2"]
    )
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert (told["output"], told["picture"]) == ("r.csv", "r.svg")
    assert set(told["routes"]) == {"weight 2", "shortest"}
    figures = told["routes"]["weight 2"]
    route = load_route(folder / "r.csv")
    assert figures["length"] == pytest.approx(route.length)
    assert figures["cost"] == pytest.approx(route.cost)
    assert sum(figures["zone_metres"].values()) == pytest.approx(route.length)
    assert told["routes"]["shortest"]["length"] <= route.length + 0.1


def test_a_front_fills_a_folder(runner: CliRunner, folder: Path) -> None:
    arguments = ("-o", "front", "--pareto", "--weights", "0 1, 5", "-p", "reference")
    for _ in range(2):  # the second replaces the first
        result = runner.invoke(app, [*PLAN, *arguments])
        assert result.exit_code == 0, result.output
    assert files(folder / "front") == {
        "pareto.csv", "pareto.json", "pareto.png", "routes.png",
        "route-0.csv", "route-1.csv", "route-5.csv",
    }  # fmt: skip
    rows = json.loads((folder / "front" / "pareto.json").read_text())
    assert [row["weight"] for row in rows] == [0.0, 1.0, 5.0]
    assert rows[2]["exposure_m"] <= rows[0]["exposure_m"] + 1e-6
    assert load_route(folder / "front" / "route-5.csv").weight == 5.0
    assert is_picture(folder / "front" / "pareto.png")
    told = runner.invoke(app, [*PLAN, *arguments, "--json"])
    assert json.loads(told.stdout)["points"] == rows
    assert files(folder) == {"map.zarr", "notes.txt", "front"}


def test_a_car_with_a_footprint(runner: CliRunner, folder: Path) -> None:
    result = runner.invoke(
        app,
        [
            *PLAN, "-o", "r.json", "--space", "reeds-shepp", "--turning-radius", "0.3",
            "--headings", "0", "3.1", "--footprint", "0.3,0.2 -0.2,0.2 -0.2,-0.2 0.3,-0.2",
            "--time", "1", "--clearance-weight", "1",
        ],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    route = load_route(folder / "r.json")
    assert (route.steering.space, route.steering.radius) == ("reeds-shepp", 0.3)
    assert route.poses[-1, 2] == pytest.approx(3.1)
    assert route.clearance_weight == 1.0


def test_seeds_and_iterations(runner: CliRunner, folder: Path) -> None:
    for name in ("a.csv", "b.csv"):
        arguments = ("-o", name, "--seed", "4", "--iterations", "300", "--time", "60")
        assert runner.invoke(app, [*PLAN, *arguments]).exit_code == 0
    one, two = (load_route(folder / name) for name in ("a.csv", "b.csv"))
    assert (one.poses == two.poses).all()
    assert one.seed == 4


BAD = {
    "start in a wall": (["--start", "2", "3.1"], "start (2, 3.1) is in a wall"),
    "start outside": (["--start", "-9", "1"], "start (-9, 1) is outside of the map"),
    "goal behind walls": (["--goal", "12", "1"], "goal (12, 1) is behind a wall"),
    "goal too near a wall": (["--goal", "10", "1.1"], "0.10 m from a wall, the footprint needs"),
    "start near unknown space": (["--start", "0.1", "1.5"], "0.10 m from unknown space"),
    "start nan": (["--start", "nan", "1"], "start is (nan, 1.0, 0.0)"),
    "too wide": (["--radius", "0.9"], "start (1, 1)"),
    "negative radius": (["--radius", "-0.2"], "radius is -0.2"),
    "negative weight": (["--weight", "-1"], "--weight: -1"),
    "weight nan": (["--weight", "nan"], "--weight: nan"),
    "unknown planner": (["--planner", "rrtstr"], "did you mean 'rrtstar'?"),
    "refused planner": (["--planner", "aorrtc"], "is refused: OMPL's AORRTC never calls"),
    "missing layer": (["--layer", "levle"], "'levle'"),
    "time 0": (["--time", "0"], "--time: 0"),
    "time negative": (["--time", "-1"], "--time: -1"),
    "time nan": (["--time", "nan"], "--time: nan"),
    "iterations 0": (["--iterations", "0"], "iterations is 0"),
    "seed 0": (["--seed", "0"], "seed is 0"),
    "unknown space": (["--space", "r3"], "space is 'r3'"),
    "no turning radius": (["--space", "dubins"], "turning radius"),
    "comfort 0": (["--comfort", "0"], "--comfort: 0"),
    "clearance weight": (["--clearance-weight", "-1"], "--clearance-weight: -1"),
    "limit 0": (["--max-bad-metres", "0"], "max_bad_metres is 0"),
    "limit refused": (["--max-bad-metres", "5", "-p", "fmt"], "cannot keep a limit"),
    "bad level": (["--max-bad-metres", "5", "--bad-level", "-1"], "bad_level is -1"),
    "bad footprint": (["--footprint", "0.3,0.2 x"], "--footprint: 'x' is not a corner"),
    "footprint of two": (["--footprint", "0,0 1,1"], "give at least three"),
    "bad suffix": (["-o", "route.txt"], "--output: route.txt ends in '.txt'"),
    "no suffix": (["-o", "route"], "--output: route ends in 'nothing'"),
    "bad picture": (["--picture", "r.bmp"], "--picture: r.bmp ends in '.bmp'"),
    "in a file": (["-o", "notes.txt/r.csv"], "notes.txt is a file, not a folder"),
    "picture in a file": (["--picture", "notes.txt/r.png"], "notes.txt is a file"),
    "bad weights": (["-o", "new", "--pareto", "--weights", "1 x"], "--weights: '1 x'"),
    "one weight": (["-o", "new", "--pareto", "--weights", "1"], "at least two"),
    "front in use": (["-o", "map.zarr", "--pareto"], "no folder of an earlier --pareto"),
    "front on a file": (["-o", "notes.txt", "--pareto"], "notes.txt"),
}


@pytest.mark.parametrize(("more", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_sentence_and_status_2(
    runner: CliRunner, folder: Path, more: list[str], message: str
) -> None:
    before = files(folder)
    result = runner.invoke(app, [*PLAN, "-o", "route.csv", *more])
    assert result.exit_code == 2, result.output
    errors = result.stderr.splitlines()
    assert len(errors) == 1
    assert errors[0].startswith("ambinav: error: ")
    assert message in errors[0]
    assert result.stdout == ""
    assert files(folder) == before


def test_maps_that_are_none(runner: CliRunner, folder: Path) -> None:
    for name in ("none.zarr", "notes.txt"):
        result = runner.invoke(app, ["plan", name, *ENDS, "-o", "r.csv"])
        assert result.exit_code == 2
        assert name in result.stderr
    assert files(folder) == {"map.zarr", "notes.txt"}


def test_wrong_usage(runner: CliRunner, folder: Path) -> None:
    for arguments in (["plan"], ["plan", "map.zarr"], [*PLAN], [*PLAN, "-o", "r.csv", "--start"]):
        assert runner.invoke(app, arguments).exit_code == 2


@pytest.mark.parametrize("more", [[], ["-p", "reference"], ["--pareto", "-p", "reference"]])
def test_no_way_is_drawn(runner: CliRunner, folder: Path, more: list[str]) -> None:
    output = "front" if "--pareto" in more else "route.csv"
    result = runner.invoke(app, [*NO_WAY, "-o", output, *more])
    assert result.exit_code == 2, result.output
    (error,) = result.stderr.splitlines()
    assert error.startswith(
        "ambinav: error: no way leads from the start (1, 1) to the goal (14, 1)"
    )
    picture = f"{Path(output).stem}-no-way.png"
    assert f"The parts are drawn in {picture}." in error
    assert is_picture(folder / picture)
    assert files(folder) == {"map.zarr", "notes.txt", picture}


def test_no_way_in_the_picture_asked_for(runner: CliRunner, folder: Path) -> None:
    result = runner.invoke(app, [*NO_WAY, "-o", "new/route.csv", "--picture", "parts.png"])
    assert result.exit_code == 2
    assert "drawn in parts.png." in result.stderr
    assert files(folder) == {"map.zarr", "notes.txt", "parts.png"}


def test_planners_are_listed(runner: CliRunner) -> None:
    result = runner.invoke(app, ["plan", "--list-planners"])
    assert result.exit_code == 0
    rows = {line.split()[0]: line for line in result.stdout.splitlines()}
    assert set(rows) == set(planners())
    assert "[r2]" in rows["reference"]


def test_help_shows_an_example(runner: CliRunner) -> None:
    text = " ".join(runner.invoke(app, ["plan", "--help"]).stdout.split())
    assert "Example: ambinav plan office.zarr --start 2 3 --goal 20 8" in text


def test_interrupted_leaves_nothing(
    runner: CliRunner, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ambinav_planners.planning import RoutePlanner

    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(RoutePlanner, "plan", interrupted)
    assert runner.invoke(app, [*PLAN, "-o", "r.csv"]).exit_code == 130
    assert files(folder) == {"map.zarr", "notes.txt"}
