"""The audit's forecasts: those of `Forecaster` on sampled routes, in document and report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ambinav.forecasting.causes import OPEN
from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.forecasting.forecast import Forecaster
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.sampled import sample_routes
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.audit.audit import Audit, audit
from ambinav.studies.audit.lost_routes import PAIRS, SEED, STEP, find_lost_routes, lost_part
from ambinav.studies.audit.report import write_audit
from tests.geometry import scenes


@pytest.fixture(scope="module")
def hall() -> Environment:
    """A hall of 30 by 24 m."""
    return scenes.room(30.0, 24.0)


@pytest.fixture(scope="module")
def hall_map(hall: Environment, laser: RangeScanner) -> AmbiguityMap:
    """The hall for a laser that reaches 4 m."""
    return build_map(hall, laser, spacing=0.5)


@pytest.fixture(scope="module")
def examined(hall: Environment, hall_map: AmbiguityMap, laser: RangeScanner) -> Audit:
    reach = find_reach(hall, 0.2)
    result = audit(hall_map, hall, laser, places=1, reach=reach)
    return replace(result, lost=find_lost_routes(result.amap, hall, reach))


@pytest.mark.slow
def test_they_are_those_of_sampled_routes(examined: Audit) -> None:
    lost = examined.lost
    assert lost is not None
    routes = sample_routes(
        examined.environment, examined.reach, PAIRS, np.random.default_rng(SEED), step=STEP
    )
    shares = Forecaster(examined.amap, ODOMETRY, LOCALIZER).lost_probabilities(routes)
    assert [f.lost_probability for f in lost.forecasts] == sorted(shares.tolist(), reverse=True)
    assert lost.share_safe == np.mean(shares < 0.05)
    assert 0.0 < lost.share_safe < 1.0
    # Robots get lost in the middle, where no wall is in range.
    worst = lost.worst[0].causes[0]
    assert worst.kind == OPEN
    assert 4.0 < worst.x < 26.0
    assert 4.0 < worst.y < 20.0


@pytest.mark.slow
def test_document_and_reports_name_them(examined: Audit, tmp_path: Path) -> None:
    assert examined.lost is not None
    report = write_audit(examined, tmp_path / "out")
    assert report.lost == lost_part(examined.lost)
    written = json.loads((tmp_path / "out" / "report.json").read_text())["lost"]
    assert written["pairs"] == PAIRS
    assert 1 <= len(written["routes"]) <= 5
    texts = [(tmp_path / "out" / name).read_text() for name in ("report.md", "report.html")]
    for route, forecast in zip(written["routes"], examined.lost.worst, strict=True):
        assert route["text"] == forecast.sentence
        assert route["lost_probability"] == pytest.approx(forecast.lost_probability, abs=1e-4)
        assert route["start_m"] == pytest.approx(forecast.poses[0, :2], abs=1e-3)
        assert all(route["text"] in text for text in texts)
    safe = round(examined.lost.share_safe * PAIRS)
    sentence = f"On {safe} of {PAIRS} shortest routes between sampled places fewer than 5 %"
    assert all(sentence in text for text in texts)


def test_where_nothing_can_be_sampled(hall_map: AmbiguityMap) -> None:
    tiny = scenes.room(0.45, 0.45)
    with pytest.raises(InputError, match="two places"):
        find_lost_routes(hall_map, tiny, find_reach(tiny, 0.2))
