"""The audit's forecasts: those of `Forecaster` on sampled routes, in document and report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from ambinav.buildings.load import load_environment
from ambinav.cli import app
from ambinav.forecasting.causes import OPEN
from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.forecasting.reliability import bin_at
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.sampled import sample_routes
from ambinav.routes.trip_routes import trip_routes
from ambinav.routes.trips import Trip, read_trips
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.audit.audit import Audit, audit
from ambinav.studies.audit.lost_routes import (
    MEASURED,
    PAIRS,
    SEED,
    STEP,
    ReliabilityPart,
    find_lost_routes,
    lost_part,
)
from ambinav.studies.audit.report import write_audit
from tests.geometry import scenes

CORNER, MIDDLE, EAST = (2.0, 2.0), (15.0, 12.0), (28.0, 20.0)
TRIPS = (
    Trip("corner", "beside | it", CORNER, (2.0, 5.0)),
    Trip("corner", "east", CORNER, EAST),
    Trip("middle", "corner", MIDDLE, CORNER),
)


@pytest.fixture(scope="module")
def hall() -> Environment:
    """A hall of 30 by 24 m."""
    return scenes.room(30.0, 24.0)


@pytest.fixture(scope="module")
def hall_map(hall: Environment, laser: RangeScanner) -> AmbiguityMap:
    """The hall for a laser that reaches 4 m."""
    return build_map(hall, laser, spacing=0.5)


@pytest.fixture(scope="module")
def examined(hall: Environment, hall_map: AmbiguityMap, laser: RangeScanner) -> Audit:
    reach = find_reach(hall, 0.2)
    result = audit(hall_map, hall, laser, places=1, reach=reach)
    return replace(result, lost=find_lost_routes(result.amap, hall, reach))


@pytest.mark.slow
def test_they_are_those_of_sampled_routes(examined: Audit) -> None:
    lost = examined.lost
    assert lost is not None
    routes = sample_routes(
        examined.environment, examined.reach, PAIRS, np.random.default_rng(SEED), step=STEP
    )
    shares = Forecaster(examined.amap, ODOMETRY, LOCALIZER).lost_probabilities(routes)
    assert [f.lost_probability for f in lost.forecasts] == sorted(shares.tolist(), reverse=True)
    assert lost.share_safe == np.mean(shares < 0.05)
    assert 0.0 < lost.share_safe < 1.0
    # Robots get lost in the middle, where no wall is in range.
    worst = lost.worst[0].causes[0]
    assert worst.kind == OPEN
    assert 4.0 < worst.x < 26.0
    assert 4.0 < worst.y < 20.0


@pytest.mark.slow
def test_document_and_reports_name_them(examined: Audit, tmp_path: Path) -> None:
    assert examined.lost is not None
    report = write_audit(examined, tmp_path / "out")
    assert report.lost == lost_part(examined.lost)
    written = json.loads((tmp_path / "out" / "report.json").read_text())["lost"]
    assert written["pairs"] == PAIRS
    assert 1 <= len(written["routes"]) <= 5
    texts = [(tmp_path / "out" / name).read_text() for name in ("report.md", "report.html")]
    for route, forecast in zip(written["routes"], examined.lost.worst, strict=True):
        assert route["text"] == forecast.sentence
        assert route["lost_probability"] == pytest.approx(forecast.lost_probability, abs=1e-4)
        assert route["start_m"] == pytest.approx(forecast.poses[0, :2], abs=1e-3)
        assert all(route["text"] in text for text in texts)
    safe = round(examined.lost.share_safe * PAIRS)
    sentence = f"On {safe} of {PAIRS} shortest routes between sampled places fewer than 5 %"
    assert all(sentence in text for text in texts)


def test_where_nothing_can_be_sampled(hall_map: AmbiguityMap) -> None:
    tiny = scenes.room(0.45, 0.45)
    with pytest.raises(InputError, match="two places"):
        find_lost_routes(hall_map, tiny, find_reach(tiny, 0.2))


def test_those_of_trips_are_all_listed_by_name(
    hall: Environment, hall_map: AmbiguityMap, laser: RangeScanner, tmp_path: Path
) -> None:
    reach = find_reach(hall, 0.2)
    lost = find_lost_routes(hall_map, hall, reach, trips=TRIPS, odometry="good", localizer="amcl")
    routes = trip_routes(hall, reach, TRIPS)
    shares = Forecaster(hall_map, "good", "amcl").lost_probabilities(routes)
    worst_first = np.argsort(-shares)
    assert lost.trips == tuple(TRIPS[k] for k in worst_first)
    assert [f.lost_probability for f in lost.forecasts] == shares[worst_first].tolist()
    assert shares[0] < 0.05 < shares[1]
    audited = audit(hall_map, hall, laser, places=0, reach=reach, lost=lost)
    assert audited.lost is lost
    report = write_audit(audited, tmp_path / "out")
    part = report.lost
    assert part is not None
    assert (part.odometry, part.localizer, part.pairs) == ("good", "amcl", 3)
    assert [(r.start, r.goal) for r in part.routes] == [(t.start, t.goal) for t in lost.trips]
    for route, trip, k in zip(part.routes, lost.trips, worst_first, strict=True):
        assert (route.start_m, route.goal_m) == (trip.start_at, trip.goal_at)
        assert route.lost_probability == pytest.approx(shares[k], abs=1e-4)
        measured = bin_at(LocalizerClass.load("amcl").reliability, shares[k])
        assert measured is not None
        assert route.lost_probability_reliability == ReliabilityPart.of(measured)
        assert measured.routes == route.lost_probability_reliability.routes
    assert "On 1 of 3 trips between named places" in part.text
    assert "with good odometry and Monte Carlo localization with AMCL's defaults" in part.text
    markdown, page = (
        (tmp_path / "out" / name).read_text() for name in ("report.md", "report.html")
    )
    assert "| corner (2.0, 2.0 m) | beside \\| it (2.0, 5.0 m) |" in markdown
    assert "beside | it (2.0, 5.0 m)" in page
    for text in (markdown, page):
        assert MEASURED in text
        assert all(route.measured_text in text for route in part.routes)


def test_trips_that_cannot_be_driven_are_refused(hall: Environment, hall_map: AmbiguityMap) -> None:
    reach = find_reach(hall, 0.2)

    def find(trip: Trip = TRIPS[0], **more: str) -> None:
        find_lost_routes(hall_map, hall, reach, trips=[trip], **more)  # type: ignore[arg-type]

    with pytest.raises(
        InputError, match=r"trips: places: out at \(40, 2\) m is outside of .*; move it"
    ):
        find(Trip("corner", "out", CORNER, (40.0, 2.0)))
    with pytest.raises(InputError, match="odometry is 'wheels'; "):
        find(odometry="wheels")
    with pytest.raises(InputError, match="localizer is 'kalman', which has no calibration; "):
        find(localizer="kalman")


@pytest.mark.slow
def test_the_command_forecasts_the_trips_of_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, laser: RangeScanner
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hall.wkt").write_text("POLYGON ((0 0, 16 0, 16 8, 0 8, 0 0))")
    (tmp_path / "laser.yaml").write_text(laser.to_yaml())
    (tmp_path / "places.yaml").write_text("places: {west: [1.5, 4], east: [14.5, 4]}")
    words = ["audit", "hall.wkt", "-s", "laser.yaml", "--spacing", "0.5", "--no-store", "-o", "out"]
    words += ["--no-aliasing", "--no-advice", "--save-map", "map.zarr", "--places", "0", "--json"]
    result = CliRunner().invoke(app, [*words, "--trips", "places.yaml", "--odometry", "poor"])
    assert result.exit_code == 0, result.output
    lost = json.loads(result.stdout)["lost"]
    assert (lost["odometry"], lost["localizer"]) == ("poor", "product")
    hall, trips = load_environment("hall.wkt"), read_trips("places.yaml")
    amap = AmbiguityMap.open("map.zarr")
    routes = trip_routes(hall, find_reach(hall, 0.2), trips)
    shares = Forecaster(amap, "poor", environment=hall).lost_probabilities(routes)
    by_name = {
        (route["start"], route["goal"]): route["lost_probability"] for route in lost["routes"]
    }
    assert by_name == {
        (trip.start, trip.goal): pytest.approx(p, abs=1e-4)
        for trip, p in zip(trips, shares, strict=True)
    }


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--trips", "none.yaml"], "none.yaml: the file cannot be read"),
        (["--trips", "walled.yaml"], "walled.yaml: places: west at (0.05, 4) m is "),
        (["--trips", "out.yaml"], "out.yaml: places: east at (44.5, 4) m is outside of"),
        (["--trips", "places.yaml", "--odometry", "wheels"], "--odometry: odometry is 'wheels'; "),
        (["--localizer", "kalman"], "--localizer: localizer is 'kalman', which has no calibration"),
    ],
)
def test_the_command_refuses_them_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ambinav.cli.map_options.MapOptions.build", None)
    (tmp_path / "hall.wkt").write_text("POLYGON ((0 0, 16 0, 16 8, 0 8, 0 0))")
    for name, west, east in (("places", 1.5, 14.5), ("walled", 0.05, 14.5), ("out", 1.5, 44.5)):
        text = f"places: {{west: [{west}, 4], east: [{east}, 4]}}"
        (tmp_path / f"{name}.yaml").write_text(text)
    words = ["audit", "hall.wkt", "-s", "turtlebot3-lds", "-o", "out", "--no-store", *more]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2, result.output
    (error,) = result.stderr.splitlines()
    assert message in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("more", [[], ["--no-advice"]])
def test_trips_without_a_forecast_are_refused_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: list[str]
) -> None:
    """In a passage that no cell of the map lies in."""
    monkeypatch.chdir(tmp_path)
    hall = shapely.box(0.0, 0.0, 8.0, 4.0).union(shapely.box(8.0, 1.02, 14.0, 1.23))
    (tmp_path / "hall.wkt").write_text(hall.wkt)
    (tmp_path / "places.yaml").write_text("places: {west: [9, 1.125], east: [13, 1.125]}")
    words = ["audit", "hall.wkt", "-s", "turtlebot3-lds", "-o", "out", "--no-store", *more]
    words += ["--spacing", "0.5", "--robot-radius", "0.05", "--places", "0", "--no-aliasing"]
    result = CliRunner().invoke(app, [*words, "--trips", "places.yaml", "--save-map", "map.zarr"])
    assert result.exit_code == 2, result.output
    (error,) = (line for line in result.stderr.splitlines() if "note: " not in line)
    assert error.startswith("ambinav: error: places.yaml: route: ") and "smaller spacing" in error
    assert {path.name for path in tmp_path.iterdir()} == {"hall.wkt", "places.yaml"}
