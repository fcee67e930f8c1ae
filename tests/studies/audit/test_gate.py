"""The gate of an audit: its figures are those of report.json; exit status; files."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.reports.conditions import judge, parse_condition
from ambinav.runtime.errors import InputError
from ambinav.studies.audit.audit import audit
from ambinav.studies.audit.document import document
from ambinav.studies.audit.figures import ALIASING, QUANTITIES
from tests.maps import synthetic
from tests.test_cli import PLAN, SCANNER

BASE = (
    "audit",
    "plan.geojson",
    "-s",
    "scanner.yaml",
    "-o",
    "out",
    "--spacing",
    "0.4",
    "--posts",
    "0",
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "plan.geojson").write_text(json.dumps(PLAN))
    (tmp_path / "scanner.yaml").write_text(SCANNER)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*options: str):
    return CliRunner().invoke(app, [*BASE, *options])


@pytest.fixture(scope="module")
def report(examined):
    return document(examined)


def test_figures_are_those_of_the_report(report):
    plain = json.loads(report.model_dump_json())
    zones = {zone["zone"]: zone for zone in plain["zones"]}
    values = {name: one.read(report) for name, one in QUANTITIES.items() if name not in ALIASING}
    for name, zone in zones.items():
        assert values[name] == 100 * zone["share"]
        assert values[f"{name} area"] == zone["area_m2"]
        # Of a scanner that looks all around the heading does not matter.
        assert (
            values[f"{name} at best heading"] == values[f"{name} at worst heading"] == values[name]
        )
    assert sum(values[name] for name in zones) == pytest.approx(100.0, abs=0.05)
    assert values["longest open stretch"] == zones["open"]["longest_place_m"]
    assert values["open places"] == zones["open"]["places"]
    assert values["places"] == plain["places_in_all"]
    for name in ("free", "counted", "unexplored", "unreachable", "cut off"):
        assert values[f"{name} area"] == plain["floor"][f"{name.replace(' ', '_')}_area_m2"]
    for name in ("counted", "unexplored", "unreachable"):
        assert values[name] == 100 * plain["floor"][f"{name}_share"]
    assert values["notes"] == len(plain["environment"]["notes"])


def test_headings_are_told_apart_where_they_matter(building, sonar):
    report = document(audit(AmbiguityMap(synthetic.dataset(headings=4)), building, sonar, places=1))
    plain = {zone.zone: zone for zone in report.zones}
    for name, zone in plain.items():
        assert QUANTITIES[f"{name} at best heading"].read(report) == 100 * zone.share_best_heading
        assert QUANTITIES[f"{name} at worst heading"].read(report) == 100 * zone.share_worst_heading


def test_where_names_a_place_of_the_zone(report):
    outcome = judge(parse_condition("open > 0 %", QUANTITIES), report)
    place = next(place for place in report.places if place.zone == "open")
    assert f"x = {place.x_m:.1f} m, y = {place.y_m:.1f} m" in outcome.text


def test_aliasing_that_was_not_sought_is_no_passed_condition(report):
    with pytest.raises(InputError, match="add --aliasing"):
        judge(parse_condition("aliased area > 1 m2", QUANTITIES), report)


def test_floor_that_was_not_examined_is_no_passed_condition(report):
    floor = report.floor.model_copy(update={"counted_area_m2": 0.0})
    nothing = report.model_copy(update={"floor": floor})
    with pytest.raises(InputError, match="no floor is explored and reachable"):
        judge(parse_condition("open > 2 %", QUANTITIES), nothing)
    assert judge(parse_condition("counted area < 5 m2", QUANTITIES), nothing).holds


@pytest.mark.slow
def test_status_3_where_a_condition_holds_and_all_files_are_there(folder):
    gate = ("--fail-if", "corridor > 1 %", "--fail-if", "open > 99 %")
    files = ("--junit", "ci/junit.xml", "--sarif", "ci/gate.sarif")
    result = run(*gate, *files, "--aliasing")
    assert result.exit_code == 3, result.output
    assert "failed: corridor is" in result.stdout and "passed: open is" in result.stdout
    assert (folder / "out" / "report.html").is_file()
    assert 'failures="1"' in (folder / "ci" / "junit.xml").read_text()
    (found,) = json.loads((folder / "ci" / "gate.sarif").read_text())["runs"][0]["results"]
    uri = found["locations"][0]["physicalLocation"]["artifactLocation"]["uri"]
    assert uri == "plan.geojson"


@pytest.mark.slow
def test_status_0_where_none_holds_and_json_stays_json(folder):
    result = run("--fail-if", "open > 99 %", "--fail-if", "aliased > 99 %", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["aliasing"]["sought"]
    assert result.stderr.count("passed: ") == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--fail-if", "opne > 2 %"), "did you mean 'open'"),
        (("--fail-if", "open > 2 m"), "open is in %"),
        (("--fail-if", "open >"), "at position 7 it ends where a number is expected"),
        (("--junit", "j.xml"), "needs a condition to report"),
        (("--fail-if", "open > 2 %", "--sarif", "out/s.sarif"), "lies in the report's folder"),
        (
            ("--fail-if", "open > 2 %", "--sarif", "new/../out/s.sarif"),
            "lies in the report's folder",
        ),
        (("--fail-if", "open > 2 %", "--sarif", "a", "--junit", "a"), "name two files"),
        (("--fail-if", "open > 2 %", "--junit", "."), "this is a folder"),
        (("--fail-if", "aliased > 2 %", "--no-aliasing"), "leave --no-aliasing out"),
    ],
)
def test_bad_gates_are_refused_before_the_work(folder, options, message):
    before = {item.name for item in folder.iterdir()}
    result = run(*options)
    assert result.exit_code == 2, result.output
    assert message in result.stderr and result.stderr.count("\n") == 1
    assert {item.name for item in folder.iterdir()} == before


@pytest.mark.parametrize("command", ["audit", "diff"])
def test_list_names_all_figures_without_a_map(command):
    result = CliRunner().invoke(app, [command, "--fail-if", "list"])
    assert result.exit_code == 0, result.output
    wanted = "longest open stretch" if command == "audit" else "new open area"
    assert wanted in result.stdout
