"""Forecasts beside the drives of a comparison: those of `Forecaster`, where there is a class."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from ambinav import build_map
from ambinav.cli import app
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.files import load_route
from ambinav.runtime.errors import InputWarning
from ambinav.studies.compare.document import ForecastPart
from ambinav.studies.compare.forecasts import forecast_note, make_forecasts
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.scenario_file import load_scenario
from tests.drive.cases import route_through
from tests.studies.compare.conftest import SCENARIO, write

POOR = {"scale": 0.5}
PAIRS = [
    {"name": "there", "start": [1, 1], "goal": [7, 2]},
    {"name": "back", "start": [7, 2], "goal": [1, 2]},
]
PRODUCT: dict[str, Any] = {
    **SCENARIO,
    "scanner": {
        **SCENARIO["scanner"],
        "parts": [
            {
                **SCENARIO["scanner"]["parts"][0],
                "sensor": {"max_range": 1.2, "std": 0.05, "resolution": 0.01},
            }
        ],
    },
    "localizer": LocalizerClass.load("product").localizer,
    "odometry": POOR,
    "pairs": PAIRS,
    "drive": {"runs": 2},
}


def compare(scenario: Path, out: Path) -> str:
    words = ["compare", str(scenario), "-o", str(out), "--no-store", "--jobs", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of a comparison with forecasts, and what the terminal showed."""
    folder = tmp_path_factory.mktemp("forecasts")
    return folder / "out", compare(write(folder, PRODUCT), folder / "out")


@pytest.mark.sweep
def test_they_are_those_of_the_saved_routes(done: tuple[Path, str]) -> None:
    out, shown = done
    report = json.loads((out / "report.json").read_text())
    forecaster = Forecaster(
        AmbiguityMap.open(next((out / "work").glob("map-*.zarr"))),
        load_scenario(out.parent / "flat.yaml").scenario.odometry,
        report["rows"][0]["forecast"]["localizer"],
    )
    rows = {(row["pair"], row["route"]): row["forecast"] for row in report["rows"]}
    expected = {}
    text, page = ((out / name).read_text() for name in ("report.md", "report.html"))
    for plan in report["plans"]:
        forecast = forecaster(load_route(out / plan["file"]))
        part = rows[plan["pair"], plan["route"]]
        assert part["lost_probability"] == pytest.approx(forecast.lost_probability, abs=1e-5)
        assert part["text"] == forecast.sentence
        assert [cause["kind"] for cause in part["causes"]] == [c.kind for c in forecast.causes]
        assert part["localizer"] == "product"
        percent = f"{100.0 * forecast.lost_probability:.1f}"
        assert f" | {percent} | " in text
        assert f">{percent}</td>" in page
        expected[plan["pair"], plan["route"]] = forecast.lost_probability
        for written in (text, page, " ".join(shown.split())):
            assert f"orecast of {plan['route']}: {forecast.sentence}" in written
    assert max(expected.values()) > 0.01
    mean = sum(p for (_, route), p in expected.items() if route == "shortest") / 2.0
    assert rows["all pairs", "shortest"]["lost_probability"] == pytest.approx(mean, abs=1e-5)
    assert rows["all pairs", "shortest"]["text"] == ""
    assert "open loop" in text and "open loop" in page
    assert re.search(r"lost,\s+forecast,\s+95 %", shown)
    for name in {route for _, route in expected}:  # all of it, on 80 columns
        assert re.search(rf"^{name} +\d+ \[", shown, re.MULTILINE)
    lines = list(csv.DictReader((out / "table.csv").read_text().splitlines()))
    (line,) = (
        line for line in lines
        if (line["pair"], line["route"], line["figure"]) == ("there", "shortest", "forecast_lost")
    )  # fmt: skip
    assert float(line["value"]) == pytest.approx(100.0 * expected["there", "shortest"], abs=1e-3)


@pytest.mark.slow
def test_without_a_class_nothing_changes(tmp_path: Path) -> None:
    """Terminal, table and document do not mention forecasts."""
    shown = compare(write(tmp_path, {**SCENARIO, "drive": {"runs": 2}}), tmp_path / "out")
    written = [
        (tmp_path / "out" / name).read_text() for name in ("report.json", "report.md", "table.csv")
    ]
    assert all("forecast" not in text.lower() for text in (shown, *written))
    page = (tmp_path / "out" / "report.html").read_text()
    assert "orecast of" not in page


def test_policies_and_routes_off_the_floor_have_none(tmp_path: Path) -> None:
    loaded = load_scenario(write(tmp_path, {**PRODUCT, "map": {"spacing": 0.4}}))
    amap = build_map(loaded.environment, loaded.scanner, spacing=0.4, store=False)
    driver: Any = object()
    plans = (
        Plan("there", "shortest", route_through([[1, 0.7], [7, 0.7]])),
        Plan("there", "policy", route_through([[1, 0.7], [7, 0.7]]), driver),
        Plan("there", "outside", route_through([[1, 0.7], [70, 0.7]])),
    )
    with pytest.warns(InputWarning, match=r"pair 'there', route 'outside' has no forecast: "):
        made = make_forecasts(loaded, amap, plans)
    assert [forecast is None for forecast in made] == [False, True, True]
    assert "multiplies the beams" in forecast_note(made)
    assert make_forecasts(loaded, amap, plans[1:2]) == (None,)
    plain = yaml.safe_load((tmp_path / "flat.yaml").read_text())
    plain["localizer"] = "odometry"
    assert make_forecasts(load_scenario(write(tmp_path, plain)), amap, plans) == (None,) * 3


@pytest.mark.slow
def test_documents_are_read_again(done: tuple[Path, str]) -> None:
    report = json.loads((done[0] / "report.json").read_text())
    part = ForecastPart.model_validate(report["rows"][0]["forecast"])
    assert 0.0 <= part.lost_probability <= 1.0
