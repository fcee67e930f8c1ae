"""`ambinav plan` and bad input: one sentence, exit status 2, and nothing written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ambinav.cli import app

ENDS = ("--start", "1", "1", "--goal", "10", "2")
PLAN = ("plan", "map.zarr", *ENDS)


@pytest.fixture
def runner() -> CliRunner:
    return CliRunner()


def files(folder: Path) -> set[str]:
    return {item.name for item in folder.iterdir()}


BAD = {
    "start in a wall": (["--start", "4", "0.9"], "start (4, 0.9) is in a wall"),
    "start outside": (["--start", "-9", "1"], "start (-9, 1) is outside of the map"),
    "stop in a wall": (
        ["--via", "2,1 4,0.9"],
        "--via: stop 2 (4, 0.9) is in a wall, 0.1 m deep; the",
    ),
    "unused priced graph": (["--priced-graph", "g.geojson"], "--priced-graph is for --from-graph"),
    "graph and planner": (
        ["--from-graph", "g.geojson", "--planner", "reference"],
        "--from-graph is searched without a planner",
    ),
    "graph and front": (["--from-graph", "g.geojson", "--pareto"], "--from-graph is for a single"),
    "no graph": (["--from-graph", "none.geojson"], "none.geojson: the file cannot be read"),
    "no lanes": (["--one-way", "notes.txt"], "notes.txt: this is not valid JSON in line 1"),
    "unused outside weight": (["--outside-weight", "2"], "--outside-weight is for --prefer"),
    "goal behind walls": (["--goal", "12", "1"], "goal (12, 1) is behind a wall"),
    "goal too near a wall": (["--goal", "10", "1.1"], "0.10 m from a wall, the footprint needs"),
    "start near unknown space": (["--start", "0.1", "1.5"], "0.10 m from unknown space"),
    "start nan": (
        ["--start", "nan", "1"],
        "--start: 'nan 1' is not finite; give --start X Y in metres.",
    ),
    "too wide": (["--robot-radius", "0.9"], "goal (10, 2) is 0.50 m from a wall, the"),
    "negative radius": (["--robot-radius", "-0.2"], "--robot-radius: -0.2"),
    "negative weight": (["--weight", "-1"], "--weight: -1"),
    "weight nan": (["--weight", "nan"], "--weight: nan"),
    "unknown planner": (["--planner", "rrtstr"], "did you mean rrtstar"),
    "refused planner": (["--planner", "aorrtc"], "is refused: OMPL's AORRTC never calls"),
    "missing layer": (["--layer", "levle"], "'levle'"),
    "no speed": (["--max-speed", "0"], "--max-speed: 0"),
    "acceleration nan": (["--acceleration", "nan"], "--acceleration: nan"),
    "turn rate inf": (["--max-turn-rate", "inf"], "--max-turn-rate: inf"),
    "lateral below 0": (["--lateral-acceleration", "-1"], "--lateral-acceleration: -1"),
    "sigmas below 0": (["--stop-sigmas", "-1"], "--stop-sigmas: -1"),
    "no minimum": (["--minimise", "money"], "--minimise: 'money' is neither cost nor time"),
    "time and weight": (["--minimise", "time", "-w", "2"], "--weight is not for --minimise time"),
    "time and layer": (["--minimise", "time", "--layer", "major"], "--layer is not for --minimise"),
    "time and front": (["--minimise", "time", "--pareto"], "--pareto is not for --minimise time"),
    "time and bad metres": (
        ["--minimise", "time", "--max-bad-metres", "3"],
        "--max-bad-metres is not",
    ),
    "time and promise": (["--minimise", "time", "--max-lost", "0.1"], "--max-lost is not for"),
    "unused creep": (["--creep-speed", "0.1"], "--creep-speed is for --stop-sigmas"),
    "time 0": (["--time", "0"], "--time: 0"),
    "time negative": (["--time", "-1"], "--time: -1"),
    "time nan": (["--time", "nan"], "--time: nan"),
    "iterations 0": (["--iterations", "0"], "--iterations: 0"),
    "seed negative": (["--seed", "-1"], "--seed: -1"),
    "unknown space": (
        ["--space", "r4"],
        "--space is 'r4'; choose from r2, se2, dubins, reeds-shepp, r3.",
    ),
    "no turning radius": (["--space", "dubins"], "--turning-radius: 0"),
    "unused std": (["--max-std", "0.5"], "--max-std is for the planners belief"),
    "unused start": (["--start-std", "0.5"], "--start-std is for the planners belief"),
    "unused odometry": (["--odometry-scale", "1"], "--odometry-scale is for the planners belief"),
    "start below zero": (["--planner", "belief", "--start-std", "-1"], "--start-std"),
    "forecast from a point": (
        ["--planner", "belief", "--start-std", "0", "--odometry", "poor"],
        "--start-std: 0 has no forecast; give more",
    ),
    "unused weights": (["--weights", "0 1"], "--weights is for --pareto"),
    "start heading": (["--start-heading", "0"], "--start-heading is for spaces other than r2"),
    "goal heading": (["--goal-heading", "9"], "--goal-heading is for spaces other than r2"),
    "unused turning": (["--turning-radius", "1"], "--turning-radius is for the spaces dubins"),
    "two outlines": (
        ["--robot-radius", "0.2", "--footprint", "1,0 0,1 -1,0"],
        "--robot-radius is for a disc",
    ),
    "unused clearance": (
        ["--planner", "belief", "--clearance-weight", "1"],
        "--clearance-weight is not part",
    ),
    "graph over graph": (
        ["--from-graph", "g.geojson", "--priced-graph", "g.geojson"],
        "is the file of --from-graph",
    ),
    "graph and lanes": (["--from-graph", "g.geojson", "--one-way", "l.geojson"], "of its own"),
    "creep too fast": (["--stop-sigmas", "3", "--creep-speed", "3"], "more than --max-speed"),
    "certified front": (["--pareto", "--certify"], "--certify is for a single weight"),
    "certified stops": (["--via", "5,1", "--certify"], "--via is not for --certify"),
    "unused picture": (["--pareto", "--picture", "p.png"], "--picture is what --pareto draws"),
    "comfort 0": (["--comfort", "0"], "--comfort: 0"),
    "clearance weight": (["--clearance-weight", "-1"], "--clearance-weight: -1"),
    "limit 0": (["--max-bad-metres", "0"], "--max-bad-metres: 0 is not above zero"),
    "limit refused": (["--max-bad-metres", "5", "-p", "fmt"], "cannot keep a limit"),
    "bad level": (
        ["--max-bad-metres", "5", "--bad-level", "-1"],
        "--bad-level: -1 is not zero or above",
    ),
    "bad footprint": (["--footprint", "0.3,0.2 x"], "--footprint: 'x' is not a point"),
    "footprint of two": (["--footprint", "0,0 1,1"], "--footprint: 2 corners make no polygon"),
    "huge turn": (
        ["--space", "dubins", "--turning-radius", "1e9"],
        "--turning-radius is 1e+09 m, far more than the building",
    ),
    "negative std": (["--planner", "belief", "--max-std", "-1"], "--max-std: -1 is not above zero"),
    "start too unsure": (
        ["--planner", "belief-roadmap", "--max-std", "0.001"],
        "--max-std: 0.001 m is less than the deviation at the start, 0.1 m; give more",
    ),
    "seed of no use": (
        ["--planner", "reference", "--seed", "1"],
        "--seed has no effect on the planner reference, which is not random and searches to the "
        "end; leave it out.",
    ),
    "time of no use": (["-p", "reference", "--time", "2"], "--time has no effect on the planner r"),
    "iterations of no use": (["-p", "belief", "--iterations", "9"], "no effect on the planner b"),
    "improving of no use": (["-p", "belief", "--no-improve"], "--no-improve has no effect"),
    "iterations on lanes": (
        ["--one-way", "l.geojson", "--iterations", "9"],
        "--iterations has no effect on --one-way: lanes are for the planner reference, which is",
    ),
    "seed on a graph": (["--from-graph", "g", "--seed", "1"], "--seed has no effect on --from-gr"),
    "time on a graph": (["--from-graph", "g", "--time", "9"], "--time has no effect on --from-gr"),
    "iterations on a graph": (["--from-graph", "g", "--iterations", "9"], "--iterations has no"),
    "improving on a graph": (["--from-graph", "g", "--no-improve"], "whose routes keep to its e"),
    "weight of a front": (
        ["--pareto", "--weight", "7", "--weights", "0 5"],
        "--weight is for a single route, and --pareto plans for --weights; leave it out.",
    ),
    "bad suffix": (["-o", "route.txt"], "--output: route.txt ends in '.txt'"),
    "no suffix": (["-o", "route"], "--output: route ends in 'nothing'"),
    "bad picture": (["--picture", "r.bmp"], "--picture: r.bmp ends in '.bmp'"),
    "in a file": (["-o", "notes.txt/r.csv"], "notes.txt is a file, not a folder"),
    "picture in a file": (["--picture", "notes.txt/r.png"], "notes.txt is a file"),
    "output is a folder": (["-o", "folder.csv"], "folder.csv: this is a folder"),
    "picture is a folder": (["--picture", "folder.png"], "folder.png: this is a folder"),
    "bad weights": (["-o", "new", "--pareto", "--weights", "1 x"], "--weights: '1 x'"),
    "one weight": (["-o", "new", "--pareto", "--weights", "1"], "at least two"),
    "front in use": (["-o", "map.zarr", "--pareto"], "not of an earlier Pareto front"),
    "front on a file": (["-o", "notes.txt", "--pareto"], "notes.txt"),
}


@pytest.mark.parametrize(("more", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_sentence_and_status_2(
    runner: CliRunner, plan_folder: Path, more: list[str], message: str
) -> None:
    for name in ("folder.csv", "folder.png"):
        (plan_folder / name).mkdir()
    before = files(plan_folder)
    result = runner.invoke(app, [*PLAN, "-o", "route.csv", *more])
    assert result.exit_code == 2, result.output
    errors = result.stderr.splitlines()
    assert len(errors) == 1
    assert errors[0].startswith("ambinav: error: ")
    assert message in errors[0]
    assert result.stdout == ""
    assert files(plan_folder) == before


def test_maps_that_are_none(runner: CliRunner, plan_folder: Path) -> None:
    for name in ("none.zarr", "notes.txt"):
        result = runner.invoke(app, ["plan", name, *ENDS, "-o", "r.csv"])
        assert result.exit_code == 2
        assert name in result.stderr
    assert files(plan_folder) == {"map.zarr", "notes.txt"}


def test_a_lost_chunk_is_named(runner, plan_folder):
    chunk = plan_folder / "map.zarr" / "level" / "c" / "0" / "0"
    chunk.unlink()
    before = files(plan_folder)
    result = runner.invoke(app, [*PLAN, "-o", "r.csv"])
    assert result.exit_code == 2, result.output
    (error,) = result.stderr.splitlines()
    assert error.startswith(
        "ambinav: error: map.zarr/level/c/0/0: this part of the map is missing;"
    )
    assert files(plan_folder) == before


def test_a_map_of_a_newer_version_is_refused(runner, plan_folder):
    root = plan_folder / "map.zarr" / "zarr.json"
    document = json.loads(root.read_text())
    document["attributes"] |= {"map_format": 1000, "ambinav_version": "9.9.9"}
    root.write_text(json.dumps(document))
    result = runner.invoke(app, [*PLAN, "-o", "r.csv"])
    assert result.exit_code == 2, result.output
    (error,) = result.stderr.splitlines()
    assert "format 1000 (of ambinav 9.9.9)" in error and "install a newer ambinav" in error
