"""Rows, differences and what is said of them, on figures that are made up."""

from __future__ import annotations

import csv
import io
from dataclasses import fields

import numpy as np
import pytest

from ambinav.compare import criterion
from ambinav.compare.plans import Plan
from ambinav.compare.results import Results
from ambinav.compare.scenario import ALL_PAIRS
from ambinav.compare.tables import (
    FIGURES,
    difference_text,
    judge,
    make_rows,
    ratio_text,
    to_csv,
    value_text,
)
from ambinav.drive.metrics import Metrics
from tests.drive.cases import route_through

RUNS = 30


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


def test_rows() -> None:
    rows = make_rows(*zip(*CASES, strict=True), "shortest", 1)
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


def test_a_row_does_not_depend_on_the_others() -> None:
    whole = make_rows(*zip(*CASES, strict=True), "shortest", 1)
    part = make_rows(*zip(*CASES[:2], strict=True), "shortest", 1)
    assert part == whole[:2] or to_csv(part) == to_csv(whole[:2])


def test_texts() -> None:
    rows = make_rows(*zip(*CASES, strict=True), "shortest", 1)
    assert value_text(rows[0]["nees"]) == "-"
    assert value_text(rows[2]["lost"]) == "0 [0, 0]"
    assert difference_text(rows[1]["error_p95"]) == "-0.60 [-0.60, -0.60]"
    assert difference_text(rows[3]["lost"]) == "+0 [+0, +0]"
    assert difference_text(rows[0]["lost"]) == "" == ratio_text(rows[0]["lost"])
    assert ratio_text(rows[3]["lost"]) == "1.00 [1.00, 1.00]"


def test_judged_by_the_figures_of_the_table() -> None:
    rows = make_rows(*zip(*CASES, strict=True), "shortest", 1)
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
    apart = criterion.verdict(ours.metrics, theirs.metrics, (42.0, 40.0), np.random.default_rng(1))
    assert (apart.outcome, apart.effect) == (found.outcome, found.effect)
    with pytest.raises(ValueError, match="baseline"):
        judge(rows[0], rows[0])


def test_csv() -> None:
    rows = make_rows(*zip(*CASES, strict=True), "shortest", 1)
    lines = list(csv.DictReader(io.StringIO(to_csv(rows))))
    assert len(lines) == len(rows) * len(FIGURES)
    told = lines[len(FIGURES)]
    assert (told["pair"], told["route"], told["figure"]) == ("a", "careful", "lost")
    assert float(told["difference"]) == -40.0
    assert lines[0]["difference"] == ""
