"""What docs/planning.md tells an OMPL user to write is run as it stands there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ompl import base as ob
from ompl import geometric as og

from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.files import load_route, save_route
from ambinav.service.service import AmbiguityService
from ambinav_planners.objective import AmbiguityObjective
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.route_graph import RouteGraph
from tests.planners.test_objective import information

PAGE = Path(__file__).parents[2] / "docs" / "planning.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
BOUNDS = (45.0, 28.0)


def block(text: str) -> str:
    """Return the only piece of code on the page that holds a text."""
    (found,) = (code for code in BLOCKS if text in code)
    return found


def bounds() -> ob.RealVectorBounds:
    limits = ob.RealVectorBounds(2)
    for axis, high in enumerate(BOUNDS):
        limits.setLow(axis, 0.0)
        limits.setHigh(axis, high)
    return limits


@pytest.mark.slow
def test_the_first_program_of_the_page(
    demo_map: AmbiguityMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    demo_map.save(tmp_path / "office.zarr")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(BLOCKS[0], str(PAGE), "exec"), names)
    environment = demo_map.environment
    start, goal = (3.0, 3.0), (12.0, 6.0)
    for seconds in (3.0, 9.0, 27.0):  # the clock decides; a busy machine takes longer
        poses = names["plan"](
            lambda state: bool(environment.is_free(state[0], state[1], 0.2)),
            start, goal, bounds(), seconds=seconds,
        )  # fmt: skip
        if poses is not None:
            assert poses[0] == pytest.approx(start)
            assert poses[-1] == pytest.approx(goal)
            return
    pytest.fail("no path reached the goal")


def test_the_lines_for_other_spaces(demo: AmbiguityService) -> None:
    si = ob.SpaceInformation(ob.RealVectorStateSpace(3))
    names = {"AmbiguityObjective": AmbiguityObjective, "service": demo, "si": si}
    exec(block("flying ="), names)
    objective: Any = names["flying"]
    state = si.allocState()
    state[0], state[1], state[2] = 3.0, 3.0, 1.0
    assert objective.stateCost(state).value() == pytest.approx(demo.cost(3.0, 3.0))
    compound = ob.CompoundStateSpace()
    compound.addSubspace(ob.SE2StateSpace(), 1.0)
    compound.addSubspace(ob.SO2StateSpace(), 1.0)
    si = ob.SpaceInformation(compound)
    names["si"] = si
    exec(block("arm ="), names)
    objective = names["arm"]
    state = si.allocState()
    state[0].setX(3.0)
    state[0].setY(3.0)
    state[0].setYaw(0.0)
    assert objective.stateCost(state).value() == pytest.approx(demo.cost(3.0, 3.0))


@pytest.mark.slow
def test_the_lines_for_stops(
    demo_map: AmbiguityMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    demo_map.save(tmp_path / "office.zarr")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(block("Mission"), names)
    visited = names["visited"]
    assert sorted(visited.order) == [0, 1, 2]
    assert visited.arrivals[-1] < visited.route.length


@pytest.mark.slow
def test_the_lines_for_route_graphs(
    robot: RoutePlanner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    xy = robot.plan((3.0, 3.0), (28.0, 17.0)).poses[:, :2]
    pairs = np.column_stack([np.arange(len(xy) - 1), np.arange(1, len(xy))]).astype(np.int32)
    RouteGraph.numbered("route", xy, pairs).save(tmp_path / "graph.geojson", 0.0)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"service": robot.service}
    exec(block("RouteGraph"), names)
    np.testing.assert_allclose(names["route"].poses[[0, -1], :2], [[3.0, 3.0], [28.0, 17.0]])
    assert len(RouteGraph.read("priced.geojson").edges) == len(pairs)


@pytest.mark.slow
def test_the_lines_for_speed(
    demo: AmbiguityService, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    demo.map.save(tmp_path / "office.zarr")
    monkeypatch.chdir(tmp_path)
    route = evaluate_route(demo, [(3.0, 3.0, 0.0), (6.0, 3.0, 0.0)], Steering(), planner="by hand")
    save_route(route, "route.json")
    names: dict[str, Any] = {}
    exec(block("speed_profile"), names)
    assert names["joules"] > 20.0 * names["profile"].duration
    slower = load_route("slower.json")
    assert slower.duration == names["slower"].duration >= names["profile"].duration


@pytest.mark.slow
def test_the_lines_for_replanning(robot: RoutePlanner) -> None:
    names: dict[str, Any] = {"service": robot.service}
    exec(block("Replanner"), names)
    assert names["replan"].route.goal[:2] == (20.0, 8.0)
    assert 0.0 < names["progress"].remaining < names["replan"].route.length
    assert 0.0 <= names["proof"].gap < 0.2


def test_the_lines_for_the_footprint(demo: AmbiguityService) -> None:
    setup = og.SimpleSetup(information(Steering()))
    exec(
        block("FootprintMotionValidator"),
        {"setup": setup, "si": setup.getSpaceInformation(), "service": demo},
    )
    state = setup.getSpaceInformation().allocState()
    for x, free in ((3.0, True), (0.0, False)):
        state[0], state[1] = x, 3.0
        assert setup.getSpaceInformation().isValid(state) == free


@pytest.mark.sweep
def test_the_lines_for_flights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(block("FlightPlanner"), names)
    assert 1.0 <= names["price"] <= 6.0
    assert names["flight"].cost >= names["flight"].length > 19.0
    assert (tmp_path / "flight.png").exists()
