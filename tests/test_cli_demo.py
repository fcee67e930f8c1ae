"""`ambinav demo` does the main job without a checkout."""

from __future__ import annotations

import importlib
import json
import os
from pathlib import Path

import pytest
import typer.main
import yaml
from typer.testing import CliRunner

import ambinav
from ambinav.cli import app
from ambinav.cli.demo import steps
from ambinav.demo import DEMO_BUILDING, DEMO_DRIVES, DEMO_SCANNER, DEMO_SCENARIO

ROOT = Path(__file__).parents[1]
PATHS = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))


def test_what_it_reads_is_in_the_package():
    package = Path(ambinav.__file__).parent
    assert DEMO_BUILDING.is_file() and DEMO_BUILDING.is_relative_to(package)
    assert DEMO_SCENARIO.is_file() and DEMO_SCENARIO.is_relative_to(package)
    assert DEMO_DRIVES.is_file() and DEMO_DRIVES.is_relative_to(package)
    # A checkout shows them among the configurations; there is one copy.
    assert (ROOT / "configs" / DEMO_BUILDING.name).resolve() == DEMO_BUILDING.resolve()
    assert (ROOT / "configs" / DEMO_SCENARIO.name).resolve() == DEMO_SCENARIO.resolve()
    assert DEMO_SCANNER in [path.stem for path in (package / "sensing" / "presets").glob("*.yaml")]


def test_its_commands_are_understood(tmp_path):
    commands = typer.main.get_group(app).commands
    for name, *arguments in steps(tmp_path):
        commands[name].make_context(name, list(arguments))


def test_the_drives_are_some_of_the_comparison_s(tmp_path):
    drives, comparison = (
        yaml.safe_load(path.read_text(encoding="utf-8")) for path in (DEMO_DRIVES, DEMO_SCENARIO)
    )
    assert all(route in comparison["routes"] for route in drives.pop("routes"))
    assert drives.pop("drive")["runs"] <= comparison.pop("drive")["runs"]
    comparison.pop("routes")
    assert drives == comparison


def test_a_folder_with_other_files_is_refused(tmp_path):
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "thesis.tex").write_text("mine")
    result = CliRunner().invoke(app, ["demo", "-o", str(tmp_path)])
    assert result.exit_code == 2
    assert "thesis.tex" in result.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report"]


@pytest.mark.parametrize(
    ("name", "message"), [("mine.txt", "is a file, not a folder"), ("a.zarr", "inside of the map")]
)
def test_a_place_for_no_folder_is_refused(tmp_path, name, message):
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "a.zarr").mkdir()
    result = CliRunner().invoke(app, ["demo", "-o", str(tmp_path / name)])
    assert result.exit_code == 2
    assert message in result.stderr
    assert not any((tmp_path / "a.zarr").iterdir())


def test_it_ends_with_the_status_of_a_command_that_fails(tmp_path, monkeypatch):
    module = importlib.import_module("ambinav.cli.demo")
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    missing = ["audit", str(tmp_path / "none.yaml"), "--scanner", "rplidar-a1"]
    missing += ["-o", str(tmp_path / "made" / "report")]
    monkeypatch.setattr(module, "steps", lambda output: [missing])
    result = CliRunner().invoke(app, ["demo", "-o", str(tmp_path / "made")])
    assert result.exit_code == 2
    assert "none.yaml" in result.stderr
    assert "reports" not in result.stdout


@pytest.mark.slow(minutes=0.2)
@pytest.mark.usefixtures("coarse_pictures")
def test_it_audits_plans_and_compares(tmp_path, monkeypatch):
    """All of it, but of one pair, with fewer drives and OMPL iterations, coarser and all around."""
    text = DEMO_DRIVES.read_text(encoding="utf-8")
    for long, short in (
        ("environment: demo.geojson", f"environment: {DEMO_BUILDING}"),
        ("scanner: hokuyo-urg-04lx", "scanner: turtlebot3-lds"),
        ("spacing: 0.1", "spacing: 0.4"),
        ("iterations: 2000", "iterations: 300"),
        ("runs: 20", "runs: 2"),
        ("  - {name: across the hall, start: [2, 19], goal: [38, 24.5]}\n", ""),
    ):
        assert long in text
        text = text.replace(long, short)
    (tmp_path / "fewer.yaml").write_text(text, encoding="utf-8")
    module = importlib.import_module("ambinav.cli.demo")
    monkeypatch.setattr(module, "DEMO_DRIVES", tmp_path / "fewer.yaml")
    # Its maps have one heading, not eight.
    monkeypatch.setattr(module, "DEMO_SCANNER", "turtlebot3-lds")
    audit, plan = steps(Path("made"))
    monkeypatch.setattr(module, "steps", lambda output: [[*audit, "--spacing", "0.4"], plan])
    monkeypatch.setenv("PYTHONPATH", PATHS)
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["demo", "-o", "made", "--json"])
    assert result.exit_code == 0, result.stderr
    made = json.loads(result.stdout)
    assert made["reports"] == ["made/report/report.html", "made/compare/report.html"]
    assert "made/routes.png" in made["pictures"]
    assert all((tmp_path / path).is_file() for path in (*made["reports"], *made["pictures"]))
