"""Reliability of forecasts: bins of routes forecast alike, and where forecasts name them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ambinav.drive.bootstrap import share
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.localizer_class import LocalizerClass, localizer_classes
from ambinav.forecasting.reliability import EDGES, ReliabilityBin, bin_at, reliability_of
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from tests.forecasting.conftest import demo_map as demo_map

HALL = Route.through([[9.0, 16.0], [14.5, 21.0], [20.5, 21.0]])
RESULTS = Path(__file__).parents[2] / "benchmarks" / "results"
ROW = re.compile(r"^\| ([\d.]+) to ([\d.]+) \| (\d+) \| [\d.]+ \| ([\d.]+) \| ([\d.]+) \|$", re.M)


def test_shares_and_intervals_are_those_of_the_runs_by_building() -> None:
    rng = np.random.default_rng(1)
    truth = rng.uniform(0.0, 1.0, 600)
    buildings = np.array([f"b{k % 7}" for k in range(600)])
    runs = np.full(600, 32)
    lost = rng.binomial(runs, truth)
    bins = reliability_of(truth, lost, runs, buildings)
    assert sum(each.routes for each in bins) == 600
    for each in bins:
        assert each.lost_low <= each.lost <= each.lost_high
        inside = (truth >= each.forecast_low) & (truth < each.forecast_high)
        assert each.routes == inside.sum()
        assert each.lost == pytest.approx(lost[inside].sum() / runs[inside].sum(), abs=1e-4)
        # Binomial truth lies within the intervals, of 95 % each.
        assert each.lost_low <= truth[inside].mean() <= each.lost_high
        happened = np.concatenate([np.arange(32) < count for count in lost[inside]])
        known = share(happened, group=np.repeat(buildings[inside], 32))
        assert (each.lost_low, each.lost_high) == pytest.approx((known.low, known.high), abs=1e-4)


def test_a_bin_of_one_building_says_nothing_of_others() -> None:
    forecasts = np.array([0.3, 0.3, 0.6, 0.6])
    buildings = np.array(["a", "a", "a", "b"])
    (only,) = reliability_of(forecasts, np.array([1, 2, 3, 4]), np.full(4, 8), buildings)
    assert (only.forecast_low, only.forecast_high, only.routes) == (0.4, 0.7, 2)
    assert bin_at([only], 0.3) is None


@pytest.mark.parametrize("name", localizer_classes())
def test_classes_keep_the_reliability_of_their_report(name: str) -> None:
    bins = LocalizerClass.load(name).reliability
    rows = ROW.findall((RESULTS / f"lost-{name}.md").read_text())
    assert len(bins) == len(rows) == len(EDGES) - 1
    for each, row in zip(bins, rows, strict=True):
        low, high, routes, lost, half = map(float, row)
        assert (each.forecast_low, each.forecast_high) == pytest.approx((low / 100, high / 100))
        assert (each.routes, 100 * each.lost) == (routes, pytest.approx(lost))
        # The report has one decimal: the interval is wider by what that hides.
        assert 100 * each.lost_low == pytest.approx(max(lost - half - 0.1, 0.0))
        assert 100 * each.lost_high == pytest.approx(lost + half + 0.1)


def test_every_probability_has_a_bin() -> None:
    bins = LocalizerClass.load("product").reliability
    for p in (0.0, 0.005, 0.3, 1.0):
        found = bin_at(bins, p)
        assert found is not None
        assert found.forecast_low <= p <= found.forecast_high
    assert bin_at(bins, 0.3) == bins[5]
    assert bins[5].sentence == (
        "Of 118 routes forecast like this (20 to 40 %) in buildings left out of the fit, 28.7 % of "
        "the robots got lost (25.2 to 32.2 %)."
    )


def test_a_class_file_keeps_them(tmp_path: Path) -> None:
    product = LocalizerClass.load("product")
    product.to_yaml(tmp_path / "again.yaml")
    assert LocalizerClass.load(tmp_path / "again.yaml") == product
    replace(product, reliability=()).to_yaml(tmp_path / "none.yaml")
    assert "reliability" not in (tmp_path / "none.yaml").read_text()
    text = (tmp_path / "again.yaml").read_text().replace("lost: 0.287", "lost: 28.7")
    (tmp_path / "again.yaml").write_text(text)
    with pytest.raises(InputError, match=r"again.yaml.*lost is 28.7; give 0 to 1"):
        LocalizerClass.load(tmp_path / "again.yaml")


def test_forecasts_by_other_limits_have_none(demo_map: AmbiguityMap) -> None:
    forecast = Forecaster(demo_map, "poor")(HALL)
    product = LocalizerClass.load("product")
    assert forecast.reliability == bin_at(product.reliability, forecast.lost_probability)
    assert isinstance(forecast.reliability, ReliabilityBin)
    for more in ({"position_limit": 1.2}, {"lateral_limit": 0.3}, {"start_std": (0.1, 0.1, 0.02)}):
        assert Forecaster(demo_map, "poor", **more)(HALL).reliability is None  # type: ignore[arg-type]
    unmeasured = replace(product, reliability=())
    assert Forecaster(demo_map, "poor", unmeasured)(HALL).reliability is None
