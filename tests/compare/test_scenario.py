"""Scenario files: what they mean, and one sentence for whatever is wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ambinav.compare.scenario_file import load_scenario, parse_scenario
from ambinav.errors import InputError
from ambinav.localization.parameters import MclParameters
from tests.compare.conftest import write

Plain = dict[str, Any]
ROOT = Path(__file__).parents[2]


def test_the_localizer_is_told_how_odometry_errs(scenario: Plain) -> None:
    scenario["odometry"] = {"alpha1": 0.4, "scale": 0.5}
    scenario["localizer"] = {"alpha2": 0.3}
    guide = parse_scenario(scenario, "x.yaml", "x").guide
    assert isinstance(guide, MclParameters)
    assert guide.alpha1 == pytest.approx(0.1)
    assert guide.alpha2 == 0.3
    assert guide.alpha3 == pytest.approx(0.05)


def test_names_and_baseline(scenario: Plain) -> None:
    scenario["routes"] = ["reference", "shortest", {"kind": "ambiguity", "weight": 2, "name": "a"}]
    read = parse_scenario(scenario, "x.yaml", "x")
    assert [part.name for part in read.routes] == ["reference", "shortest", "a"]
    assert read.baseline == "shortest"
    scenario["routes"] = ["reference"]
    assert parse_scenario(scenario, "x.yaml", "x").baseline == "reference"


def test_the_demo_writes_its_alphas_out() -> None:
    read = load_scenario(ROOT / "configs" / "compare-demo.yaml").scenario
    told = read.guide
    assert isinstance(told, MclParameters) and isinstance(read.localizer, dict)
    for name in ("alpha1", "alpha2", "alpha3", "alpha4"):
        assert read.localizer[name] == getattr(read.odometry, name) * read.odometry.scale**2


BAD: dict[str, tuple[Callable[[Plain], object], str]] = {
    "unknown part": (lambda p: p.update(robt={}), "the key 'robt' is unknown; did you mean robot"),
    "unknown key": (
        lambda p: p["drive"].update(run=3),
        "drive: the key 'run' is unknown; did you mean runs",
    ),
    "unknown number": (lambda p: p["robot"].update(radus=1), "did you mean radius"),
    "unknown parameter": (
        lambda p: p["localizer"].update(alpha9=1),
        "localizer: the parameter 'alpha9' is unknown; did you mean alpha",
    ),
    "unknown kind": (
        lambda p: p["routes"].append("shortst"),
        "routes[2]: kind is 'shortst'; did you mean shortest.",
    ),
    "unknown localizer": (lambda p: p.update(localizer="odomtry"), "did you mean odometry"),
    "zero seeds": (lambda p: p["drive"].update(runs=0), "drive.runs is 0; it should be greater"),
    "not a number": (lambda p: p["robot"].update(radius="x"), "robot: radius is 'x'; give a"),
    "negative": (lambda p: p["robot"].update(radius=-1), "x.yaml: robot: radius is -1; give"),
    "unheard": (
        lambda p: p["routes"].append({"kind": "shortest", "weight": 1}),
        "routes[2]: weight means nothing to a route of the kind 'shortest'",
    ),
    "nameless planner": (
        lambda p: p["routes"].append({"kind": "planner"}),
        "needs the key 'planner'",
    ),
    "twice": (lambda p: p["routes"].append("shortest"), "routes: 'shortest' is there twice"),
    "no pairs": (lambda p: p.pop("pairs"), "the key 'pairs' is missing; add it."),
    "empty pairs": (lambda p: p.update(pairs=[]), "pairs is []"),
    "no goal": (lambda p: p["pairs"][0].pop("goal"), "the key 'pairs[0].goal' is missing"),
    "reserved": (lambda p: p["pairs"][0].update(name="all pairs"), "is the name of the rows"),
    "pair of a file": (
        lambda p: p["routes"].append({"kind": "file", "file": "a.csv", "pair": "ther"}),
        "which is not there; did you mean there",
    ),
    "part": (lambda p: p.update(map=3), "map: give a mapping with the keys spacing"),
}


@pytest.mark.parametrize(("spoil", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_sentence(
    scenario: Plain, spoil: Callable[[Plain], object], message: str
) -> None:
    spoil(scenario)
    with pytest.raises(InputError) as error:
        parse_scenario(scenario, "x.yaml", "x")
    told = str(error.value)
    assert told.startswith("x.yaml") and message in told and told.endswith(".")
    assert "\n" not in told


def test_missing_files(scenario: Plain, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.yaml: the file cannot be read"):
        load_scenario(tmp_path / "no.yaml")
    with pytest.raises(InputError, match=r"environment: there is no file .*gone\.geojson"):
        load_scenario(write(tmp_path, {**scenario, "environment": "gone.geojson"}))
    with pytest.raises(InputError, match=r"scanner: there is no scanner preset 'hokuyo-urg-04l'"):
        load_scenario(write(tmp_path, {**scenario, "scanner": "hokuyo-urg-04l"}))
