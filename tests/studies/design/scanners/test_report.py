"""The folder that a comparison of scanners leaves, and the command that writes it."""

from __future__ import annotations

import csv
import io
import json
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.routes.files import load_route
from ambinav.runtime.errors import InputError
from ambinav.studies.design.scanners.document import Document, document, summary, table_csv
from ambinav.studies.design.scanners.report import draw_bars, draw_fronts, draw_maps, write_report
from tests.test_cli import PLAN

QUICK = ("--spacing", "0.4", "--pairs", "2", "--no-store")
TWO = ("-s", "rplidar-a1", "-s", "turtlebot3-lds")


class Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.text = ""

    def handle_starttag(self, tag, attrs):
        self.links += [value for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def written(table, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("report") / "out"
    write_report(table, folder)
    return folder


@pytest.mark.sweep
def test_all_files_say_the_same(table, written):
    names = ["fronts.png", "maps.png", "report.html", "report.json", "report.md"]
    assert sorted(path.name for path in written.iterdir()) == [*names, "scanners.png", "table.csv"]
    report = Document.model_validate_json((written / "report.json").read_text())
    assert report == document(table)
    lines = list(csv.DictReader(io.StringIO((written / "table.csv").read_text())))
    assert [line["name"] for line in lines] == [one.name for one in report.scanners]
    for line, one in zip(lines, report.scanners, strict=True):
        for name in ("bad_area_m2", "mean_error_m", "price", "max_range_m", "bad_share"):
            value = getattr(one, name)
            assert line[name] == ("" if value is None else str(value))
        assert line["lacking"] == ("gfm" if one.name == "ring" else "")
        assert bool(line["layer_gfm"]) == (one.name != "ring")
    page = Page()
    page.feed((written / "report.html").read_text())
    assert len(page.links) == 3 and all(link.startswith("data:image/png") for link in page.links)
    markdown = (written / "report.md").read_text()
    for one in report.scanners:
        for text in (page.text, markdown):
            assert one.name in text and f"{one.bad_area_m2:,.1f}" in text
    for text in (page.text, markdown):
        assert "cannot have gfm" in text and "Censi 2007" in text
        assert "costs.csv: no price or power is given for: ahead." in text
    tables = [part for part in markdown.split("\n\n") if part.startswith("|")]
    assert [table.count("\n") for table in tables[:2]] == [5, 5]
    for lines in (table.splitlines() for table in tables):
        assert {line.count("|") for line in lines} == {lines[0].count("|")}


@pytest.mark.slow
def test_the_pictures_are_pictures(table, written):
    for name in ("scanners", "maps", "fronts"):
        with Image.open(written / f"{name}.png") as picture:
            assert min(picture.size) > 300
    bars = draw_bars(table)
    assert [axes.get_xlabel() for axes in bars.axes] == [
        "bad area (m²)", "longest open stretch of a route (m)", "expected error on routes (m)",
    ]  # fmt: skip
    drawn = sum(bar.get_width() for bar in bars.axes[0].patches)
    assert drawn == pytest.approx(sum(row.bad_area for row in table.rows))
    maps = draw_maps(table).axes
    assert len(maps) == 4
    scales = {round(axes.get_window_extent().width / 10, 3) for axes in maps}
    assert len(scales) == 1 and len({axes.get_xlim() for axes in maps}) == 1
    panels = [axes for axes in draw_fronts(table).axes if axes.axison]
    assert [axes.get_xlabel() for axes in panels] == [
        "price", "power (W)", "beams of a scan", "range (m)", "expected error on routes (m)",
    ]  # fmt: skip


@pytest.mark.slow
def test_sampled_routes_can_be_given_again(sampled, tmp_path):
    write_report(sampled, tmp_path / "out")
    for i, route in enumerate(sampled.routes, start=1):
        again = load_route(tmp_path / "out" / f"route-{i:02d}.csv")
        assert (again.poses == route.poses).all()
        assert sum(again.zone_metres.values()) == pytest.approx(again.length)


@pytest.mark.slow
def test_an_interrupt_leaves_what_was_there(table, tmp_path):
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_report(table, tmp_path / "out", stop)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(InputError, match=r"holds thesis\.tex"):
        write_report(table, tmp_path / "mine")


def test_the_summary_names_the_best_the_worst_and_the_front(table, sampled):
    text = summary(table)
    assert text.startswith("4 scanners were compared in hall on a robot of radius 0.20 m. long ")
    assert "By bad area and price, " in text
    alone = summary(sampled)
    assert alone.startswith("1 scanner was compared") and "the most" not in alone
    assert "dominated" not in alone
    assert table_csv(document(sampled)).count("\n") == 2


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "plan.geojson").write_text(json.dumps(PLAN))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str):
    return CliRunner().invoke(app, ["design", "scanners", *arguments])


