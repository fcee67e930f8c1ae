"""docs/measured.md and docs/measured-table.md say what the reports in benchmarks/results say."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
REPORT = """# Title

- command: `python -W ignore benchmarks/bench_x.py --out x.md`

It took 12,345 steps (11,000 to 13,000). Lost: 4.0 (1.0 to 7.0, bootstrap) in all.

## Part

| map | s: median (extremes) | lost |
| --- | ---: | ---: |
| a | 0.63 (0.59 to 0.79) | 1, 3 |
| b | 1.115 [0.8, 1.3] | 2, 5 |
"""


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("measured")


@pytest.fixture
def report(measured: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "x.md").write_text(REPORT, encoding="utf-8")
    monkeypatch.setattr(measured, "RESULTS", tmp_path)


@pytest.mark.slow
def test_the_pages_agree_with_the_reports(measured: ModuleType) -> None:
    assert measured.misses() == []


@pytest.mark.slow
def test_a_figure_that_the_table_has_not_is_found(measured: ModuleType) -> None:
    page = "It takes **0.63 s**\n(0.59 to 0.79, extremes of 5 builds) or **9.99 s** (1 to 20)."
    assert measured.misses(page) == [
        "measured.md: '9.99 s (1 to 20)' is not a figure of measured-table.md"
    ]


@pytest.mark.slow
def test_the_page_gives_a_figure_for_each_question(measured: ModuleType) -> None:
    sections = measured.ANSWERS.read_text(encoding="utf-8").split("\n## ")[1:]
    questions = dict.fromkeys(figure.question for figure in measured.figures())
    assert [section.splitlines()[0] for section in sections] == list(questions)
    assert all(measured.STATED.search(section) for section in sections)
    assert all(section.count("![") == 1 for section in sections)


@pytest.mark.parametrize(
    ("entry", "value", "spread"),
    [
        ({"row": ["a"], "column": "s: median (extremes)"}, "0.63", "0.59 to 0.79, extremes"),
        ({"row": ["b"], "column": 1, "digits": 2}, "1.12", "0.80 to 1.30, extremes"),
        ({"row": ["b"], "column": 1, "digits": 0, "times": 100}, "112", "80 to 130, extremes"),
        ({"column": "lost", "find": ", (.*)", "pick": "sum"}, "8", "3 to 5, extremes"),
        ({"find": r"took (.*?)\."}, "12 345", "11 000 to 13 000, extremes"),
        ({"find": r"Lost: (.*) in"}, "4.0", "1.0 to 7.0, extremes by the bootstrap"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("report")
def test_figures_are_read_from_cells_and_by_expressions(
    measured: ModuleType, entry: dict[str, object], value: str, spread: str
) -> None:
    group = {"question": "q", "report": "x", "what": "w", "of": "extremes", "figures": [entry]}
    (merged,) = measured.entries_of(group)
    figure = measured.figure_of(merged)
    assert (figure.value, figure.spread) == (value, spread)
    assert figure.row()[-1] == "[`bench_x.py`](../benchmarks/results/x.md)"


@pytest.mark.usefixtures("report")
def test_what_is_not_one_cell_is_refused(measured: ModuleType) -> None:
    group = {"question": "q", "report": "x", "what": "w", "figures": [{"column": "lost"}]}
    (entry,) = measured.entries_of(group)
    with pytest.raises(ValueError, match="'w': 2 cells instead of one"):
        measured.figure_of(entry)


def test_variants_are_combined(measured: ModuleType) -> None:
    group = {
        "row": ["all"],
        "each": [[{"conditions": "poor", "row": ["1"]}, {"conditions": "good"}]],
        "figures": [{"what": "lost", "conditions": "laser"}],
    }
    first, second = measured.entries_of(group)
    assert (first["conditions"], first["row"]) == ("poor; laser", ["all", "1"])
    assert (second["conditions"], second["row"]) == ("good; laser", ["all"])
