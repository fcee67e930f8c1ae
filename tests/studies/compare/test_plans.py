"""Routes of every kind."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.information_field import InformationField
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputWarning
from ambinav.studies.compare import plans as plans_module
from ambinav.studies.compare.plans import make_plans
from ambinav.studies.compare.scenario_file import load_scenario
from ambinav_planners.belief.model import BeliefModel
from tests.studies.compare.conftest import write


@pytest.mark.slow
def test_every_kind(scenario: dict[str, Any], tmp_path: Path) -> None:
    scenario["routes"] = [
        "shortest", "clearance", "ambiguity", "belief", "belief-roadmap", "reference",
        {"kind": "planner", "planner": "rrtstar", "weight": 2, "seed": 4},
    ]  # fmt: skip
    scenario["planning"] = {"iterations": 300}
    loaded = load_scenario(write(tmp_path, scenario))
    amap = build_map(loaded.environment, loaded.scanner, spacing=0.2)
    plans = make_plans(loaded, amap)
    routes = {plan.name: plan.route for plan in plans}
    assert [route.planner for route in routes.values()] == [
        "reference", "prmstar", "prmstar", "belief", "belief-roadmap", "reference", "rrtstar",
    ]  # fmt: skip
    assert routes["rrtstar 2"].seed == 4 and routes["rrtstar 2"].weight == 2.0
    assert routes["clearance"].clearance_weight > 0.0 == routes["clearance"].weight
    for route in routes.values():
        assert route.length >= routes["shortest"].length - 1e-6
    # No clock decides: the same routes again.
    for first, second in zip(plans, make_plans(loaded, amap), strict=True):
        np.testing.assert_array_equal(first.route.poses, second.route.poses)


@pytest.mark.slow
def test_routes_are_planned_as_the_command_plan_plans(
    scenario: dict[str, Any], tmp_path: Path
) -> None:
    """By the reference where nothing is given, and no route costs more than another of its pair."""
    scenario["routes"] = ["shortest", "clearance", "ambiguity", {"kind": "reference", "weight": 5}]
    loaded = load_scenario(write(tmp_path, scenario))
    amap = build_map(loaded.environment, loaded.scanner, spacing=0.2)
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        routes = {plan.name: plan.route for plan in make_plans(loaded, amap)}
    assert {route.planner for route in routes.values()} == {"reference"}
    np.testing.assert_array_equal(routes["ambiguity"].poses, routes["reference 5"].poses)
    scenario["planning"] = {"space": "se2"}
    for pair in scenario["pairs"]:
        pair["start"], pair["goal"] = [*pair["start"], 0.0], [*pair["goal"], 0.0]
    scenario["routes"] = ["ambiguity"]
    loaded = load_scenario(write(tmp_path, scenario))
    assert {plan.route.planner for plan in make_plans(loaded, amap)} == {"prmstar"}


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.1, 0.5])
def test_belief_is_planned_for_the_robot_that_is_driven(
    scenario: dict[str, Any], tmp_path: Path, scale: float
) -> None:
    """Odometry and start of the scenario, against a filter that is run along the routes."""
    scenario["routes"] = ["belief", "belief-roadmap"]
    scenario["planning"] = {"iterations": 300}
    scenario["odometry"] = {"scale": scale, "alpha4": 0.1}
    scenario["drive"] = {"start_std": [0.04, 0.09], "start_heading_std_deg": 2.0}
    loaded = load_scenario(write(tmp_path, scenario))
    amap = build_map(loaded.environment, loaded.scanner, spacing=0.2)
    first = np.diag([0.04, 0.09, math.radians(2.0)]) ** 2
    for plan in make_plans(loaded, amap):
        covariances = plan.route.covariances
        assert covariances is not None
        if plan.name.startswith("belief-roadmap"):
            found = filtered(plan.route.poses, loaded.scenario.odometry, amap, first)
            np.testing.assert_allclose(covariances[0], first, rtol=1e-9)
            for k in range(len(found)):
                size = np.sqrt(np.diag(found[k]))
                assert (np.abs(covariances[k] - found[k]) <= 0.02 * np.outer(size, size)).all()
        else:
            np.testing.assert_allclose(covariances[0, :2, :2], 0.09**2 * np.eye(2))


def filtered(
    poses: NDArray[np.float64], noise: OdometryNoise, amap: AmbiguityMap, first: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Covariances at the nodes of a straight-line route, by a Kalman filter in small steps."""
    information, scan_distance = InformationField.of(amap), BeliefModel().scan_distance
    covariance, out = first[None], [first]
    heading = None
    for a, b in itertools.pairwise(poses[:, :2]):
        length, bearing = float(np.hypot(*(b - a))), math.atan2(*(b - a)[::-1])
        if heading is not None:
            turn = (bearing - heading + math.pi) % math.tau - math.pi
            steps = np.zeros((201, 3))
            steps[:, 2] = heading + np.linspace(0.0, turn, 201)
            covariance = reckoned(steps, noise, covariance)
        heading = bearing
        count = math.ceil(length / 0.25 - 1e-9)
        for k in range(count):
            steps = np.full((26, 3), bearing)
            steps[:, :2] = a + np.linspace(k / count, (k + 1) / count, 26)[:, None] * (b - a)
            covariance = reckoned(steps, noise, covariance)
            gained = information.at(steps[-1:])[0] * length / count / scan_distance
            covariance = np.linalg.inv(np.linalg.inv(covariance) + gained)
        out.append(covariance[0])
    return out


