"""A stranger's plug-in: one short file for each kind, found by its entry point, used by a user.

The plug-in is no part of the packages. The test installs it as pip would, by writing its
metadata beside it, and uses it in processes of their own.
"""

from __future__ import annotations

import doctest
import json
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from ambinav import RangeScanner
from tests.stranger.user import PLUGIN, ROOT, User, environment

HOWTO = ROOT / "docs" / "howto"
PAGES = {
    "ambinav.sensors": "add-a-sensor-preset.md",
    "ambinav.sensor_models": "add-a-sensor-model.md",
    "ambinav.layers": "add-a-layer.md",
    "ambinav.map_readers": "add-a-map-reader.md",
    "ambinav.exporters": "add-an-exporter.md",
    "ambinav.planners": "add-a-planner.md",
    "ambinav.localizers": "add-a-localizer.md",
    "ambinav.rewards": "add-a-reward.md",
    "ambinav.observations": "add-an-observation.md",
    "ambinav.tasks": "add-a-task.md",
    "ambinav.suites": "add-a-suite.md",
}
"""The page of each group of entry points, in docs/howto."""
FLOOR = """\
############
#          #
#          #
#   ####   #
#          #
############
"""
SCENARIO = """\
environment: floor.txt
scanner: stranger-lidar
map: {spacing: 0.25}
robot: {radius: 0.1}
localizer: {type: confident, std: 0.2}
pairs: [{name: along, start: [1.5, 1.5], goal: [10.0, 1.5]}]
routes: [{kind: planner, planner: straight}]
drive: {runs: 2, seed: 1}
"""
STEREO = """\
parts:
  - sensor: {model: stereo, max_range: 3, baseline: 0.05, focal_length: 400}
    planar: {beams: 24, aperture_deg: 360}
"""
BROKEN = """\
import json, shutil
import stranger_exporter, stranger_layer, stranger_localizer, stranger_map_reader
import stranger_observation, stranger_planner, stranger_reward, stranger_sensor_model
import stranger_suite, stranger_task
from typer.testing import CliRunner
from ambinav.cli import app

def fails(*given, **options):
    return [][1]

def empty(*given, **options):
    return None

MAP = ["map", "floor.txt", "-s", "stranger-lidar", "--spacing", "0.5", "-o", "none.zarr"]
PLAN = ["plan", "floor.zarr", "--start", "1.5", "1.5", "--goal", "10", "1.5",
        "--planner", "straight", "--robot-radius", "0.1", "-o", "none.wkt"]
CASES = [
    (stranger_layer.LAYER, "compute", [*MAP, "--layers", "seen_range"]),
    (stranger_layer.LAYER, "why_not", [*MAP, "--layers", "seen_range"]),
    (stranger_map_reader.READER, "read", MAP),
    (stranger_sensor_model.MODEL, "make", [*MAP[:3], "stereo.yaml", *MAP[4:]]),
    (stranger_planner.PLANNER, "solve", PLAN),
    (stranger_exporter.EXPORTER, "write", PLAN),
    (stranger_exporter.EXPORTER, "read", ["compare", "read.yaml", "-o", "none"]),
    (stranger_localizer.LOCALIZER, "detail", ["compare", "scenario.yaml", "-o", "none"]),
    (stranger_reward.TERM, "function", ["train", "training.yaml", "-o", "untrained"]),
    (stranger_observation.PART, "function", ["train", "training.yaml", "-o", "untrained"]),
    (stranger_observation.PART, "size", ["train", "training.yaml", "-o", "untrained"]),
    (stranger_task.TASK, "draw", ["train", "parking.yaml", "-o", "untrained"]),
    (stranger_task.TASK, "judge", ["train", "parking.yaml", "-o", "untrained"]),
    (stranger_suite.SUITE, "draw", ["train", "parking.yaml", "-o", "untrained"]),
]
rows = []
for entry, field, command in CASES:
    # None is what these two may give.
    for function in (fails,) if field in ("why_not", "detail") else (fails, empty):
        whole = getattr(entry, field)
        object.__setattr__(entry, field, function)
        shutil.rmtree("untrained", ignore_errors=True)
        done = CliRunner().invoke(app, command)
        rows.append([type(entry).__name__, field, function.__name__, done.exit_code, done.output])
        object.__setattr__(entry, field, whole)
print(json.dumps(rows))
"""
KINDS = {
    "Layer": "layer '",
    "MapReader": "map reader '",
    "SensorModel": "sensor model '",
    "Planner": "planner '",
    "Exporter": "exporter '",
    "RewardTerm": "reward term '",
    "ObservationPart": "part of the observation '",
    "TaskSpec": "task '",
    "Suite": "suite '",
}
"""How messages name an entry of each class."""
TRAIN = """\
algorithm: ppo
steps: 64
envs: 2
evaluation: {episodes: 4}
environment: {id: ambinav/Navigation-v1, map: floor.txt, scanner: stranger-lidar,
    localizer: odometry, reward: {progress: 1.0, nearness: 0.5}, observations: [nearest]}
"""
PARKING = """\
steps: 64
envs: 2
evaluation: {episodes: 4, environment: {buildings: 2}}
environment: {id: stranger/Parking-v0, buildings: 2}
"""
MADE = """\
import gymnasium, json, ambinav_envs
env = gymnasium.make("stranger/Parking-v0", buildings=2)
poses = [env.reset(seed=seed)[1]["true_pose"].tolist() for seed in (1, 2, 1)]
twin = gymnasium.make("stranger/Parking-TruePose-v0", buildings=2)
print(json.dumps([poses, twin.unwrapped.simulation.parameters.localizer]))
"""
TRAINING = """\
import gymnasium, json, numpy as np, ambinav_envs
env = gymnasium.make(
    "ambinav/Navigation-v1", map="floor.txt", scanner="stranger-lidar", localizer="odometry",
    reward={"progress": 1.0, "nearness": 0.5}, observations=["nearest"],
)
env.reset(seed=0)
seen, reward, _, _, info = env.step(np.array([1.0, 0.0], dtype=np.float32))
print(json.dumps([float(seen["nearest"][0]), reward, info["terms"], info["reward_terms"]]))
"""
DRIVE = """\
import ambinav_envs
import gymnasium
import numpy as np

env = gymnasium.make(
    "ambinav/Navigation-v1", map="floor.txt", scanner="stranger-lidar", observations=["nearest"]
)
env.reset(seed=0)
seen, *_ = env.step(np.array([1.0, 0.0], dtype=np.float32))
print(env.observation_space["nearest"], seen["nearest"].shape)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with a building, and beside it the plug-in's metadata as pip leaves them."""
    folder = tmp_path_factory.mktemp("stranger")
    (folder / "floor.txt").write_text(FLOOR)
    (folder / "scenario.yaml").write_text(SCENARIO)
    (folder / "stereo.yaml").write_text(STEREO)
    (folder / "training.yaml").write_text(TRAIN)
    (folder / "parking.yaml").write_text(PARKING)
    (folder / "drive.py").write_text(DRIVE)
    project = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]
    about = folder / "site" / f"{project['name']}-{project['version']}.dist-info"
    about.mkdir(parents=True)
    about.joinpath("METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    groups = [
        "\n".join([f"[{group}]", *(f"{name} = {place}" for name, place in points.items())])
        for group, points in project["entry-points"].items()
    ]
    about.joinpath("entry_points.txt").write_text("\n".join(groups) + "\n")
    return folder


