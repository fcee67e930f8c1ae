"""Costs, levels and rewards over HTTP, against the service in the same process."""

from __future__ import annotations

import json
import math
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

import ambinav as an
from ambinav.geometry.motion.steering import Steering
from ambinav.server.http.models import CostPoses, Poses, Steps
from ambinav.server.http.plans import ParetoRequest
from ambinav.server.http.poses import _metres
from ambinav.server.limits import Limits
from ambinav.server.wire import POSE_COLUMNS, STEP_COLUMNS
from tests.server.live import Live

COLUMNS = (*POSE_COLUMNS, *STEP_COLUMNS, "weights")
OCTETS = {"content-type": "application/octet-stream"}
Floats = NDArray[np.float64]


def poses(count: int, amap: an.AmbiguityMap) -> tuple[Floats, Floats, Floats]:
    """Poses in and around a map; some are nowhere."""
    rng = np.random.default_rng(7)
    xmin, ymin, xmax, ymax = amap.bounds
    x, y = rng.uniform(xmin - 1, xmax + 1, count), rng.uniform(ymin - 1, ymax + 1, count)
    x[:3] = math.nan, math.inf, -math.inf
    return x, y, rng.uniform(-9, 9, count)


def post(live: Live, what: str, columns: dict[str, Floats], **query: Any) -> Floats:
    answer = live.http.post(
        f"/v1/maps/narrow-room/{what}",
        content=b"".join(column.tobytes() for column in columns.values()),
        params={"columns": ",".join(columns), **query},
        headers=OCTETS,
    )
    assert answer.status_code == 200, answer.text
    return np.frombuffer(answer.content)


@pytest.mark.parametrize("count", [0, 3, 700])
def test_binary_costs_are_the_services_bit_for_bit(
    live: Live, turning: an.AmbiguityMap, count: int
) -> None:
    x, y, theta = (part[:count] for part in poses(700, turning))
    found = post(live, "cost", {"theta": theta, "x": x, "y": y}, weight=2.5)
    wanted = an.AmbiguityService(turning, weight=2.5).cost(x, y, theta)
    np.testing.assert_array_equal(found, wanted)


def test_binary_levels_and_rewards_are_the_services(live: Live, turning: an.AmbiguityMap) -> None:
    x, y, theta = poses(600, turning)
    found = post(live, "level", {"x": x, "y": y, "theta": theta}, layer="minor")
    np.testing.assert_array_equal(found, turning.sample("minor", x, y, theta))
    x, y, theta = x[3:], y[3:], theta[3:]
    ends = {"x0": x, "y0": y, "x1": x[::-1], "y1": y[::-1], "theta0": theta, "theta1": theta}
    service = an.AmbiguityService(turning)
    np.testing.assert_array_equal(post(live, "reward", ends), service.reward(*ends.values()))


def test_json_says_null_and_why(live: Live, turning: an.AmbiguityMap) -> None:
    x, y, theta = poses(200, turning)
    body = {"x": x[3:].tolist(), "y": y[3:].tolist(), "theta": theta[3:].tolist()}
    answer = live.http.post("/v1/maps/narrow-room/cost", json=body)
    found = answer.json()
    wanted = an.AmbiguityService(turning).cost(x[3:], y[3:], theta[3:])
    assert [math.inf if one is None else one for one in found["cost"]] == wanted.tolist()
    for cost, reason in zip(found["cost"], found["reason"], strict=True):
        assert (cost is None) == (reason is not None)
    assert {"outside", None} <= set(found["reason"])


def test_numbers_that_json_has_not_do_not_break_the_answer(live: Live) -> None:
    body = '{"x": [NaN, Infinity, 1e999, 1.0], "y": [1, -Infinity, 0, 1.0]}'
    for what, key in (("cost", "cost"), ("level", "level")):
        answer = live.http.post(
            f"/v1/maps/map/{what}", content=body, headers={"content-type": "application/json"}
        )
        assert answer.status_code == 200
        found = json.loads(answer.text, parse_constant=pytest.fail)
        assert found[key][:3] == [None] * 3
        assert found["reason"] == ["outside"] * 3 + [None]
    body = '{"x0": [NaN], "y0": [1], "x1": [1], "y1": [1]}'
    answer = live.http.post(
        "/v1/maps/map/reward", content=body, headers={"content-type": "application/json"}
    )
    assert answer.status_code == 422


