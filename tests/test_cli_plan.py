"""`ambinav plan` as a user meets it: routes, pictures, figures, and what it says to bad input."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.cli.speed_options import SpeedOptions
from ambinav.forecasting.braking import BrakingRule
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.clock import SpeedLimits
from ambinav.routes.files import load_route
from ambinav_planners import planners

ENDS = ("--start", "1", "1", "--goal", "10", "2")
PLAN = ("plan", "map.zarr", *ENDS)
NO_PATH = ("plan", "map.zarr", "--start", "1", "1", "--goal", "14", "1")


@pytest.fixture
def runner() -> CliRunner:
    return CliRunner()


def files(folder: Path) -> set[str]:
    return {item.name for item in folder.iterdir()}


def is_picture(path: Path) -> bool:
    with Image.open(path) as picture:
        return min(picture.size) > 100 and len(set(picture.convert("L").tobytes())) > 4


@pytest.mark.parametrize("name", ["route.csv", "route.geojson", "route.json", "new/route.CSV"])
def test_a_route_is_written_and_loads_again(
    runner: CliRunner, plan_folder: Path, name: str
) -> None:
    result = runner.invoke(app, [*PLAN, "-o", name])
    assert result.exit_code == 0, result.output
    route = load_route(plan_folder / name)
    np.testing.assert_allclose(route.poses[[0, -1], :2], [[1, 1], [10, 2]], atol=1e-9)
    assert (route.planner, route.weight, route.layer) == ("reference", 5.0, "level")
    assert f"{route.length:.2f} m" in result.stdout
    assert f"{route.cost:.2f} m" in result.stdout
    assert f" {route.corridor_metres:.1f} ({route.longest_corridor:.1f}) " in result.stdout
    assert f" {route.open_metres:.1f} ({route.longest_open:.1f}) " in result.stdout
    assert f"route: {name}" in result.stdout
    assert result.stderr == ""
    again = runner.invoke(app, [*PLAN, "-o", name])
    assert again.exit_code == 0, again.output


@pytest.mark.slow
def test_the_stretch_that_a_limit_counts_is_printed(runner: CliRunner, plan_folder: Path) -> None:
    """Against the map's level each 5 mm along the route."""
    words = [*PLAN, "--max-bad-metres", "50", "--bad-level", "0.3", "-w", "0", "-o", "route.csv"]
    result = runner.invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    (figures,) = json.loads(result.stdout)["routes"].values()
    route, amap = load_route(plan_folder / "route.csv"), AmbiguityMap.open(plan_folder / "map.zarr")
    path = shapely.LineString(route.poses[:, :2])
    along = np.arange(0.0, path.length, 0.005)
    level = np.asarray(amap.sample("level", *shapely.get_coordinates(path.interpolate(along)).T))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], level > 0.3, [False]]).astype(int)))
    longest = 0.005 * (edges[1::2] - edges[::2]).max()
    assert longest > 0.5
    assert figures["longest_above_level_m"] == pytest.approx(longest, abs=0.03)
    said = runner.invoke(app, words).stdout
    assert f"at most {figures['longest_above_level_m']:.2f} m in a row are above level 0.3" in said


@pytest.mark.parametrize("name", ["hall.geojson", "costs.json", "sites.csv"])
def test_a_file_that_is_no_route_is_not_replaced(
    runner: CliRunner, plan_folder: Path, name: str
) -> None:
    kept = b'{"type": "Polygon", "coordinates": []}\n'
    (plan_folder / name).write_bytes(kept)
    result = runner.invoke(app, [*PLAN, "-o", name])
    assert result.exit_code == 2, result.output
    assert f"{name} exists and is not a route; give another name" in " ".join(result.stderr.split())
    assert (plan_folder / name).read_bytes() == kept


@pytest.mark.slow
def test_a_picture_and_the_shortest_route(runner: CliRunner, plan_folder: Path) -> None:
    result = runner.invoke(app, [*PLAN, "-o", "r.csv", "--picture", "new/r.png", "--shortest"])
    assert result.exit_code == 0, result.output
    assert is_picture(plan_folder / "new" / "r.png")
    assert "weight 5" in result.stdout
    assert "shortest" in result.stdout
    assert "picture: new/r.png" in result.stdout
    assert files(plan_folder) == {"map.zarr", "notes.txt", "r.csv", "new"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["r.svg", "r.pdf", "r.PNG"])
