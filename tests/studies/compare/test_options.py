"""What a scenario can ask for besides routes: obstacles, people, localizers, spaces, exports."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner, Result

from ambinav.cli import app
from ambinav.geometry.motion.steering import Steering
from ambinav.map_building.build import build_map
from ambinav.routes.files import trace_route
from ambinav.runtime.errors import InputError
from ambinav.studies.compare.plans import make_plans
from ambinav.studies.compare.scenario_file import load_scenario
from ambinav.studies.compare.worlds import make_worlds
from tests.studies.compare.conftest import write

POLICY = '''
from ambinav.geometry.motion.steering import Steering
from ambinav.routes.evaluate import evaluate_route
from ambinav.service.service import AmbiguityService

def above(environment, scanner, amap, pair):
    """Around the obstacle on its upper side."""
    corners = sorted([(2.5, 2.5), (4.5, 2.5)], reverse=pair.goal[0] < pair.start[0])
    places = [pair.start, *corners, pair.goal]
    poses = [(x, y, 0.0) for x, y, *_ in places]
    return evaluate_route(AmbiguityService(amap), poses, Steering(), planner="above")

def alone():
    pass

def through(environment, scanner, amap, pair):
    poses = [(*pair.start[:2], 0.0), (*pair.goal[:2], 0.0)]
    return evaluate_route(AmbiguityService(amap), poses, Steering(), planner="through")

def nothing(environment, scanner, amap, pair):
    return [pair.start, pair.goal]

def fails(environment, scanner, amap, pair):
    return 1 / 0
'''


def compare(scenario: Path, out: Path, *more: str) -> Result:
    words = ["compare", str(scenario), "-o", str(out), "-j", "1", "--no-store", *more]
    return CliRunner().invoke(app, words)


@pytest.mark.slow
def test_costs_may_read_a_layer_that_is_made_for_them(
    scenario: dict[str, Any], tmp_path: Path
) -> None:
    scenario["map"] = {"spacing": 0.2, "layer": "position"}
    scenario["routes"] = ["shortest", "reference"]
    scenario["drive"] = {"runs": 2}
    done = compare(write(tmp_path, scenario), tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["parameters"]["map"]["layer"] == "position"
    assert "**Exposure**: the layer `position`" in (tmp_path / "out" / "report.md").read_text()


def test_a_scenario_reads_the_layer_that_suits_its_scanner(
    scenario: dict[str, Any], tmp_path: Path
) -> None:
    assert load_scenario(write(tmp_path, scenario)).scenario.map.layer == "level"
    scenario["scanner"] = "pioneer-sonar-laser"
    assert load_scenario(write(tmp_path, scenario)).scenario.map.layer == "position"


@pytest.mark.sweep
def test_reports_name_the_localizer_and_what_speaks_against_it(
    scenario: dict[str, Any], tmp_path: Path
) -> None:
    scenario |= {"scanner": "hc-sr04", "routes": ["shortest"], "drive": {"runs": 2}}
    scenario["localizer"] = {"type": "amcl", "max_particles": 500}
    path = write(tmp_path, scenario)
    done = compare(path, tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    assert done.stderr.count("laser_model_type likelihood_field takes every echo") == 1
    note = "so it loses robots where scanner 'hc-sr04', which has cones"
    for name in ("report.md", "report.html", "report.json"):
        text = (tmp_path / "out" / name).read_text().replace("&#39;", "'")
        assert note in text and "Monte Carlo localization (likelihood_field)" in text
    scenario["localizer"] = {"max_particles": 500}
    done = compare(write(tmp_path, scenario), tmp_path / "other", "--json")
    assert done.exit_code == 0 and "laser_model_type" not in done.stderr
    report = json.loads((tmp_path / "other" / "report.json").read_text())
    assert report["localizer"] == {
        "name": "Monte Carlo localization (beam_prob to the power 0.3)", "note": None,
    }  # fmt: skip
    assert report["parameters"]["localizer"]["z_max"] == 0.2


@pytest.mark.slow
def test_boxes_are_off_all_routes_and_the_same_for_each(
    scenario: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "p.py").write_text(POLICY)
    scenario["routes"] = ["shortest", {"kind": "policy", "policy": "p.py:above"}]
    scenario["pairs"].append({"name": "back", "start": [7, 2], "goal": [1, 1]})
    scenario["obstacles"] = {"count": 6, "sizes": [0.1, 0.2], "margin": 0.2}
    loaded = load_scenario(write(tmp_path, scenario), trust=True)
    amap = build_map(loaded.environment, loaded.scanner, spacing=0.2)
    plans = make_plans(loaded, amap)
    worlds = make_worlds(loaded, plans)
    assert set(worlds) == {"there", "back"}
    for pair, world in worlds.items():
        boxes = loaded.environment.free.difference(world.free)
        assert 6 * 0.01 * 0.5 < boxes.area < 6 * 0.04
        for plan in plans:
            if plan.pair == pair:
                line = shapely.LineString(trace_route(plan.route)[:, :2])
                assert line.distance(boxes) >= 0.1 + 0.2 - 1e-9
    again = make_worlds(loaded, plans)
    np.testing.assert_array_equal(worlds["there"].segments.xy, again["there"].segments.xy)
    assert worlds["there"].free.symmetric_difference(worlds["back"].free).area > 0.0
    scenario["obstacles"]["margin"] = 3.0
    with pytest.raises(InputError, match="obstacles, pair 'there': count is 6; there is room"):
        make_worlds(load_scenario(write(tmp_path, scenario), trust=True), plans)


@pytest.mark.sweep
def test_everything_at_once(scenario: dict[str, Any], tmp_path: Path) -> None:
    """People, boxes, a filter, a policy and exports in one comparison, closed loop."""
    (tmp_path / "p.py").write_text(POLICY)
    scenario |= {
        "people": {"count": 1, "speed": 0.5},
        "obstacles": {"count": 3, "sizes": [0.1, 0.2], "margin": 0.2},
        "localizer": {"type": "ekf", "gate": 4},
        "routes": ["shortest", {"kind": "policy", "policy": "p.py:above", "name": "above"}],
        "exports": {"runs": [2], "routes": ["above"]},
        "drive": {"runs": 3, "seed": 3},
    }
    path = write(tmp_path, scenario)
    out = tmp_path / "out"
    found = compare(path, out, "--trust")
    assert found.exit_code == 0, found.output
    report = json.loads((out / "report.json").read_text())
    assert report["plans"][1]["planner"] == "above"
    assert report["parameters"]["obstacles"]["count"] == 3
    assert report["parameters"]["localizer"]["gate"] == 4
    assert report["drives"] == ["drives/02-there-above"]
    folder = out / report["drives"][0] / "run-002"
    names = {file.name for file in folder.iterdir()}
    assert {"truth.tum", "estimate.tum", "odometry.tum", "drive.csv", "drive.log"} <= names
    # The drive that is written is the one that was measured.
    truth = np.loadtxt(folder / "truth.tum")
    length = np.hypot(*np.diff(truth[:, 1:3], axis=0).T).sum()
    stored = [np.load(file)["length"] for file in (out / "work").glob("*.npz")]
    assert min(abs(lengths[1] - length) for lengths in stored) < 1e-6
    # Nothing is done again.
    kept = (folder / "truth.tum").stat().st_mtime_ns
    assert compare(path, out, "--trust").exit_code == 0
    assert (folder / "truth.tum").stat().st_mtime_ns == kept
    # What is asked for now is there, and nothing else.
    of_tum = {"truth.tum", "estimate.tum", "odometry.tum"}
    for exports, wanted in (({"formats": ["tum"]}, of_tum), ({}, names)):
        write(tmp_path, scenario | {"exports": scenario["exports"] | exports})
        assert compare(path, out, "--trust").exit_code == 0
        assert {file.name for file in folder.iterdir()} == wanted
    write(tmp_path, scenario | {"exports": {}})
    assert compare(path, out, "--trust").exit_code == 0
    assert not list((out / "drives").iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("space", ["se2", "dubins", "reeds-shepp"])
def test_spaces(scenario: dict[str, Any], tmp_path: Path, space: str) -> None:
    radius = 0.0 if space == "se2" else 0.4
    scenario["planning"] = {"space": space, "turning_radius": radius, "iterations": 100}
    scenario["pairs"] = [{"name": "there", "start": [1, 1, 0], "goal": [7, 2, 90]}]
    scenario["routes"] = ["shortest"]
    loaded = load_scenario(write(tmp_path, scenario))
    amap = build_map(loaded.environment, loaded.scanner, spacing=0.2)
    (plan,) = make_plans(loaded, amap)
    assert plan.route.planner == "prmstar" and plan.route.steering == Steering(space, radius)
    np.testing.assert_allclose(plan.route.poses[[0, -1]], [[1, 1, 0], [7, 2, np.pi / 2]])


@pytest.mark.sweep
def test_a_car_that_knows_where_it_is(scenario: dict[str, Any], tmp_path: Path) -> None:
    """Curves are driven, and a localizer without errors gives pictures all the same."""
    scenario["planning"] = {"space": "reeds-shepp", "turning_radius": 0.4, "iterations": 100}
    scenario["pairs"] = [{"name": "there", "start": [1, 1, 0], "goal": [7, 2, 90]}]
    scenario["routes"] = ["shortest"]
    scenario["drive"] = {"runs": 2}
    scenario["localizer"] = "perfect"
    out = tmp_path / "out"
    found = compare(write(tmp_path, scenario), out)
    assert found.exit_code == 0, found.output
    assert "shortest is the only route; there is nothing to compare." in found.stdout
    report = json.loads((out / "report.json").read_text())
    (row,) = report["rows"]
    assert row["figures"]["arrived"]["value"]["value"] == 100.0
    assert row["figures"]["error_p95"]["value"]["value"] == 0.0


POLICIES = {
    "no colon": ("p.py", "policy is 'p.py'; give module:callable, or file.py:callable."),
    "no file": ("q.py:above", "there is no file"),
    "no module": ("no_such_module_here:f", "cannot be imported (ModuleNotFoundError"),
    "no callable": ("p.py:abov", "policy: p.py has no callable 'abov'"),
    "no route": ("p.py:nothing", "it returned a list; return an ambinav.routes.route.Route"),
    "through a wall": ("p.py:through", "reached through a wall; give a route that leaves room"),
    "other arguments": ("p.py:alone", "takes (), but is called with 4 arguments (Environment,"),
    "fails": ("p.py:fails", "failed (ZeroDivisionError: division by zero, p.py line 24); fix it"),
}


@pytest.mark.parametrize(("policy", "message"), POLICIES.values(), ids=POLICIES.keys())
def test_bad_policies(scenario: dict[str, Any], tmp_path: Path, policy: str, message: str) -> None:
    (tmp_path / "p.py").write_text(POLICY)
    scenario["routes"] = [{"kind": "policy", "policy": policy}]
    found = compare(write(tmp_path, scenario), tmp_path / "out", "--trust")
    assert found.exit_code == 2, found.output
    assert message in found.stderr and found.stderr.count("\n") == 1
    assert f"pair 'there', route '{policy}'" in found.stderr


@pytest.mark.slow
def test_modules_are_imported(scenario: dict[str, Any], tmp_path: Path) -> None:
    scenario["modules"] = ["m.py"]
    scenario["routes"] = [{"kind": "planner", "planner": "straight-on"}]
    path = write(tmp_path, scenario)
    (tmp_path / "m.py").write_text("1 / 0\n")
    found = compare(path, tmp_path / "out")
    assert found.exit_code == 2
    assert "modules: m.py cannot be imported (ZeroDivisionError" in found.stderr
    (tmp_path / "m.py").write_text(
        "import numpy as np\n"
        "from ambinav_planners.registry import PLANNERS, Planner, PlannerResult\n"
        "path = np.array([[1, 1, 0], [4.5, 0.6, 0], [7, 2, 0]], dtype=float)\n"
        "PLANNERS.register(Planner('straight-on', lambda *given: PlannerResult(path,\n"
        "                          finished=True), 'one path', uses_ompl=False))\n"
    )
    found = compare(path, tmp_path / "out", "--episodes", "1")
    try:
        assert found.exit_code == 0, found.output
        report = json.loads((tmp_path / "out" / "report.json").read_text())
        assert report["plans"][0]["planner"] == "straight-on"
    finally:
        from ambinav_planners.registry import PLANNERS

        PLANNERS._registered.pop("straight-on", None)
