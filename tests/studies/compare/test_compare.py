"""Whole comparisons through the command: the same table however it was made, and bad input."""

from __future__ import annotations

import copy
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from ambinav.cli import app
from ambinav.routes.files import load_route, save_route
from ambinav.studies.compare.report import STUDY
from tests.studies.compare.conftest import SCENARIO, write


def compare(scenario: Path, out: Path, *more: str) -> Result:
    words = ["compare", str(scenario), "-o", str(out), "--no-store", *more]
    return CliRunner().invoke(app, words)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished comparison by one process; its scenario lies beside it."""
    folder = tmp_path_factory.mktemp("compare")
    found = compare(write(folder, SCENARIO), folder / "out", "--jobs", "1")
    assert found.exit_code == 0, found.output
    assert "reference 5" in found.output
    return folder / "out"


def test_what_is_written(done: Path) -> None:
    report = json.loads((done / "report.json").read_text())
    assert report["format"] == "ambinav-compare/1" and report["baseline"] == "shortest"
    rows = {row["route"]: row["figures"] for row in report["rows"]}
    assert set(rows) == {"shortest", "reference 5"}
    assert rows["shortest"]["arrived"]["value"]["value"] == 100.0
    assert rows["shortest"]["length"]["value"]["value"] == pytest.approx(
        report["plans"][0]["length_m"], rel=0.01
    )
    for row, plan in zip(report["rows"], report["plans"], strict=True):
        route = load_route(done / plan["file"])
        assert plan["corridor_m"] == row["planned"]["corridor_m"] == round(route.corridor_metres, 3)
        assert plan["longest_corridor_m"] == round(route.longest_corridor, 3)
        assert plan["open_m"] == row["planned"]["open_m"] == round(route.open_metres, 3)
        assert row["planned"]["longest_open_m"] == round(route.longest_open, 3)
    assert len(list((done / "work").glob("*.npz"))) == 4
    for name in (*report["pictures"]["there"], *(plan["file"] for plan in report["plans"])):
        assert (done / name).stat().st_size > 500
    text = (done / "report.md").read_text()
    for name in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (done / name).is_file()
    assert text.index("## Verdict") < text.index("## There")
    check_tables(text)


def check_tables(text: str) -> None:
    """Check that each table of a Markdown text has equally many columns throughout."""
    tables = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    assert len(tables) >= 5
    for table in tables:
        bars = {len(re.findall(r"(?<!\\)\|", line)) for line in table.splitlines()}
        assert len(bars) == 1, table


@pytest.mark.sweep
def test_any_name_is_shown_as_it_is(tmp_path: Path) -> None:
    scenario = copy.deepcopy(SCENARIO)
    scenario["routes"][1]["name"] = "a|b <1>"
    scenario["drive"]["runs"] = 2
    result = compare(write(tmp_path, scenario), tmp_path / "out", "--jobs", "1")
    assert result.exit_code == 0, result.output
    text = (tmp_path / "out" / "report.md").read_text()
    check_tables(text)
    assert "a\\|b &lt;1>" in text and "<1>" not in text.replace("&lt;1>", "")
    assert "a|b &lt;1&gt;" in (tmp_path / "out" / "report.html").read_text()


def test_the_html_stands_alone(done: Path) -> None:
    html = (done / "report.html").read_text()
    # Leaflet's text, which no element is made of, names its own site.
    marked = re.sub(r"<script>.*?</script>", "", html, flags=re.DOTALL)
    sources = re.findall(r'(?:src|href)="([^#].{0,30})', marked)
    assert len(sources) == 4 and all(s.startswith("data:image/png;base64") for s in sources)
    assert "{{" not in html


@pytest.mark.slow
def test_the_html_shows_the_routes_of_each_pair(done: Path, chromium: Any) -> None:
    report = json.loads((done / "report.json").read_text())
    context = chromium.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto((done / "report.html").as_uri())
    page.wait_for_selector(".map[data-shown]")
    cards = page.locator(".route-card")
    cards.first.wait_for()
    pair = report["plans"][0]["pair"]
    plans = [plan for plan in report["plans"] if plan["pair"] == pair]
    assert cards.count() == len(plans)
    for card, plan in zip(cards.all_inner_texts(), plans, strict=True):
        assert plan["route"] in card
        assert f"{plan['length_m']:.1f}" in card
    assert page.locator(".actions li").count() == 3
    assert page.locator(".badge.start").count() == 1
    assert faults == []
    context.close()


@pytest.mark.sweep
def test_two_processes_find_the_same(done: Path, tmp_path: Path) -> None:
    found = compare(done.parent / "flat.yaml", tmp_path / "two", "--jobs", "2", "--json")
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["format"] == "ambinav-compare/1"
    assert (tmp_path / "two" / "table.csv").read_text() == (done / "table.csv").read_text()


@pytest.mark.slow
def test_it_goes_on_where_it_was_interrupted(done: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(done, out)
    files = sorted((out / "work").glob("*.npz"))
    kept = {path: path.stat().st_mtime_ns for path in files[1:]}
    files[0].unlink()
    (out / "table.csv").unlink()
    assert compare(done.parent / "flat.yaml", out, "--jobs", "1").exit_code == 0
    assert files[0].is_file()
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert (out / "table.csv").read_text() == (done / "table.csv").read_text()


@pytest.mark.sweep
def test_killed_and_called_again(done: Path, tmp_path: Path) -> None:
    """Whatever was done when it was killed, the same command gives the same tables."""
    out = tmp_path / "out"
    command = [
        sys.executable, "-m", "ambinav.cli", "compare", str(done.parent / "flat.yaml"),
        "-o", str(out), "--jobs", "1", "--no-store",
    ]  # fmt: skip
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait(lambda: any((out / "work").glob("*.npz")) or running.poll() is not None)
        children = Path(f"/proc/{running.pid}/task/{running.pid}/children").read_text().split()
    finally:
        running.kill()
        running.wait()
    assert any((out / "work").glob("*.npz")) and not (out / "table.csv").exists()
    # Whoever drove for it is gone as well.
    wait(lambda: not any(is_alive(child) for child in children))
    # As if it had been killed while it wrote.
    for left in (out / ".report.html.abc", out / "work" / ".map-1.zarr.abc"):
        left.mkdir()
        (left / "half").write_text("half")
    again = compare(done.parent / "flat.yaml", out, "--jobs", "2")
    assert again.exit_code == 0, again.output
    assert (out / "table.csv").read_bytes() == (done / "table.csv").read_bytes()
    resumed, wanted = (json.loads((folder / "report.json").read_text()) for folder in (out, done))
    assert resumed | {"created": ""} == wanted | {"created": ""}
    assert not [path for path in out.rglob("*") if path.name.startswith(".")]


def wait(until: Callable[[], bool]) -> None:
    end = time.monotonic() + 60.0
    while not until():
        assert time.monotonic() < end, "nothing happened for a minute"
        time.sleep(0.005)


def is_alive(process: str) -> bool:
    """Whether a process runs; one that only waits to be buried does not."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_two_at_once_are_refused(done: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with STUDY.folder.hold(out):
        check_refused(compare(done.parent / "flat.yaml", out), "another run is at work")
    assert [item.name for item in out.rglob("*")] == ["work", "lock"]