def test_kinds_of_pictures(runner: CliRunner, plan_folder: Path, name: str) -> None:
    result = runner.invoke(app, [*PLAN, "-o", "r.csv", "--picture", name, "-p", "reference"])
    assert result.exit_code == 0, result.output
    start = {"svg": b"<?xml", "pdf": b"%PDF", "PNG": b"\x89PNG"}[name[2:]]
    assert (plan_folder / name).read_bytes().startswith(start)


@pytest.mark.slow
def test_json_prints_nothing_else(runner: CliRunner, plan_folder: Path) -> None:
    result = runner.invoke(
        app, [*PLAN, "-o", "r.csv", "--picture", "r.svg", "--shortest", "--json", "-w", "2"]
    )
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert (report["output"], report["picture"]) == ("r.csv", "r.svg")
    assert set(report["routes"]) == {"weight 2", "shortest"}
    figures = report["routes"]["weight 2"]
    route = load_route(plan_folder / "r.csv")
    assert figures["length_m"] == pytest.approx(route.length)
    assert figures["cost"] == pytest.approx(route.cost)
    zones = ("localizable_m", "transition_m", "corridor_m", "open_m")
    assert sum(figures[zone] for zone in zones) == pytest.approx(route.length)
    assert report["routes"]["shortest"]["length_m"] <= route.length + 0.1


def test_the_help_shows_the_default_limits() -> None:
    text = " ".join((SpeedOptions.__doc__ or "").split())
    for name in ("max_speed", "acceleration", "max_turn_rate"):
        shown = re.split(rf" {name}(?: \(M/S\))?: ", text)[1].split("[default: ")[1].split("]")[0]
        assert float(shown) == getattr(SpeedLimits(), name)
    assert f"[default: {BrakingRule.creep}]" in text


@pytest.mark.slow
def test_stamps_keep_to_the_speed_options(runner: CliRunner, plan_folder: Path) -> None:
    durations = []
    for words in ((), ("--max-speed", "0.2", "--stop-sigmas", "3")):
        result = runner.invoke(app, [*PLAN, *words, "-o", "r.json", "--json"])
        assert result.exit_code == 0, result.output
        figures = json.loads(result.stdout)["routes"]["weight 5"]
        route = load_route(plan_folder / "r.json")
        assert figures["duration_s"] == route.duration == route.stamps[-1]
        assert figures["speed_limits"]["max_speed"] == (0.2 if words else 0.5)
        speed = np.diff(route.distance) / np.diff(route.stamps)
        assert speed.max() <= figures["speed_limits"]["max_speed"] + 1e-9
        durations.append(route.duration)
    assert durations[1] > 2.0 * durations[0]
    assert 0.0 < figures["creep_m"] < route.length
    result = runner.invoke(
        app, [*PLAN, "--stop-sigmas", "3", "--creep-speed", "0.3", "-o", "r.csv"]
    )
    assert " m leave no room to stop at 3 standard deviations, driven at 0.3 m/s" in result.stdout


@pytest.mark.slow
def test_a_certificate_is_printed_and_in_the_json(runner: CliRunner, plan_folder: Path) -> None:
    result = runner.invoke(app, [*PLAN, "-o", "r.csv", "--certify"])
    assert result.exit_code == 0, result.output
    assert "weight 5: certified: no route costs less than" in " ".join(result.stdout.split())
    result = runner.invoke(app, [*PLAN, "-o", "r.csv", "--shortest", "--certify", "--json"])
    for route in json.loads(result.stdout)["routes"].values():
        assert 0.0 < route["bound"] <= route["cost"]
        assert route["gap"] == pytest.approx((route["cost"] - route["bound"]) / route["cost"])
        assert route["gap"] < 0.1
    assert load_route(plan_folder / "r.csv").cost > 0.0


