"""Forecasts of planned routes: those of `ambinav.forecast`, or the reason why there is none."""

from __future__ import annotations

import json

import pytest

import ambinav as an
from ambinav.forecasting.document import forecast_document
from ambinav.server.jobs.route_forecasts import route_forecasts
from ambinav_planners import RoutePlanner
from tests.server.live import Live

ENDS = {"start": [1, 1], "goal": [10, 2]}
SONARS = an.RangeScanner.from_preset("polaroid-6500-ring").to_yaml()
RAISED = an.RangeScanner.from_preset("rplidar-a1").raised(0.3).to_yaml()
ROBOT = {"odometry": "amcl-default", "localizer": "amcl"}


@pytest.fixture(scope="module")
def route(corridor: an.AmbiguityMap) -> an.Route:
    return RoutePlanner(corridor).plan((1, 1), (10, 2), weight=3.0)


@pytest.mark.slow
def test_a_plan_carries_the_forecast_of_its_route(
    live: Live, corridor: an.AmbiguityMap, route: an.Route
) -> None:
    for body, robot in ((ROBOT, ROBOT), ({}, {"odometry": "mediocre", "localizer": "product"})):
        answer = live.http.post("/v1/maps/map/plan", json=ENDS | body | {"weight": 3.0}).json()
        forecast = an.forecast(corridor, route, **robot)
        wanted = json.loads(json.dumps(forecast_document(forecast, robot["odometry"])))
        assert answer["forecast"] == wanted
        assert answer["forecast_reason"] is None
    request = ENDS | ROBOT | {"weights": [0, 3]}
    front = live.http.post("/v1/maps/map/pareto", json=request).json()
    forecast = an.forecast(corridor, route, **ROBOT)
    assert front[1]["forecast"]["lost_probability"] == forecast.lost_probability > 0.0


@pytest.mark.parametrize(
    ("field", "name", "offer"),
    [
        ("odometry", "pour", "odometry is 'pour'; did you mean poor"),
        ("localizer", "/etc/mine.yaml", "choose from amcl, product"),  # no file is opened
    ],
)
def test_an_unknown_robot_is_a_problem(live: Live, field: str, name: str, offer: str) -> None:
    for path in ("plan", "pareto"):
        answer = live.http.post(f"/v1/maps/map/{path}", json=ENDS | {field: name})
        assert answer.status_code == 422
        assert answer.json()["field"] == field
        assert offer in answer.json()["detail"]


def test_a_map_offers_the_classes_that_its_scanner_suits(live: Live) -> None:
    offered = live.get("/v1/maps/map")["forecast"]
    assert [entry["name"] for entry in offered["localizers"]] == ["amcl", "product"]
    assert [entry["name"] for entry in offered["odometries"]] == [
        "good", "mediocre", "poor", "amcl-default",
    ]  # fmt: skip
    assert offered["odometries"][1]["title"] == "4.5 degrees off after a metre"
    assert (offered["odometry"], offered["localizer"]) == ("mediocre", "product")
    assert {len(live.get("/v1/maps/narrow-room")["forecast"]["localizers"])} == {2}


def _with(amap: an.AmbiguityMap, **attrs: str | None) -> an.AmbiguityMap:
    """The map with other attributes; None: without it."""
    data = amap.dataset.assign_attrs(attrs)
    data.attrs = {name: value for name, value in data.attrs.items() if value is not None}
    return an.AmbiguityMap(data, source="office")


@pytest.mark.parametrize(
    ("attrs", "localizer", "reason"),
    [
        ({"environment_space": "checksum", "scanner_yaml": RAISED}, "product", "building in space"),
        ({"scanner_yaml": None}, "product", "does not name its scanner"),
        ({"parameters": '{"map_std": 0.01}'}, "product", "its parameters lack tau"),
        ({"scanner_yaml": SONARS}, "amcl", "'amcl' was not calibrated for this"),
    ],
)
def test_where_there_is_no_forecast_there_is_a_reason(
    corridor: an.AmbiguityMap,
    route: an.Route,
    attrs: dict[str, str | None],
    localizer: str,
    reason: str,
) -> None:
    answers = route_forecasts(_with(corridor, **attrs), [route, route], "poor", localizer)
    assert [answer["forecast"] for answer in answers] == [None, None]
    assert reason in answers[1]["forecast_reason"]


def test_a_route_off_the_floor_leaves_the_others_their_forecasts(
    corridor: an.AmbiguityMap, route: an.Route
) -> None:
    through_the_wall = an.Route.through([[9.0, 2.0], [14.0, 2.0]])
    off, on = route_forecasts(corridor, [through_the_wall, route], "poor", "product")
    assert off["forecast"] is None
    assert "not on free floor" in off["forecast_reason"]
    assert on["forecast"]["text"].endswith(".")
