"""`ambinav forecast` and `ambinav plan --max-lost` as a user meets them."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import ambinav as an
from ambinav import AmbiguityMap
from ambinav.cli import app
from ambinav.cli.planned import LostFigures
from ambinav.drive.bootstrap import Interval
from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.forecasting.reliability import bin_at
from ambinav.routes.files import load_route
from ambinav_planners import RoutePlanner
from ambinav_planners.belief.model import BeliefModel
from tests.forecasting.conftest import demo_map as demo_map

ENDS = ("--start", "9", "21", "--goal", "28", "17")


@pytest.mark.parametrize(
    ("share", "agrees"), [(0.0472, True), (0.0476, False), (0.0328, True), (0.0324, False)]
)
def test_drives_contradict_a_forecast_outside_of_what_is_printed(
    share: float, agrees: bool
) -> None:
    driven = SimpleNamespace(probability=Interval(0.039, 0.0331, 0.0469, 4096))
    figures = LostFigures(LocalizerClass.load("product"), "poor", {"a": share}, {"a": driven})  # type: ignore[dict-item]
    assert figures.contradiction("a") == (
        ""
        if agrees
        else f" That contradicts the forecast of {100 * share:.1f} %; rely on the drives."
    )


@pytest.fixture(scope="module")
def stored(demo_map: AmbiguityMap, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the demo's map, and a route through the hall."""
    folder = tmp_path_factory.mktemp("forecast")
    demo_map.save(folder / "map.zarr")
    plan = ["plan", f"{folder}/map.zarr", *ENDS, "--weight", "0", "-o", f"{folder}/r.csv"]
    assert CliRunner().invoke(app, plan).exit_code == 0
    return folder