@pytest.mark.slow
def test_a_front_fills_a_folder(runner: CliRunner, plan_folder: Path) -> None:
    weights = "0 1, 5 5.0000000000001"
    arguments = ("-o", "front", "--pareto", "--weights", weights, "-p", "reference")
    result = runner.invoke(app, [*PLAN, *arguments])
    assert result.exit_code == 0, result.output
    assert files(plan_folder / "front") == {
        "pareto.csv", "pareto.json", "pareto.png", "routes.png",
        "route-0.csv", "route-1.csv", "route-5.csv",
    }  # fmt: skip
    rows = json.loads((plan_folder / "front" / "pareto.json").read_text())
    assert [row["weight"] for row in rows] == [0.0, 1.0, 5.0]
    assert all(row["duration_s"] > row["length_m"] / 0.5 for row in rows)
    assert rows[2]["exposure_m"] <= rows[0]["exposure_m"] + 1e-6
    assert load_route(plan_folder / "front" / "route-5.csv").weight == 5.0
    assert is_picture(plan_folder / "front" / "pareto.png")
    made = files(plan_folder / "front")
    again = runner.invoke(app, [*PLAN, *arguments, "--json"])  # replaces the first
    assert json.loads(again.stdout)["points"] == rows
    assert files(plan_folder / "front") == made
    assert files(plan_folder) == {"map.zarr", "notes.txt", "front"}


@pytest.mark.slow
def test_the_shortest_route_is_that_whatever_else_costs(
    runner: CliRunner, plan_folder: Path
) -> None:
    (plan_folder / "p.wkt").write_text("POLYGON ((0 0, 2 0, 2 3, 0 3, 0 0))")
    lengths = []
    for more in ([], ["--clearance-weight", "5", "--comfort", "1"], ["--prefer", "p.wkt"]):
        result = runner.invoke(app, [*PLAN, "-o", "r.csv", "--shortest", "--json", *more])
        assert result.exit_code == 0, result.output
        shortest = json.loads(result.stdout)["routes"]["shortest"]
        assert shortest["cost"] == pytest.approx(shortest["length_m"])
        lengths.append(shortest["length_m"])
    assert lengths == pytest.approx([lengths[0]] * 3)


