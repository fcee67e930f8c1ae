"""docs/measured.md says what the reports in benchmarks/results say."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("measured")


def test_the_page_agrees_with_its_reports(measured: ModuleType) -> None:
    assert measured.misses() == []


def test_a_figure_that_no_report_has_is_found(measured: ModuleType) -> None:
    page = measured.PAGE.read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith("| ambiguity kernel |"))
    (found,) = measured.misses(page.replace(row, "| ambiguity kernel | 123.456 | `bench_map.py` |"))
    assert "'ambiguity kernel': 123.456 is not in map" in found


def test_a_row_without_a_report_is_found(measured: ModuleType) -> None:
    page = measured.PAGE.read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith("| ambiguity kernel |"))
    found = measured.misses(page.replace(row, f"{row}\n| a new claim | 3 times | `bench_map.py` |"))
    assert found == ["measured.yaml: nothing says where 'a new claim' comes from"]
    found = measured.misses(page.replace(row + "\n", ""))
    assert found == ["measured.yaml: 0 rows of the page begin 'ambiguity kernel'"]


@pytest.mark.parametrize(
    ("text", "known", "same"),
    [
        ("0.002", 0.0017, True),
        ("0.002", 0.0026, False),
        ("260", 263.0, True),
        ("379000", 378999.6, True),
        ("10", 12.0, False),
        ("16", 16.4, True),
        ("1e-4", 1.04e-4, True),
    ],
)
def test_numbers_agree_to_what_is_said(
    measured: ModuleType, text: str, known: float, same: bool
) -> None:
    assert measured.agrees(text, [known]) is same
