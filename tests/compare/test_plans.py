"""Routes of every kind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ambinav.ambiguity.build import build_map
from ambinav.compare.plans import make_plans
from ambinav.compare.scenario_file import load_scenario
from tests.compare.conftest import write


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


def test_the_comparison_needs_no_planners_to_be_imported() -> None:
    code = (
        "import ambinav.compare.report, ambinav.compare.runs, sys; "
        "print([name for name in sys.modules if name.startswith(('ompl', 'ambinav_planners'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