@pytest.fixture
def folder(stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with them."""
    shutil.copytree(stored, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_forecast_says_how_likely_lost_and_where(folder: Path) -> None:
    command = ["forecast", "map.zarr", "r.csv", "--odometry", "poor", "--picture", "f.png"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "robots get lost on this route, most of them " in text
    assert "where nothing in range tells the position." in text
    assert "localizer: Monte Carlo localization that multiplies the beams" in text
    assert "picture: f.png" in text
    with Image.open(folder / "f.png") as picture:
        assert min(picture.size) > 300
    drawn = json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)
    assert drawn.pop("picture") == "f.png"
    document = json.loads(CliRunner().invoke(app, [*command[:5], "--json"]).stdout)
    assert document == drawn
    assert document["lost_probability"] == document["curve"][-1]["lost"] > 0.2
    assert document["causes"][0]["kind"] == "open floor"
    assert document["odometry"] == "poor"
    measured = bin_at(LocalizerClass.load("product").reliability, document["lost_probability"])
    assert document["lost_probability_reliability"] == asdict(measured)
    assert measured.sentence in text
    wide = json.loads(
        CliRunner().invoke(app, [*command[:5], "--position-limit", "1", "--json"]).stdout
    )
    assert wide["lost_probability_reliability"] is None
    assert document["text"].startswith(text[: text.index(" robots get")])
    assert document["causes"][0]["end_m"] <= document["curve"][-1]["distance_m"]


def test_a_route_of_another_map_is_noted(folder: Path) -> None:
    text = (folder / "r.csv").read_text()
    (folder / "r.csv").write_text(text.replace('# scanner: "', '# scanner: "other-'))
    result = CliRunner().invoke(app, ["forecast", "map.zarr", "r.csv"])
    assert result.exit_code == 0
    assert "r.csv: planned with the scanner other-" in " ".join(result.stderr.split())
    assert "environment" not in result.stderr


@pytest.mark.slow
def test_plan_keeps_the_promise(folder: Path) -> None:
    command = ["plan", "map.zarr", *ENDS, "--odometry", "poor", "--shortest", "-o", "safe.csv"]
    result = CliRunner().invoke(app, [*command, "--max-lost", "0.05", "--json"])
    assert result.exit_code == 0, result.output
    chosen, shortest = json.loads(result.stdout)["routes"].values()
    assert chosen["lost_probability"] < shortest["lost_probability"]
    assert chosen["driven"]["lost"] <= 0.05 * chosen["driven"]["runs"]
    assert chosen["driven"]["threshold"] == 0.05
    for figures in (chosen, shortest):
        measured = figures["lost_probability_reliability"]
        forecast = figures["lost_probability"]
        assert measured["forecast_low"] <= forecast <= measured["forecast_high"]
        assert measured["lost_low"] <= measured["lost"] <= measured["lost_high"]
    assert shortest["driven"]["lost"] > 0.05 * shortest["driven"]["runs"]
    assert chosen["length_m"] > shortest["length_m"]
    assert load_route(folder / "safe.csv").length == pytest.approx(chosen["length_m"])
    table = CliRunner().invoke(app, [*command, "--weight", "0"]).stdout
    assert " forecast " in table.splitlines()[0]
    # Without a question about the robot there is no forecast, which takes time on a large map.
    plain = CliRunner().invoke(app, ["plan", "map.zarr", *ENDS, "-o", "r.csv", "--json"]).stdout
    assert "lost_probability" not in plain


@pytest.mark.slow
def test_a_route_is_verified_by_drives(folder: Path) -> None:
    command = ["plan", "map.zarr", *ENDS, "--odometry", "poor", "-o", "r.csv", "--seed", "1"]
    for weight, status, words in (("0", 3, "more than 10 %."), ("8", 0, "less than 10 %.")):
        result = CliRunner().invoke(app, [*command, "--verify", "0.1", "--weight", weight])
        assert result.exit_code == status, result.output
        assert f"weight {weight}: " in result.stdout
        assert words in result.stdout
    undecided = CliRunner().invoke(app, [*command, "--verify", "0.01", "--drives", "8"])
    assert undecided.exit_code == 3
    assert "whether that is less than 1 % is undecided." in undecided.stdout


@pytest.mark.sweep
def test_a_front_trades_length_for_lost_robots(folder: Path) -> None:
    command = ["plan", "map.zarr", *ENDS, "--pareto", "--weights", "0 8", "-o", "front"]
    printed = CliRunner().invoke(app, [*command, "--odometry", "poor", "--json"]).stdout
    for point in json.loads(printed)["points"]:
        measured = point["lost_probability_reliability"]
        assert measured["forecast_low"] <= point["lost_probability"] <= measured["forecast_high"]
    result = CliRunner().invoke(app, [*command, "--odometry", "poor"])
    assert result.exit_code == 0, result.output
    assert " forecast " in result.stdout.splitlines()[0]
    shortest, safe = json.loads((folder / "front/pareto.json").read_text())
    assert shortest["lost_probability"] > 0.2 > 0.05 > safe["lost_probability"]
    assert "lost_probability" in (folder / "front/pareto.csv").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--odometry", "wheels"], "--odometry: odometry is 'wheels'; "),
        (["--localizer", "gps"], "--localizer: localizer is 'gps', which has no calibration; "),
        (["--max-lost", "5"], "--max-lost is 5; give a share of robots above 0 and below 1."),
        (["--max-lost", "0.1", "--pareto"], "--max-lost"),
        (["--verify", "0"], "--verify is 0; give a share of robots above 0 and below 1."),
        (["--verify", "0.1", "--max-lost", "0.1"], "--verify is what --max-lost does by itself"),
        (["--drives", "9"], "--drives is for --verify and --max-lost"),
        (["--planner", "belief", "--odometry", "good", "--odometry-scale", "1"],
         "--odometry-scale is an odometry, and --odometry another; leave it out."),
        (["--verify", "0.1", "--drives", "0"], "--drives is 0; give a number of at least 1."),
        (["--max-lost", "0.1", "--weight", "3"], "--weight is chosen by --max-lost"),
        pytest.param(
            ["--max-lost", "1e-9", "--odometry", "amcl-default"], "routes keeps to 1e-07 %",
            marks=pytest.mark.sweep,
        ),
    ],
)  # fmt: skip
def test_bad_input_of_plan(folder: Path, arguments: list[str], message: str) -> None:
    result = CliRunner().invoke(app, ["plan", "map.zarr", *ENDS, "-o", "new.csv", *arguments])
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())
    assert not (folder / "new.csv").exists()


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("odometry", "start", "std"),
    [
        (["--odometry", "amcl-default"], ["--start-std", "0.3"], 0.3),
        (["--odometry-scale", "1"], [], 0.1),
    ],
    ids=["amcl-default", "scale"],
)
def test_a_belief_planner_and_its_forecast_have_one_odometry_and_one_start(
    folder: Path, odometry: list[str], start: list[str], std: float
) -> None:
    belief = ["--planner", "belief", "--seed", "3", *start, "--verify", "0.5"]
    words = ["plan", "map.zarr", *ENDS, "-o", "new.csv", *belief, *odometry, "--json"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code in (0, 3), result.output
    (figures,) = json.loads(result.stdout)["routes"].values()
    amap, route = an.AmbiguityMap.open(folder / "map.zarr"), load_route(folder / "new.csv")
    noise = OdometryNoise(scale=1.0)
    known = an.forecast(amap, route, noise, start_std=(std, std, 0.05))
    assert figures["lost_probability"] == pytest.approx(known.lost_probability, abs=1e-6)
    model = BeliefModel(start_std=(std, std, 0.05))
    planner = RoutePlanner(an.AmbiguityService(amap), belief=model, odometry=noise)
    again = planner.plan((9, 21), (28, 17), planner_name="belief", seed=3)
    np.testing.assert_array_equal(again.poses, route.poses)


def test_bad_input_of_forecast(folder: Path) -> None:
    for arguments, message in (
        (["r.csv", "--picture", "f.txt"], "--picture: f.txt ends in '.txt'; "),
        (["none.csv"], "none.csv"),
        (["r.csv", "--odometry", "x"], "--odometry: odometry is 'x'; "),
        (["r.csv", "--odometry", ""], "--odometry: odometry is ''; "),
        (["r.csv", "--position-limit", "inf"], "--position-limit: inf is not finite; "),
        (["flight.csv"], "flight.csv: it is a route through space; "),
        (["flight.json"], "flight.json: it is a route through space; "),
    ):
        (folder / "flight.csv").write_text("x,y,z,distance,cost,level\n0,0,1,0,0,0\n")
        (folder / "flight.json").write_text('{"ambinav": {"points": []}}')
        result = CliRunner().invoke(app, ["forecast", "map.zarr", *arguments])
        assert result.exit_code == 2
        assert message in " ".join(result.stderr.split())


@pytest.mark.slow
def test_a_program_is_driven_only_if_it_is_trusted(folder: Path) -> None:
    (folder / "mine.yaml").write_text(
        "{name: mine, title: my filter, gain: 0.1, "
        "localizer: {type: program, command: [no-such-filter]}}"
    )
    assert (
        CliRunner()
        .invoke(app, ["forecast", "map.zarr", "r.csv", "--localizer", "mine.yaml"])
        .exit_code
        == 0
    )
    words = [
        "plan",
        "map.zarr",
        *ENDS,
        "--localizer",
        "mine.yaml",
        "-o",
        "m.csv",
        "--verify",
        "0.05",
    ]
    for more, message in (
        ([], "if you trust it, add --trust."),
        (["--trust"], "cannot be started"),
    ):
        result = CliRunner().invoke(app, [*words, *more])
        assert result.exit_code == 2
        assert message in result.stderr
