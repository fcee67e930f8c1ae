"""Rows, differences and what is said of them, on figures that are made up."""

from __future__ import annotations

import csv
import functools
import io
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.stats import binomtest

from ambinav.drive.metrics import Metrics
from ambinav.reports.table import difference_text, ratio_text, value_text
from ambinav.routes.bad_floor import BadFloor
from ambinav.studies.compare import criterion
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.results import Results
from ambinav.studies.compare.scenario import ALL_PAIRS
from ambinav.studies.compare.tables import FIGURES, Row, judge, make_rows, to_csv
from tests.drive.cases import route_through

RUNS = 30

FLOOR = (
    *("planned_corridor", "planned_longest_corridor", "planned_open", "planned_longest_open"),
    "planned_unexplored",
)


def results(lost: int, p95: float, length: float) -> Results:
    plain = {field.name: np.full(RUNS, 1.0) for field in fields(Metrics)}
    plain["lost"] = np.arange(RUNS) < lost
    plain["position_p95"] = p95 + 0.02 * np.arange(RUNS)
    plain["length"] = np.full(RUNS, length)
    plain["nees"] = np.full(RUNS, np.nan)
    nothing = np.full((RUNS, 2), np.nan)
    return Results(Metrics(**plain), np.zeros((RUNS, 3)), nothing, nothing)


def plan(pair: str, name: str, length: float) -> Plan:
    return Plan(pair, name, route_through([[0, 0], [length, 0]]))


CASES = (
    (plan("a", "shortest", 40), results(15, 1.0, 40.0)),
    (plan("a", "careful", 42), results(3, 0.4, 42.0)),
    (plan("b", "shortest", 10), results(0, 0.2, 10.0)),
    (plan("b", "careful", 10), results(0, 0.2, 10.0)),
    (plan("b", "only here", 10), results(0, 0.2, 10.0)),
)


@functools.cache
def rows_of_all() -> list[Row]:
    return make_rows(*zip(*CASES, strict=True), "shortest", 1)


@pytest.mark.slow
def test_rows() -> None:
    rows = rows_of_all()
    assert [(row.pair, row.route) for row in rows] == [
        *((case.pair, case.name) for case, _ in CASES),
        (ALL_PAIRS, "shortest"),
        (ALL_PAIRS, "careful"),
    ]
    first, second = rows[:2]
    assert first["lost"].value.value == 50.0 and first["lost"].difference is None
    lost, error, length = (second[key] for key in ("lost", "error_p95", "length"))
    assert lost.difference is not None and lost.ratio is not None
    assert lost.difference.value == -40.0 and lost.difference.high < 0.0
    assert lost.ratio.value == pytest.approx(0.2)
    # Paired: what both have in common cancels.
    assert error.difference is not None
    assert error.difference.low == pytest.approx(-0.6) == error.difference.high
    assert length.ratio is not None and length.ratio.value == pytest.approx(1.05)
    assert rows[-1]["lost"].value.value == 5.0 and rows[-1].runs == 2 * RUNS


@pytest.mark.slow
def test_a_row_does_not_depend_on_the_others() -> None:
    whole = rows_of_all()
    part = make_rows(*zip(*CASES[:2], strict=True), "shortest", 1)
    assert part == whole[:2] or to_csv(part) == to_csv(whole[:2])


def test_texts() -> None:
    rows = rows_of_all()
    assert value_text(rows[0]["nees"]) == "-"
    high = 100.0 * binomtest(0, rows[2].runs).proportion_ci(0.95, "wilson").high
    assert value_text(rows[2]["lost"]) == f"0 [0, {high:.0f}]"
    assert difference_text(rows[1]["error_p95"]) == "-0.60 [-0.60, -0.60]"
    assert difference_text(rows[3]["lost"]) == "+0 [-11, +11]"
    assert difference_text(rows[0]["lost"]) == "" == ratio_text(rows[0]["lost"])
    assert ratio_text(rows[3]["lost"]) == "1.00 [1.00, 1.00]"


def test_judged_by_the_figures_of_the_table() -> None:
    rows = rows_of_all()
    assert [row.route for row in rows if row.is_baseline] == ["shortest"] * 3
    found = judge(rows[1], rows[0])
    assert found.runs == RUNS and found.length == pytest.approx(1.05)
    assert found.lost.ours.value == pytest.approx(0.1)
    assert found.lost.theirs.value == pytest.approx(0.5)
    assert found.lost.difference.value == pytest.approx(-0.4)
    assert found.lost.ratio.value == pytest.approx(0.2)
    assert found.error.difference.value == pytest.approx(-0.6)
    # The same runs, judged without a table.
    (_, ours), (_, theirs) = CASES[1], CASES[0]
    apart = criterion.judge_route(
        ours.metrics, theirs.metrics, (42.0, 40.0), np.random.default_rng(1)
    )
    assert (apart.outcome, apart.effect) == (found.outcome, found.effect)
    with pytest.raises(ValueError, match="baseline"):
        judge(rows[0], rows[0])


def test_csv() -> None:
    rows = rows_of_all()
    lines = list(csv.DictReader(io.StringIO(to_csv(rows))))
    each = len(FIGURES) + len(FLOOR)
    assert len(lines) == len(rows) * each
    line = lines[each]
    assert (line["pair"], line["route"], line["figure"]) == ("a", "careful", "lost")
    assert float(line["difference"]) == -40.0
    assert lines[0]["difference"] == ""


def planned(case: tuple[Plan, Results], *floor: float) -> tuple[Plan, Results]:
    """A case whose route has so many metres: corridor, longest of it, open, longest of it."""
    one, found = case
    zones = {"localizable": 0.0, "transition": 0.0, "corridor": floor[0], "open": floor[2]}
    route = replace(one.route, zone_metres=zones, longest_corridor=floor[1], longest_open=floor[3])
    return replace(one, route=route), found


@pytest.mark.slow
def test_corridor_and_open_zones_are_distinguished() -> None:
    floors = [
        (12.0, 8.0, 4.0, 3.5),
        (3.0, 2.0, 0.0, 0.0),
        (1.0, 1.0, 9.0, 9.0),
        (6.0, 2.5, 0.0, 0.0),
    ]
    cases = [planned(case, *floor) for case, floor in zip(CASES, floors, strict=False)]
    rows = make_rows(*zip(*cases, strict=True), "shortest", 1)
    bad_floor = {(row.pair, row.route): row.floor for row in rows}
    assert bad_floor["a", "shortest"] == BadFloor(*floors[0])
    # Over all pairs: sums, and the longest stretch of all.
    assert bad_floor[ALL_PAIRS, "shortest"] == BadFloor(13.0, 8.0, 13.0, 9.0)
    assert bad_floor[ALL_PAIRS, "careful"] == BadFloor(9.0, 2.5, 0.0, 0.0)
    lines = [
        line for line in csv.DictReader(io.StringIO(to_csv(rows)))
        if (line["pair"], line["route"]) == ("a", "careful") and line["figure"] in FLOOR
    ]  # fmt: skip
    assert [line["figure"] for line in lines] == list(FLOOR)
    assert [float(line["value"]) for line in lines] == [3.0, 2.0, 0.0, 0.0, 0.0]
    assert [float(line["difference"]) for line in lines] == [-9.0, -6.0, -4.0, -3.5, 0.0]
    assert {(line["unit"], line["low"], line["high"], line["ratio"]) for line in lines} == {
        ("m", "", "", "")
    }