def reckoned(
    steps: NDArray[np.float64], noise: OdometryNoise, covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What `OdometryNoise.spread` makes of a covariance, shape (1, 3, 3), step by step."""
    for before, after in itertools.pairwise(steps):
        covariance = noise.spread(before[None], covariance, before[None], after[None])
    return covariance


@pytest.mark.slow
def test_the_comparison_needs_no_planners_to_be_imported() -> None:
    code = (
        "import ambinav.studies.compare.report, ambinav.studies.compare.runs, sys; "
        "print([name for name in sys.modules if name.startswith(('ompl', 'ambinav_planners'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_route_that_costs_more_than_another_is_named(
    scenario: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario["routes"] = ["shortest", "ambiguity"]
    loaded = load_scenario(write(tmp_path, scenario))
    amap = build_map(loaded.environment, loaded.scanner, spacing=0.2)
    pair, (shortest, ambiguity) = loaded.scenario.pairs[0], loaded.scenario.routes
    straight = plans_module._planned(loaded, amap, pair, shortest)
    middle = straight.poses.copy()
    there_and_back = np.concatenate([middle, middle[-2::-1], middle[1:]])
    detour = replace(straight, poses=there_and_back)
    monkeypatch.setattr(
        plans_module, "_planned",
        lambda *given: detour if given[3] is ambiguity else straight,
    )  # fmt: skip
    with pytest.warns(InputWarning, match=r"route 'ambiguity': it costs .* 'shortest' only"):
        make_plans(loaded, amap)


def test_a_belief_route_may_cost_more(
    scenario: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not planned for the least cost."""
    scenario["routes"] = ["shortest", "belief"]
    loaded = load_scenario(write(tmp_path, scenario))
    amap = build_map(loaded.environment, loaded.scanner, spacing=0.2)
    pair, (shortest, belief) = loaded.scenario.pairs[0], loaded.scenario.routes
    straight = plans_module._planned(loaded, amap, pair, shortest)
    poses = np.concatenate([straight.poses, straight.poses[-2::-1], straight.poses[1:]])
    detour = replace(straight, poses=poses)
    monkeypatch.setattr(
        plans_module, "_planned", lambda *given: detour if given[3] is belief else straight
    )
    assert len(make_plans(loaded, amap)) == 2  # warnings are errors