def test_a_batch_may_have_one_row(live: Live, corridor: an.AmbiguityMap) -> None:
    one = {"x": [1.0], "y": [1.0]}
    for what, key in (("cost", "cost"), ("level", "level")):
        found = live.http.post(f"/v1/maps/map/{what}", json=one).json()
        assert found["reason"] == [None] and found[key][0] > 0.0
    assert corridor.sample("level", [1.0], [1.0]) == corridor.sample("level", 1.0, 1.0)


def test_a_single_cost_is_the_services(live: Live, corridor: an.AmbiguityMap) -> None:
    service = an.AmbiguityService(corridor, "major", 2.0)
    for x, y in ((1.0, 1.0), (7.3, 1.9)):
        query = {"x": x, "y": y, "layer": "major", "weight": 2.0}
        assert live.get("/v1/maps/map/cost", **query) == {
            "cost": service.cost(x, y), "reason": None,
        }  # fmt: skip


def test_curves_are_rewarded_as_the_service_does(live: Live, corridor: an.AmbiguityMap) -> None:
    from ambinav.geometry.motion.steering import Steering

    step = {"x0": [1.0], "y0": [1.0], "x1": [2.0], "y1": [2.0], "theta0": [0.0], "theta1": [1.0]}
    moves = {"steering": "dubins", "turning_radius": 0.4}
    answer = live.http.post("/v1/maps/map/reward", json=step | moves)
    wanted = an.AmbiguityService(corridor).reward(
        1.0, 1.0, 2.0, 2.0, 0.0, 1.0, Steering("dubins", 0.4)
    )
    assert answer.json() == {"reward": [wanted]}


@pytest.mark.parametrize(
    ("what", "body", "status", "message"),
    [
        ("cost", "{", 400, "not valid JSON"),
        ("cost", "[]", 422, "body"),
        ("cost", '{"x": [1]}', 422, "y"),
        ("cost", '{"x": [1], "y": [1, 2]}', 422, "x 1, y 2"),
        ("cost", '{"x": ["1"], "y": [1]}', 422, "x.0"),
        ("cost", '{"x": [true], "y": [1]}', 422, "x.0"),
        ("cost", '{"x": [1], "y": [1], "weight": -1}', 422, "weight"),
        ("cost", '{"x": [1], "y": [1], "weight": 1e300}', 422, "not finite"),
        ("cost", '{"x": [1], "y": [1], "layer": "levle"}', 422, "did you mean level"),
        ("cost", '{"x": [1], "y": [1], "layer": "zone"}', 422, "not an amount"),
        ("cost", '{"x": [1], "y": [1], "colour": 1}', 422, "colour"),
        ("level", '{"x": [1], "y": [1], "layer": "../level"}', 422, "no such layer"),
        ("reward", '{"x0": [1], "y0": [1], "x1": [1]}', 422, "y1"),
        ("reward", '{"x0":[1],"y0":[1],"x1":[1],"y1":[1],"steering":"dubins"}', 422, "radius"),
    ],
)
def test_a_body_that_cannot_be_used_is_a_problem(
    live: Live, what: str, body: str, status: int, message: str
) -> None:
    answer = live.http.post(
        f"/v1/maps/map/{what}", content=body, headers={"content-type": "application/json"}
    )
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert message in answer.json()["detail"]


@pytest.mark.parametrize(
    ("body", "columns", "message"),
    [
        (b"1234567", "x,y", "7 bytes"),
        (b"", "x,z", "columns is"),
        (b"", "x,x", "columns is"),
        (b"", "x", "lacks y"),
    ],
)
def test_binary_columns_that_cannot_be_used_are_a_problem(
    live: Live, body: bytes, columns: str, message: str
) -> None:
    answer = live.http.post(
        "/v1/maps/map/cost", content=body, params={"columns": columns}, headers=OCTETS
    )
    assert answer.status_code == 422
    assert message in answer.json()["detail"]