@pytest.mark.slow
def test_what_an_earlier_scenario_left_goes(done: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(done, out)
    plain = {**SCENARIO, "pairs": [{"name": "other", "start": [1, 1], "goal": [7, 2]}]}
    path = write(tmp_path, {**plain, "routes": ["shortest"]})
    assert compare(path, out, "--jobs", "1", "--episodes", "1").exit_code == 0
    assert [item.name for item in (out / "routes").iterdir()] == ["01-other-shortest.csv"]
    assert len(list(out.glob("*.png"))) == 4


@pytest.mark.slow
def test_other_inputs_are_driven_anew(done: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(done, out)
    plain = {**SCENARIO, "drive": {**SCENARIO["drive"], "seed": 4}}
    assert compare(write(tmp_path, plain), out, "--jobs", "1").exit_code == 0
    assert len(list((out / "work").glob("*.npz"))) == 8
    assert (out / "table.csv").read_text() != (done / "table.csv").read_text()


def with_file(done: Path, folder: Path, shift: float, goal: float = 0.0) -> dict[str, Any]:
    """A scenario with a saved route that was shifted along y, and likewise its goal's x."""
    route = load_route(next((done / "routes").glob("*shortest.csv")))
    route.poses[1:-1, 1] += shift
    route.poses[-1, 0] += goal
    save_route(route, folder / "saved.csv")
    return {**SCENARIO, "routes": ["shortest", {"kind": "file", "file": "saved.csv"}]}


@pytest.mark.slow
def test_a_saved_route_is_driven(done: Path, tmp_path: Path) -> None:
    path = write(tmp_path, with_file(done, tmp_path, 0.0))
    assert compare(path, tmp_path / "out", "--jobs", "1", "--episodes", "2").exit_code == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [plan["route"] for plan in report["plans"]] == ["shortest", "saved.csv"]
    difference = report["rows"][1]["figures"]["error_p95"]["difference"]
    # The same path and the same seeds.
    assert difference["value"] == 0.0


@pytest.mark.parametrize(
    ("shift", "goal", "message"),
    [
        (50.0, 0.0, "outside of the map; give a route in the map's frame"),
        (-0.95, 0.0, "give a route that leaves room for a robot of 0.1 m"),
        (0.0, -1.0, "it ends at (6, 2) m and the pair at (7, 2); give a route of this pair"),
    ],
    ids=["leaves the map", "meets a wall", "another goal"],
)
def test_routes_that_do_not_fit(
    done: Path, tmp_path: Path, shift: float, goal: float, message: str
) -> None:
    path = write(tmp_path, with_file(done, tmp_path, shift, goal))
    check_refused(compare(path, tmp_path / "out", "--jobs", "1"), message)


def check_refused(found: Result, message: str) -> None:
    assert found.exit_code == 2, found.output
    assert message in found.stderr
    assert found.stderr.startswith("ambinav: error: ") and found.stderr.count("\n") == 1


BAD_ROUTES = {
    "missing file": ({"kind": "file", "file": "no.csv"}, "no.csv: the file cannot be read"),
    "unknown planner": ({"kind": "planner", "planner": "rrtstr"}, "did you mean rrtstar"),
}


@pytest.mark.parametrize(("route", "message"), BAD_ROUTES.values(), ids=BAD_ROUTES.keys())
def test_bad_routes(tmp_path: Path, route: dict[str, str], message: str) -> None:
    path = write(tmp_path, {**SCENARIO, "routes": [route]})
    check_refused(compare(path, tmp_path / "out"), message)


def test_bad_calls(tmp_path: Path) -> None:
    path = write(tmp_path, SCENARIO)
    for option in ("--episodes", "--jobs"):
        check_refused(compare(path, tmp_path / "out", option, "0"), f"{option}: 0 is too few")
    check_refused(compare(tmp_path / "no.yaml", tmp_path / "out"), "the file cannot be read")
    check_refused(compare(path, tmp_path), "flat.geojson, which is not of an earlier comparison")
    check_refused(compare(path, path), "this is a file, not a folder")
    plain = {**SCENARIO, "pairs": [{"start": [3.5, 1.5], "goal": [7, 2]}]}
    check_refused(compare(write(tmp_path, plain), tmp_path / "out"), "start (3.5, 1.5) is")
    assert not (tmp_path / "out" / "report.json").exists()