@pytest.mark.slow
def test_the_command_prints_and_writes(folder):
    (folder / "costs.yaml").write_text("rplidar-a1: {price: 99}\nturtlebot3-lds: {price: 70}\n")
    first = run("plan.geojson", *TWO, *QUICK, "-o", "out", "--costs", "costs.yaml")
    assert first.exit_code == 0, first.output
    assert "2 scanners were compared" in first.stdout and "price" in first.stdout
    assert "report: out/report.html" in first.stdout
    assert max(map(len, first.stdout.splitlines())) <= 80
    second = run("plan.geojson", *TWO, *QUICK, "-o", "out", "--pictures", "svg")
    assert second.exit_code == 0, second.output
    assert (folder / "out" / "maps.svg").exists() and not (folder / "out" / "maps.png").exists()


@pytest.mark.slow
def test_json_is_all_that_is_printed(folder):
    route = ("--route", "given.csv")
    once = run("plan.geojson", *TWO, *QUICK, "-o", "out")
    assert once.exit_code == 0, once.output
    (folder / "given.csv").write_bytes((folder / "out" / "route-01.csv").read_bytes())
    result = run("plan.geojson", "-s", "rplidar-a1", *TWO, *QUICK, *route, "--json")
    assert result.exit_code == 0, result.output
    report = Document.model_validate_json(result.stdout)
    assert [one.name for one in report.scanners].count("rplidar-a1") == 1
    assert "3 scanners are given; 2 of them are different" in result.stderr
    assert report.routes is not None and not report.routes.sampled
    assert len(report.routes.points_m) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "--scanner: none is given; name some with --scanner, or take all presets with --all"),
        (("-s", "rplidar-a11"), "did you mean rplidar-a1"),
        ((*TWO, "--pairs", "-1"), "--pairs: -1 is negative"),
        ((*TWO, "--seed", "-1"), "--seed: -1 is negative"),
        ((*TWO, "--odometry-scale", "-1"), "--odometry-scale: -1 is not zero or above"),
        ((*TWO, "--localizer-beams", "0"), "--localizer-beams: 0 is too few"),
        ((*TWO, "--pictures", "gif"), "--pictures: 'gif' is not a picture format"),
        ((*TWO, "--robot-radius", "0"), "--robot-radius: 0 is not above zero"),
        ((*TWO, "--robot-radius", "60"), "fits nowhere"),
        ((*TWO, "--spacing", "500"), "--spacing: 500 m is larger than the building"),
        ((*TWO, "--layers", "fischer"), "fischer"),
        ((*TWO, "--costs", "none.csv"), "none.csv: the file cannot be read"),
        ((*TWO, "--route", "none.csv"), "none.csv: the file cannot be read"),
        ((*TWO, "--route", "plan.geojson"), "this is not a route of ambinav"),
        ((*TWO, "-o", "plan.geojson"), "this is a file, not a folder"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(folder, arguments, message):
    result = run("plan.geojson", *arguments)
    assert result.exit_code == 2, result.output
    (line,) = [line for line in result.stderr.splitlines() if "error" in line]
    assert message in line and line.startswith("ambinav: error: ")