def test_a_heading_that_is_missing_and_a_foreign_type_are_problems(live: Live) -> None:
    answer = live.http.get("/v1/maps/narrow-room/cost", params={"x": 1, "y": 1})
    assert (answer.status_code, "give theta" in answer.text) == (422, True)
    answer = live.http.post(
        "/v1/maps/map/cost", content=b"x,y", headers={"content-type": "text/csv"}
    )
    assert answer.status_code == 415


def test_a_batch_of_too_many_rows_is_refused(serve: Any, corridor: an.AmbiguityMap) -> None:
    live = serve([corridor], limits=Limits(batch=10))
    many = np.ones(11)
    answer = httpx.post(
        f"{live.url}/v1/maps/environment/cost", content=many.tobytes() * 2, headers=OCTETS
    )
    assert answer.status_code == 413
    assert "at most 10" in answer.json()["detail"]


def test_json_is_taken_up_to_a_size(serve: Any, corridor: an.AmbiguityMap) -> None:
    live = serve([corridor], limits=Limits(json=100))
    answer = live.http.post("/v1/maps/environment/cost", json={"x": [1.5] * 50, "y": [1.5] * 50})
    assert answer.status_code == 413
    assert "binary form" in answer.json()["detail"]


@pytest.mark.parametrize("model", [Poses, CostPoses, Steps, ParetoRequest])
def test_of_many_wrong_numbers_one_is_told(model: type[BaseModel]) -> None:
    # A complaint about each of a million takes gigabytes, and ten seconds that nobody is answered.
    wrong = {name: ["no"] * 1000 for name in model.model_fields if name in COLUMNS}
    with pytest.raises(ValidationError) as caught:
        model.model_validate(wrong)
    assert len([one for one in caught.value.errors() if len(one["loc"]) == 2]) == len(wrong)


@pytest.mark.parametrize(
    "step",
    [
        {"x1": 1e300},
        {"x1": -1e9},
        {"theta0": 0, "theta1": 1, "steering": "dubins", "turning_radius": 1e9},
    ],
)
def test_steps_that_travel_round_the_world_are_refused(live: Live, step: Any) -> None:
    ends = {"x0": 1.0, "y0": 1.0, "x1": 2.0, "y1": 1.0} | step
    body = {n: v if n in ("steering", "turning_radius") else [v] for n, v in ends.items()}
    answer = live.http.post("/v1/maps/map/reward", json=body)
    assert answer.status_code == 413
    assert "send at most 5e+07 m" in answer.json()["detail"]


def test_no_step_is_longer_than_what_it_is_taken_for() -> None:
    rng = np.random.default_rng(3)
    ends = {name: rng.uniform(-9, 9, 2000) for name in ("x0", "y0", "theta0", "x1", "y1", "theta1")}
    a, b = (np.column_stack([ends[f"{n}{i}"] for n in ("x", "y", "theta")]) for i in (0, 1))
    for moves in (None, Steering("dubins", 4.0), Steering("reeds-shepp", 4.0)):
        metres = _metres(ends, moves, 1e9)
        assert (moves or Steering("se2")).lengths(a, b).sum() <= metres * (1 + 1e-9)


@pytest.mark.parametrize(
    ("what", "query", "remedy"),
    [
        ("cost", {"layer": "minor"}, "layer in the query is only for a binary body; give 'layer'"),
        ("cost", {"weight": "2"}, "give 'weight' in the body."),
        ("level", {"columns": "x,y"}, "columns in the query is only for a binary body; leave"),
        ("reward", {"steering": "dubins"}, "give 'steering' in the body."),
    ],
)
def test_a_query_beside_a_body_in_json_is_not_passed_over(
    live: Live, what: str, query: dict[str, str], remedy: str
) -> None:
    names = STEP_COLUMNS if what == "reward" else POSE_COLUMNS
    answer = live.http.post(
        f"/v1/maps/narrow-room/{what}", json={name: [1.0] for name in names}, params=query
    )
    assert answer.status_code == 422
    assert remedy in answer.json()["detail"] and answer.json()["field"] in query


@pytest.mark.parametrize("weight", ["inf", "nan", "-1"])
def test_what_the_core_refuses_names_its_parameter(live: Live, weight: str) -> None:
    query = {"x": "1", "y": "1", "weight": weight}
    answer = live.http.get("/v1/maps/map/cost", params=query)
    assert (answer.status_code, answer.json()["field"]) == (422, "weight")