@pytest.mark.slow
def test_a_car_with_a_footprint(runner: CliRunner, plan_folder: Path) -> None:
    result = runner.invoke(
        app,
        [
            *PLAN, "-o", "r.json", "--space", "reeds-shepp", "--turning-radius", "0.3",
            "--start-heading", "90", "--goal-heading", "180",
            "--time", "inf", "--iterations", "500",
            "--footprint", "0.3,0.2 -0.2,0.2 -0.2,-0.2 0.3,-0.2", "--clearance-weight", "1",
        ],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    route = load_route(plan_folder / "r.json")
    assert (route.steering.space, route.steering.radius) == ("reeds-shepp", 0.3)
    # Degrees, as everything that people write; routes hold radians.
    assert route.poses[0, 2] == pytest.approx(np.pi / 2)
    assert abs(route.poses[-1, 2]) == pytest.approx(np.pi)
    assert route.clearance_weight == 1.0


@pytest.mark.sweep
def test_seeds_and_iterations(runner: CliRunner, plan_folder: Path) -> None:
    for name in ("a.csv", "b.csv"):
        arguments = ("-o", name, "--seed", "4", "--iterations", "300", "--time", "inf")
        assert runner.invoke(app, [*PLAN, *arguments]).exit_code == 0
    one, two = (load_route(plan_folder / name) for name in ("a.csv", "b.csv"))
    assert (one.poses == two.poses).all()
    assert one.seed == 4


@pytest.mark.slow
@pytest.mark.parametrize("more", [[], ["-p", "reference"], ["--pareto", "-p", "reference"]])
def test_no_path_is_drawn(runner: CliRunner, plan_folder: Path, more: list[str]) -> None:
    output = "front" if "--pareto" in more else "route.csv"
    result = runner.invoke(app, [*NO_PATH, "-o", output, *more])
    assert result.exit_code == 2, result.output
    (error,) = result.stderr.splitlines()
    assert error.startswith(
        "ambinav: error: no path leads from the start (1, 1) to the goal (14, 1)"
    )
    picture = f"{Path(output).stem}-no-path.png"
    assert f"The parts are drawn in {picture}." in error
    assert is_picture(plan_folder / picture)
    assert files(plan_folder) == {"map.zarr", "notes.txt", picture}


@pytest.mark.slow
def test_no_path_in_the_picture_asked_for(runner: CliRunner, plan_folder: Path) -> None:
    result = runner.invoke(app, [*NO_PATH, "-o", "new/route.csv", "--picture", "parts.pdf"])
    assert result.exit_code == 2
    assert "drawn in parts.pdf." in result.stderr
    assert files(plan_folder) == {"map.zarr", "notes.txt", "parts.pdf"}


@pytest.mark.slow
def test_no_path_beside_an_output_in_a_new_folder(runner: CliRunner, plan_folder: Path) -> None:
    result = runner.invoke(app, [*NO_PATH, "-o", "new/route.csv"])
    assert result.exit_code == 2, result.output
    assert "drawn in new/route-no-path.png." in result.stderr
    assert files(plan_folder / "new") == {"route-no-path.png"}


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
    runner: CliRunner, plan_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ambinav_planners.planning import RoutePlanner

    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(RoutePlanner, "plan", interrupted)
    assert runner.invoke(app, [*PLAN, "-o", "r.csv"]).exit_code == 130
    assert files(plan_folder) == {"map.zarr", "notes.txt"}


@pytest.mark.slow
def test_stops_in_the_cheapest_order(runner: CliRunner, plan_folder: Path) -> None:
    words = ["--via", "10,2 2,1", "--any-order", "--or-goal", "2,2", "--picture", "m.png"]
    result = runner.invoke(app, [*PLAN, *words, "-o", "m.csv", "--json"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    mission = document["mission"]
    # From (1, 1) over (2, 1) to (10, 2), which is the goal too.
    assert (mission["order"], mission["goal"], mission["gap"]) == ([1, 0], 0, 0.0)
    route = load_route(plan_folder / "m.csv")
    assert mission["arrivals"][1] == pytest.approx(route.length)
    assert document["routes"]["weight 5"]["length_m"] == pytest.approx(route.length)
    assert is_picture(plan_folder / "m.png")
    result = runner.invoke(app, [*PLAN, *words[:3], "-o", "m.csv"])
    first, last, end = document["mission"]["stamps"][0], route.stamps[-2], route.duration
    assert 1.0 / 0.5 < first < last <= end  # seconds; the second stop is the goal
    twice = runner.invoke(
        app, [*PLAN, "--via", "10,2", "--via", "2,1", "--any-order", "-o", "m.csv"]
    )
    assert "stop 1 at (2, 1) m" in twice.stdout and "stop 2 at (10, 2) m" in twice.stdout
    wanted = f"stop 1 at (2, 1) m: after 1.0 m, {first:.1f} s\nstop 2 at (10, 2) m: after"
    assert wanted in result.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--via", "1"], "--via: '1' is not a point; give x,y in metres"),
        (["--or-goal", ""], "--or-goal: '' is not a point"),
        (["--any-order"], "--any-order is for two stops or more"),
        (["--via", "3,1", "--pareto"], "--via is for a single route, and --pareto shows many"),
        (["--via", "3,1", "--max-lost", "0.1"], "--via is not for --max-lost"),
        (["--or-goal", "3,1", "--space", "se2"], "--or-goal has no headings"),
        (["--via", "2,1 90,90"], "--via: stop 2 (90, 90) is outside of the map"),
        (["--via", "2,1 nan,2"], "--via: 'nan,2' is not a point; give x,y in metres, and blanks"),
        (["--or-goal", "2,1 90,90"], "--or-goal: goal 2 (90, 90) is outside of the map"),
        (["--or-goal", "2,1", "--goal", "90", "90"], "--goal (90, 90) is outside of the map"),
        (["--start", "90", "90"], "--start (90, 90) is outside of the map"),
        (["--goal", "inf", "90"], "--goal: 'inf 90' is not finite; give --goal X Y in metres."),
        (["--bad-level", "0.3"], "--bad-level is for --max-bad-metres; leave it out"),
        (["--comfort", "0.3"], "--comfort is for --clearance-weight; leave it out"),
        (["--robot-radius", "-1"], "--robot-radius: -1 is not zero or above"),
        (["--iterations", "0"], "--iterations: 0 is too few"),
        (["--max-bad-metres", "-1"], "--max-bad-metres: -1 is not above zero"),
        (["--pareto", "--weights", "1 -2"], "--weights: -2 is not zero or above"),
        (["--seed", "-1"], "--seed: -1 is negative"),
    ],
)
def test_bad_stops(runner: CliRunner, plan_folder: Path, words: list[str], message: str) -> None:
    result = runner.invoke(app, [*PLAN, *words, "-o", "m" if "--pareto" in words else "m.csv"])
    assert result.exit_code == 2
    assert result.stderr.startswith(f"ambinav: error: {message}")
    assert result.stderr.count("\n") == 1


def test_a_robot_may_be_a_point(runner: CliRunner, plan_folder: Path) -> None:
    lengths = []
    for radius in ("0", "0.2"):
        words = ("--robot-radius", radius, "--weight", "0", "--json", "-o", "r.csv")
        result = runner.invoke(app, [*PLAN, *words])
        assert result.exit_code == 0, result.output
        lengths.append(json.loads(result.stdout)["routes"]["weight 0"]["length_m"])
    assert lengths[0] <= lengths[1] + 1e-9


@pytest.mark.slow
def test_zones_to_keep_out_of(runner: CliRunner, plan_folder: Path) -> None:
    # Floor beside it is left between y = 1.6 and the wall at 2.5.
    zone = shapely.box(4.0, 0.0, 5.0, 1.6)
    (plan_folder / "zones.wkt").write_text(f"{zone.wkt}\n")
    away = []
    for words in ([], ["--keep-out", "zones.wkt"]):
        result = runner.invoke(app, [*PLAN, *words, "-o", "k.csv"])
        assert result.exit_code == 0, result.output
        route = load_route(plan_folder / "k.csv")
        away.append(shapely.LineString(route.poses[:, :2]).distance(zone))
    assert away[1] > away[0]
    beside = shapely.transform(zone, lambda xy: xy + 1000.0)
    lane = {"type": "Feature", "properties": {"width": 1.0}, "geometry": {"type": "LineString"}}
    lane["geometry"]["coordinates"] = [[900.0, 0.0], [950.0, 0.0]]
    (plan_folder / "far.wkt").write_text(f"{beside.wkt}\n")
    (plan_folder / "far.json").write_text(json.dumps({"features": [lane]}))
    for words in (["--keep-out", "far.wkt"], ["--one-way", "far.json"]):
        result = runner.invoke(app, [*PLAN, *words, "-o", "k.csv"])
        assert result.exit_code == 2
        said = f"{' '.join(words).replace(' ', ': ')}: all of it lies beside the map, which covers"
        assert said in " ".join(result.stderr.split())
    result = runner.invoke(app, [*PLAN, "--keep-out", "none.wkt", "-o", "k.csv"])
    assert result.exit_code == 2
    assert "none.wkt" in result.stderr
    # A polygon within another one is no hole in it.
    inner = "POLYGON ((4.2 0, 4.8 0, 4.8 1.4, 4.2 1.4, 4.2 0))\n"
    with (plan_folder / "zones.wkt").open("a") as file:
        file.write(inner)
    result = runner.invoke(app, [*PLAN, "--keep-out", "zones.wkt", "-o", "k.csv"])
    assert load_route(plan_folder / "k.csv").length == pytest.approx(route.length)
    (plan_folder / "line.wkt").write_text("LINESTRING (4 0, 5 1)\n")
    result = runner.invoke(app, [*PLAN, "--keep-out", "line.wkt", "-o", "k.csv"])
    assert result.exit_code == 2
    assert "it is a LineString; give polygons" in " ".join(result.stderr.split())


@pytest.mark.slow
def test_least_time(runner: CliRunner, plan_folder: Path) -> None:
    options = ["--minimise", "time", "--max-speed", "0.8", "--shortest", "--odometry", "poor"]
    result = runner.invoke(app, [*PLAN, "-o", "r.csv", *options, "--json"])
    assert result.exit_code == 0, result.output
    routes = json.loads(result.stdout)["routes"]
    assert list(routes) == ["least time", "shortest"]
    quick, short = routes.values()
    assert (quick["layer"], quick["weight"]) == ("slowness", 1.0)
    assert quick["cost"] == pytest.approx(0.8 * quick["minimised_s"])
    assert quick["minimised_s"] <= short["minimised_s"] + 1e-6
    assert quick["duration_s"] > quick["length_m"] / 0.8
    assert quick["length_m"] >= short["length_m"] - 1e-6
    printed = runner.invoke(app, [*PLAN, "-o", "r.csv", *options])
    assert "s, by the error that localization settles to at each place" in printed.stdout
