"""The page of figures before and after shows what has changed, and nothing else."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest
import yaml

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("figures")


def report(*rows: str, header: str = "| log | range | share | error |") -> str:
    return "\n".join(
        ["# Title", "", "## Part", "", header, "| --- | --- | ---: | ---: |", *rows, ""]
    )


def test_only_rows_and_columns_with_a_change_are_shown(figures: ModuleType) -> None:
    old = report("| a | full | 3 | 0.9 |", "| b | full | 4 | 0.8 |")
    new = report("| a | full | 3 | 0.7 |", "| b | full | 4 | 0.8 |")
    shown = figures.compared(old, new)
    assert "**Part**" in shown
    assert "| log | range | error |" in shown
    assert "| a | full | 0.9 → 0.7 |" in shown
    assert "| b |" not in shown


@pytest.mark.parametrize(
    "cell",
    [
        "0.90 (0.87 to 0.92)",
        "-0.1 (-0.2 to 0.1)",
        "24 % (19 to 30)",
        "24 % (19 % to 30 %)",
        "+1.2 (-0.5 to +2.9)",
        "-0.012 (-0.020 to -0.004)",
        "61 [28.6, 113]",
        "0.9 [-0.1, 1.2e+03]",
    ],
)
def test_intervals_do_not_count_as_a_change(figures: ModuleType, cell: str) -> None:
    value = cell.replace("[", "(").split(" (")[0]
    assert figures.plain_of(cell) == value
    same = figures.compared(
        report(f"| a | full | 3 | {cell} |"), report(f"| a | full | 3 | {value} |")
    )
    assert same == "No figure of tables that are in both has changed."


def test_rows_of_the_same_words_are_compared_in_their_order(figures: ModuleType) -> None:
    old = report("| a | full | 3 | 0.9 |", "| a | full | 5 | 0.8 |")
    new = report("| a | full | 3 | 0.9 |", "| a | full | 5 | 0.7 |")
    shown = figures.compared(old, new)
    assert "| a | full | 0.8 → 0.7 |" in shown
    assert "0.9" not in shown
    assert figures.compared(old, old) == "No figure of tables that are in both has changed."


def test_reports_without_a_table_in_common(figures: ModuleType) -> None:
    old = report("| a | full | 3 | 0.9 |")
    assert figures.compared(old, "# Nothing\n").startswith("Its tables are other ones")
    assert figures.commit_of("# Title\n\n- commit: 1111111aaaaa\n") == "1111111"


def test_brackets_that_are_no_interval_stay(figures: ModuleType) -> None:
    for cell in ("19.1 (14.5)", "1.1 (134)", "0.13 / 0.14"):
        assert figures.plain_of(cell) == cell


def test_rows_and_columns_that_are_gone_are_named(figures: ModuleType) -> None:
    old = report("| a | full | 3 | 0.9 |", "| b | full | 4 | 0.8 |")
    new = report("| a | full | 3 |", header="| log | range | share |").replace(
        "---: | ---:", "---:"
    )
    shown = figures.compared(old, new)
    assert "0.9 → gone" in shown
    assert "No longer in the report: b full." in shown


def test_the_localizer_of_before_is_the_product(figures: ModuleType) -> None:
    old = report("| a | full | 3 | 0.9 |")
    head = "| log | range | localizer | share | error |"
    new = report("| a | full | product | 3 | 0.5 |", "| a | full | ekf | 3 | 0.1 |", header=head)
    assert "| a | full | 0.9 → 0.5 |" in figures.compared(
        old, new.replace("---: |", "---: | ---: |", 1)
    )


def test_every_statement_has_what_the_page_shows(figures: ModuleType) -> None:
    plain = yaml.safe_load((BENCHMARKS / "figures.yaml").read_text(encoding="utf-8"))
    for one in (one for part in plain["readme"] for one in part["figures"]):
        assert {"what", "command", "before", "status"} <= one.keys(), one
        assert one["status"] in figures.STATES
        assert ("after" in one) or one["status"] != "measured", one["what"]
    names = [one["report"] for one in plain["reports"]]
    assert len(names) == len(set(names))
    # Reports that came since are put beside those that are listed.
    page = figures.page(plain)
    for path in (BENCHMARKS / "results").glob("*.md"):
        assert f"| [{path.name}](" in page, path.name
