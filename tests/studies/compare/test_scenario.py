"""Scenario files: what they mean, and one sentence for whatever is wrong with them."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from ambinav.drive.own_localizers import EkfParameters
from ambinav.localization.parameters import MclParameters
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.compare.scenario_file import ScenarioBundle, load_scenario, parse_scenario
from tests.studies.compare.conftest import write

Plain = dict[str, Any]
ROOT = Path(__file__).parents[3]


def test_the_localizer_knows_how_odometry_errs(scenario: Plain) -> None:
    scenario["odometry"] = {"alpha1": 0.4, "scale": 0.5}
    scenario["localizer"] = {"alpha2": 0.3}
    parameters = parse_scenario(scenario, "x.yaml", "x").chosen_localizer.parameters
    assert isinstance(parameters, MclParameters)
    assert parameters.alpha1 == pytest.approx(0.1)
    assert parameters.alpha2 == 0.3
    assert parameters.alpha3 == pytest.approx(0.05)


def test_kinds_of_localizers(scenario: Plain) -> None:
    scenario["odometry"] = {"alpha1": 0.4, "scale": 0.5}
    found = []
    for localizer in ("perfect", {"type": "odometry"}, {"type": "mcl"}, {"type": "ekf", "gate": 4}):
        scenario["localizer"] = localizer
        found.append(parse_scenario(scenario, "x.yaml", "x").chosen_localizer)
    assert [one.plain for one in found[:2]] == ["perfect", "odometry"]
    assert [one.title for one in found[:2]] == ["the truth", "dead reckoning"]
    assert isinstance(found[2].parameters, MclParameters)
    # Ten scans a second at 0.5 m/s and 2 rad/s: every 5 cm or 0.2 rad, not every 25 cm.
    assert found[3].parameters == EkfParameters(0.1, 0.25, 0.25, 0.05, gate=4)


def test_a_program_runs_only_if_it_is_trusted(scenario: Plain, tmp_path: Path) -> None:
    scenario["localizer"] = {"type": "program", "command": ["my_filter", "-n 500"]}
    path = write(tmp_path, scenario)
    with pytest.raises(InputError, match=r"another program \(my_filter '-n 500'\) .* --trust"):
        load_scenario(path)
    assert load_scenario(path, trust=True).scenario.chosen_localizer.spec.name == "program"


@pytest.mark.parametrize("rate", [5.0, 10.0])
def test_the_kalman_filter_believes_in_the_odometry_that_is_driven(
    scenario: Plain, rate: float
) -> None:
    """Over some metres, scan by scan, its variances are those of the simulated odometry."""
    scenario |= {"odometry": {"scale": 0.5}, "localizer": "ekf", "robot": {"max_speed": 0.25}}
    scenario["drive"] = {**scenario.get("drive", {}), "rate": rate}
    parsed = parse_scenario(scenario, "x.yaml", "x")
    parameters = parsed.chosen_localizer.parameters
    assert isinstance(parameters, EkfParameters)
    steps = round(4.0 * rate / 0.25)
    poses = np.column_stack([np.linspace(0.0, 4.0, steps + 1), np.zeros((steps + 1, 2))])
    modelled, true = np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
    for before, after in itertools.pairwise(poses[:, None]):
        modelled = parameters.odometry.covariances(before, modelled, before, after)
        true = parsed.odometry.spread(before, true, before, after)
    np.testing.assert_allclose(modelled, true, rtol=1e-9, atol=1e-15)
    on_the_spot = np.array([[[0.0, 0.0, k * 2.0 / rate]] for k in range(11)])
    modelled, true = np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
    for before, after in itertools.pairwise(on_the_spot):
        modelled = parameters.odometry.covariances(before, modelled, before, after)
        true = parsed.odometry.spread(before, true, before, after)
    np.testing.assert_allclose(modelled, true, rtol=1e-9, atol=1e-15)


def test_cones_are_localized_by_the_product_unless_said_otherwise(
    scenario: Plain, tmp_path: Path
) -> None:
    alphas = {f"alpha{k}": 0.2 * 0.25**2 for k in range(1, 5)}
    ring = RangeScanner.from_preset("hc-sr04")

    def parameters(localizer: object, scanner: str = "hc-sr04") -> object:
        scenario.update(localizer=localizer, scanner=scanner)
        return load_scenario(write(tmp_path, scenario)).scenario.chosen_localizer.parameters

    suited = MclParameters.for_scanner(ring, **alphas)
    assert suited.laser_model_type == "beam_prob"
    assert parameters({}) == parameters("mcl") == parameters({"type": "mcl"}) == suited
    # What is given stands, the rest is as it suits the scanner.
    given = {"z_hit": 0.6, "alpha1": 0.3, "beam_table_resolution": 0.0}
    assert parameters(given) == replace(suited, **given)
    # AMCL's own goes by its name, for any scanner; lasers have it anyhow.
    with pytest.warns(InputWarning, match=r"flat\.yaml: the localizer.*take what suits .*type mcl"):
        assert parameters("amcl") == MclParameters(**alphas)
    assert parameters({"type": "amcl", "laser_model_type": "beam"}) == MclParameters(
        laser_model_type="beam", **alphas
    )
    assert (
        parameters("amcl", "rplidar-a1")
        == parameters("mcl", "rplidar-a1")
        == MclParameters(**alphas)
    )
    with pytest.warns(InputWarning, match="likelihood_field_prob .* choose beam_prob"):
        assert parameters({"laser_model_type": "likelihood_field_prob"}) == MclParameters(
            laser_model_type="likelihood_field_prob", **alphas
        )
    assert isinstance(parameters("ekf"), EkfParameters)


def test_names_and_baseline(scenario: Plain) -> None:
    scenario["routes"] = ["reference", "shortest", {"kind": "ambiguity", "weight": 2, "name": "a"}]
    read = parse_scenario(scenario, "x.yaml", "x")
    assert [part.name for part in read.routes] == ["reference", "shortest", "a"]
    assert read.baseline == "shortest"
    scenario["routes"] = ["reference"]
    assert parse_scenario(scenario, "x.yaml", "x").baseline == "reference"


def test_the_demo_writes_its_alphas_out() -> None:
    read = load_scenario(ROOT / "configs" / "compare-demo.yaml").scenario
    parameters = read.chosen_localizer.parameters
    assert isinstance(parameters, MclParameters) and isinstance(read.localizer, dict)
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
        "localizer: the key 'alpha9' is unknown; did you mean alpha",
    ),
    "unknown kind": (
        lambda p: p["routes"].append("shortst"),
        "routes[2]: kind is 'shortst'; did you mean shortest.",
    ),
    "unknown localizer": (lambda p: p.update(localizer="odomtry"), "did you mean odometry"),
    "unknown type": (
        lambda p: p.update(localizer={"type": "efk"}),
        "x.yaml: localizer: there is no localizer 'efk'; did you mean ekf",
    ),
    "name with parameters": (
        lambda p: p.update(localizer={"type": "perfect", "gate": 3}),
        "localizer: gate means nothing to the localizer 'perfect'; drop it",
    ),
    "unknown filter parameter": (
        lambda p: p.update(localizer={"type": "ekf", "gates": 3}),
        "localizer: the key 'gates' is unknown; did you mean gate",
    ),
    "filter's gate": (
        lambda p: p.update(localizer={"type": "ekf", "gate": 0}),
        "localizer: gate is 0; give a number above 0",
    ),
    "too few particles": (
        lambda p: p["localizer"].update(max_particles=50),
        "x.yaml: localizer: max_particles is 50; give at least min_particles (100)",
    ),
    "people without a count": (
        lambda p: p.update(people={"radius": 0.2}),
        "people: the key 'count' is missing; add it",
    ),
    "obstacles": (lambda p: p.update(obstacles={"cout": 3}), "obstacles: the key 'cout' is"),
    "no deviation": (
        lambda p: p["drive"].update(start_std=[0.0, 0.05]),
        "drive.start_std[0] is 0.0; give a number above 0",
    ),
    "no deviation of the heading": (
        lambda p: p["drive"].update(start_heading_std_deg=0),
        "drive.start_heading_std_deg is 0",
    ),
    "runs that are true": (lambda p: p["drive"].update(runs=True), "runs is True; give a number"),
    "start_std": (
        lambda p: p["drive"].update(start_std=[0.05, 0.05, 0.02]),
        "drive.start_std is [0.05, 0.05, 0.02]; it should have at most 2 items",
    ),
    "four numbers": (
        lambda p: p.update(pairs=[{"start": [1, 1, 0, 0], "goal": [7, 2]}]),
        "give x and y in metres, and a heading in degrees if it matters",
    ),
    "sizes": (
        lambda p: p.update(obstacles={"count": 3, "sizes": [0.8, 0.3]}),
        "obstacles: sizes is [0.8, 0.3]; give the smallest edge first",
    ),
    "negative size": (
        lambda p: p.update(obstacles={"count": 3, "sizes": [0, 0.3]}),
        "obstacles.sizes[0] is 0; it should be greater than 0",
    ),
    "unknown space": (
        lambda p: p.update(planning={"space": "dubin"}),
        "planning: space is 'dubin'; did you mean dubins",
    ),
    "no radius": (
        lambda p: p.update(planning={"space": "dubins"}),
        "planning: turning_radius is missing, which the space dubins needs",
    ),
    "radius of nothing": (
        lambda p: p.update(planning={"turning_radius": 1}),
        "turning_radius does not apply to the space r2",
    ),
    "no heading": (
        lambda p: p.update(planning={"space": "se2"}),
        "pairs[0].start has no heading, which matters in the space se2",
    ),
    "too many exports": (
        lambda p: p.update(exports={"runs": 13}),
        "exports: there is no run 13; runs are counted from 1 to 12",
    ),
    "fewer than no runs": (
        lambda p: p.update(exports={"runs": -3}),
        "exports: runs is -3; give how many of each route, 0 or more",
    ),
    "run 0": (lambda p: p.update(exports={"runs": [0]}), "exports: there is no run 0"),
    "exported route": (
        lambda p: p.update(exports={"runs": 1, "routes": ["shortst"]}),
        "exports: there is no route 'shortst'; did you mean shortest",
    ),
    "policy without one": (lambda p: p["routes"].append({"kind": "policy"}), "needs the key 'po"),
    "pair without a route": (
        lambda p: p.update(
            pairs=[*p["pairs"], {"name": "back", "start": [7, 2], "goal": [1, 1]}],
            routes=[{"kind": "file", "file": "a.csv", "pair": "there"}],
        ),
        "pairs: 'back' has no route; add one, or drop the pair",
    ),
    "zero seeds": (lambda p: p["drive"].update(runs=0), "drive.runs is 0; it should be greater"),
    "not a number": (lambda p: p["robot"].update(radius="x"), "robot: radius is 'x'; give a"),
    "negative": (lambda p: p["robot"].update(radius=-1), "x.yaml: robot: radius is -1; give"),
    "unheard": (
        lambda p: p["routes"].append({"kind": "shortest", "weight": 1}),
        "routes[2]: weight is not a key of a route of the kind 'shortest'",
    ),
    "nameless planner": (
        lambda p: p["routes"].append({"kind": "planner"}),
        "needs the key 'planner'",
    ),
    "twice": (lambda p: p["routes"].append("shortest"), "routes: 'shortest' is given twice"),
    "no pairs": (lambda p: p.pop("pairs"), "the key 'pairs' is missing; add it."),
    "empty pairs": (lambda p: p.update(pairs=[]), "pairs is []"),
    "no goal": (lambda p: p["pairs"][0].pop("goal"), "pairs[0]: the key 'goal' is missing"),
    "reserved": (lambda p: p["pairs"][0].update(name="all pairs"), "is the name of the rows"),
    "pair of a file": (
        lambda p: p["routes"].append({"kind": "file", "file": "a.csv", "pair": "ther"}),
        "which is not there; did you mean there",
    ),
    "part": (lambda p: p.update(map=3), "map is 3; give a mapping with the keys spacing"),
}


@pytest.mark.parametrize(("spoil", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_sentence(
    scenario: Plain, spoil: Callable[[Plain], object], message: str
) -> None:
    spoil(scenario)
    with pytest.raises(InputError) as error:
        parse_scenario(scenario, "x.yaml", "x")
    text = str(error.value)
    assert text.startswith("x.yaml") and message in text and text.endswith(".")
    assert "\n" not in text


def test_missing_files(scenario: Plain, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.yaml: the file cannot be read"):
        load_scenario(tmp_path / "no.yaml")
    with pytest.raises(InputError, match=r"environment: the file .*gone\.geojson does not exist"):
        load_scenario(write(tmp_path, {**scenario, "environment": "gone.geojson"}))
    with pytest.raises(InputError, match=r"scanner: there is no scanner preset 'hokuyo-urg-04l'"):
        load_scenario(write(tmp_path, {**scenario, "scanner": "hokuyo-urg-04l"}))


def test_angles_are_degrees_in_the_file(scenario: dict[str, Any], tmp_path: Path) -> None:
    scenario["pairs"] = [{"start": [1, 1, 90], "goal": [7, 2, -45.5]}]
    read = load_scenario(write(tmp_path, scenario)).scenario
    assert read.pairs[0].start == (1.0, 1.0, math.pi / 2)
    assert read.pairs[0].goal == (7.0, 2.0, math.radians(-45.5))
    # Reports say what the file says.
    plain = read.pairs[0].model_dump()
    assert (plain["start"], plain["goal"]) == ([1.0, 1.0, 90.0], [7.0, 2.0, -45.5])
    assert read.drive.start_deviations == (0.05, 0.05, 0.02)
    scenario["drive"] |= {"start_std": [0.1, 0.2], "start_heading_std_deg": 180}
    read = load_scenario(write(tmp_path, scenario)).scenario
    assert read.drive.start_deviations == (0.1, 0.2, math.pi)


def test_floor_and_unit_of_the_building(scenario: Plain, tmp_path: Path) -> None:
    """Keys of the scenario; what is asked for names them, and not the options of commands."""
    path = write(tmp_path, scenario)
    plan = tmp_path / "flat.geojson"
    document = json.loads(plan.read_text())
    for part, level in zip(document["features"], ("EG", "OG"), strict=True):
        part["properties"] = {"level": level}
        corners = part["geometry"]["coordinates"][0]
        part["geometry"]["coordinates"] = [[[1000 * x, 1000 * y] for x, y in corners]]

    def load(**keys: object) -> ScenarioBundle:
        path.write_text(yaml.safe_dump({**scenario, **keys}))
        plan.write_text(json.dumps(document))
        return load_scenario(path)

    with pytest.raises(InputError, match=r"flat\.yaml: environment: .*say with the key unit"):
        load()
    with pytest.raises(InputError, match=r"2 levels \(EG, OG\).*choose one with the key level\.$"):
        load(unit="mm")
    assert load(unit="mm", level="EG").environment.free.area == pytest.approx(24.0)
    assert load(unit="mm", level=1).environment.free.area == pytest.approx(0.8)