@pytest.fixture(scope="module")
def user(folder: Path) -> Iterator[User]:
    user = User(folder)
    yield user
    user.process.communicate(timeout=60)


def run(folder: Path, *arguments: str, status: int = 0) -> str:
    """What a Python process says that has the plug-in on its path."""
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, text=True,
        env=environment(folder), timeout=900,
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    return done.stdout if status == 0 else done.stderr


def test_the_files_are_short() -> None:
    for path in PLUGIN.glob("*.py"):
        assert len(path.read_text().splitlines()) < 60, path


def page(name: str) -> str:
    return (HOWTO / name).read_text(encoding="utf-8")


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def commands(text: str) -> list[tuple[str, str]]:
    """The commands in the indented blocks of a page, each with what it prints there."""
    lines = [line[4:] for line in text.splitlines() if line.startswith("    ") or not line]
    parts = re.split(r"^\$ (.*)$", "\n".join(lines), flags=re.MULTILINE)
    return list(zip(parts[1::2], parts[2::2], strict=True))


def test_every_kind_has_a_page() -> None:
    assert {path.name for path in HOWTO.glob("add-a*.md")} == set(PAGES.values())
    for text in (page("plug-in.md"), (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")):
        assert re.findall(r"\((?:docs/howto/)?(add-an?-[a-z-]+\.md)\)", text) == [*PAGES.values()]
    for group, name in PAGES.items():
        assert len(page(name).splitlines()) <= 80, name
        assert f"| `{group}` | [{page(name).splitlines()[0][2:]}]({name}) |" in page("plug-in.md")


def test_the_pages_have_the_files() -> None:
    whole = tomllib.loads((PLUGIN / "pyproject.toml").read_text())
    project, modules = whole["project"], whole["tool"]["setuptools"]["py-modules"]
    assert modules == sorted(path.stem for path in PLUGIN.glob("*.py"))
    points = project.pop("entry-points")
    head = tomllib.loads(*blocks(page("plug-in.md"), "toml"))
    assert head["project"] == project
    assert set(head["tool"]["setuptools"]["py-modules"]) < set(modules)
    assert set(points) == set(PAGES)
    for group, name in PAGES.items():
        ((_, place),) = points[group].items()
        path = PLUGIN / f"{place.partition(':')[0]}.py"
        assert blocks(page(name), "python") == [path.read_text()]
        assert f"`{path.name}`" in page(name)
        (entry,) = blocks(page(name), "toml")
        expected = {"project": {"entry-points": {group: points[group]}}}
        assert tomllib.loads(entry) == expected


@pytest.mark.slow
def test_the_commands_of_the_pages_print_what_the_pages_say(user: User, amap: Path) -> None:
    asked = [(name, *both) for name in PAGES.values() for both in commands(page(name))]
    assert {name for name, _, _ in asked} == set(PAGES.values())
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    for name, command, expected in asked:
        output = user(*shlex.split(command))
        same = doctest.OutputChecker().check_output(expected.strip(), output.strip(), flags)
        assert same, f"{name}: {command}\n{output}"


@pytest.mark.slow
def test_a_sensor_is_listed(user: User) -> None:
    presets = json.loads(user("ambinav", "presets", "--json"))
    assert "stranger-lidar" in [preset["name"] for preset in presets]
    assert "beams: 24" in user("ambinav", "presets", "stranger-lidar")


@pytest.mark.slow
def test_each_kind_is_listed_with_who_brings_it(folder: Path) -> None:
    groups = json.loads(run(folder, "-m", "ambinav.cli", "plugins", "--json"))
    project = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]
    assert {group["group"] for group in groups} == set(project["entry-points"]) == set(PAGES)
    for group in groups:
        (entry,) = (one for one in group["entries"] if one["distribution"] == "stranger")
        assert {entry["name"]: entry["place"]} == project["entry-points"][group["group"]]
        assert Path(entry["file"]).parent == PLUGIN and entry["error"] is None
        own = [one for one in group["entries"] if one["distribution"] == "ambinav"]
        assert own or group["kind"] == "sensor model"


@pytest.mark.sweep
def test_a_broken_plug_in_is_listed_with_its_error(folder: Path) -> None:
    code = (
        "import stranger_layer; stranger_layer.LAYER = None; from ambinav.cli import main; main()"
    )
    table = "".join(run(folder, "-c", code, "plugins").split())  # its lines are folded
    assert "layer'seen_range'oftheplug-instrangercannotbeused" in table
    assert "stranger_planner.py" in table


@pytest.fixture(scope="module")
def amap(folder: Path, user: User) -> Path:
    """A map with the plug-in's layer, of a building that its reader reads, for its sensor."""
    user("ambinav", "map", "floor.txt", "--scanner", "stranger-lidar", "--spacing", "0.25",
        "--layers", "seen_range", "-o", "floor.zarr",
    )  # fmt: skip
    return folder / "floor.zarr"


@pytest.mark.slow
def test_a_map_reader_and_a_layer(amap: Path) -> None:
    from ambinav import AmbiguityMap

    made = AmbiguityMap.open(amap)
    assert made.environment.free.area == pytest.approx(36.0)
    assert made.dataset["seen_range"].attrs["long_name"] == "mean share of the range that is seen"
    # Beside the pillar less is seen than in the open.
    assert made.sample("seen_range", 5.0, 1.2) < made.sample("seen_range", 2.0, 2.5)


@pytest.mark.slow
def test_a_planner_and_an_exporter(folder: Path, user: User, amap: Path) -> None:
    where = ("--start", "1.5", "1.5", "--goal", "10", "1.5")
    user("ambinav", "plan", "floor.zarr", *where, "--planner", "straight", "--robot-radius", "0.1",
        "-o", "route.wkt",
    )  # fmt: skip
    assert (folder / "route.wkt").read_text() == "LINESTRING (1.5 1.5, 10 1.5)\n"
    across = ("--start", "1.5", "1.5", "--goal", "10", "3.5", "--planner", "straight")
    message = user("ambinav", "plan", "floor.zarr", *across, "-o", "route.wkt", status=2)
    assert "planner 'straight' found no" in message


@pytest.mark.slow
def test_a_sensor_model(folder: Path, user: User) -> None:
    from ambinav import AmbiguityMap

    options = ("--scanner", "stereo.yaml", "--spacing", "0.5", "-o", "stereo.zarr")
    user("ambinav", "map", "floor.txt", *options)
    # Stored without the plug-in's model, which is not installed here.
    stored = RangeScanner.from_yaml_text(
        AmbiguityMap.open(folder / "stereo.zarr").dataset.attrs["scanner_yaml"]
    )
    assert stored.sensors[0].std_at(2.0) == pytest.approx(2.0**2 * 0.1 / (400 * 0.05))
    (folder / "wrong.yaml").write_text(STEREO.replace("baseline: 0.05", "baseline: -1"))
    message = user("ambinav", "map", "floor.txt", "-s", "wrong.yaml", "-o", "none.zarr", status=2)
    assert "wrong.yaml: parts[0].sensor: baseline is -1" in message


@pytest.mark.slow
def test_a_localizer(folder: Path, user: User) -> None:
    user("ambinav", "compare", "scenario.yaml", "-o", "compared")
    report = json.loads((folder / "compared" / "report.json").read_text())
    assert report["localizer"]["name"] == "dead reckoning that is sure of itself"
    assert report["plans"][0]["planner"] == "straight"


@pytest.mark.slow
def test_a_reward_and_an_observation(user: User) -> None:
    nearest, reward, terms, weighted = json.loads(user.python(TRAINING))
    assert 0.0 < nearest <= 3.0
    assert terms["nearness"] == pytest.approx(min(nearest, 0.5) - 0.5)
    assert weighted["nearness"] == 0.5 * terms["nearness"]
    assert reward == pytest.approx(sum(weighted.values()))


@pytest.mark.slow
def test_a_task(user: User) -> None:
    poses, localizer = json.loads(user.python(MADE))
    assert poses[0] == poses[2] != poses[1] and localizer == "perfect"
    assert all(pose[0] == 0.5 and pose[2] == 0.0 for pose in poses)


@pytest.mark.sweep
def test_a_file_of_a_plug_ins_format_is_compared(folder: Path, user: User) -> None:
    (folder / "given.wkt").write_text("LINESTRING (1.5 1.5, 10 1.5)")
    text = SCENARIO.replace("{kind: planner, planner: straight}", "{kind: file, file: given.wkt}")
    (folder / "read.yaml").write_text(text.replace("type: confident, std: 0.2", "type: odometry"))
    user("ambinav", "compare", "read.yaml", "-o", "read")
    report = json.loads((folder / "read" / "report.json").read_text())
    assert report["plans"][0]["planner"] == "wkt"
    assert report["plans"][0]["length_m"] == pytest.approx(8.5)


@pytest.mark.slow
def test_what_fails_within_a_plug_in_is_named(folder: Path, user: User, amap: Path) -> None:
    (folder / "read.yaml").write_text(
        SCENARIO.replace("{kind: planner, planner: straight}", "{kind: file, file: given.wkt}")
    )
    (folder / "given.wkt").write_text("LINESTRING (1.5 1.5, 10 1.5)")
    pages = " ".join(" ".join(map(page, PAGES.values())).split())
    for kind, field, function, status, message in json.loads(user.python(BROKEN)):
        case = (kind, field, function, message)
        assert status == 2, case
        assert "of the plug-in stranger" in message, case
        assert message.strip().endswith("; fix it, or uninstall stranger."), case
        if function == "fails":
            assert "fails failed (IndexError: list index out of range" in message, case
        else:
            # From the kind on: what stands before names the file that asks for it.
            _, name, rest = message.partition(KINDS[kind])
            assert f"{name}{' '.join(rest.split())}" in pages, case


@pytest.mark.sweep
def test_a_broken_plug_in_is_named(folder: Path) -> None:
    code = (
        "import stranger_layer; stranger_layer.LAYER = None; from ambinav.cli import main; main()"
    )
    message = run(
        folder, "-c", code, "map", "floor.txt", "-s", "stranger-lidar", "--layers", "seen_range",
        "-o", "none.zarr", status=2,
    )  # fmt: skip
    assert "layer 'seen_range' of the plug-in stranger cannot be used" in message
    assert message.strip().endswith("fix or uninstall stranger.")
