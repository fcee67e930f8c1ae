"""Write docs/measured-table.md, one figure a cell, from the reports in results/.

`measured.yaml` says where each figure is read: the report, and the cell of a table or a regular
expression with one group. The page docs/measured.md gives some of these figures in bold, with the
unit and then the spread in brackets; each must be one of the table.

    python benchmarks/measured.py
    python benchmarks/measured.py --check
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Decimal
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

import yaml
from harness import ROOT, arguments, option, table
from report_tables import tables_of

ANSWERS = ROOT / "docs" / "measured.md"
PAGE = ROOT / "docs" / "measured-table.md"
RESULTS = ROOT / "benchmarks" / "results"
LIST = Path(__file__).with_name("measured.yaml")
HEADER = ("question", "what", "conditions", "value", "unit", "spread or interval", "command")
NUMBER = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
SPREAD = re.compile(rf"[(\[]({NUMBER.pattern}) ?%?(?: to |, )({NUMBER.pattern})([^)\]]*)[)\]]")
OLDER = "bootstrap"
"""Marks the interval of a share, in its brackets, that is not of the kind of the others."""
COMMAND = re.compile(r"`python (?:-\S+ \w+ )?benchmarks/(\w+\.py)")
STATED = re.compile(r"\*\*([-+]?\d[^*]*)\*\*\s\(([^)]*)\)")
HEAD = """# All figures

Written by `benchmarks/measured.py` from [benchmarks/results](../benchmarks/results), whose
reports name date, processor, commit and the whole command. [What was measured](measured.md) says
what the figures mean, and the [glossary](concepts/glossary.md) what the words mean. `product` is
Monte Carlo localization that multiplies its beams, `kalman` an extended Kalman filter on the
ranges. Poor odometry errs by 9 degrees and 11 cm in a metre, mediocre odometry by half of that.
Seconds depend on the processor, ratios less ([how steady they
are](../benchmarks/README.md#how-steady-the-figures-are)). Policies were trained on earlier code.
Intervals of shares are score intervals. One that is said to be by the bootstrap is of an older
kind, and too narrow where few robots are lost: its report does not hold what the other needs."""
PICKS: dict[str, Callable[[list[float]], float]] = {
    "least": min,
    "most": max,
    "median": median,
    "sum": sum,
}


@dataclass(frozen=True)
class Figure:
    """A row of the table; all is text as the page shows it.

    Attributes:
        question: The question of docs/measured.md that it belongs to.
        what: The measured quantity.
        conditions: What it holds for.
        value: The number.
        unit: Its unit; may be empty.
        spread: An interval, extremes or quantile, and of what; may be empty.
        report: Name in results/ without `.md`.
    """

    question: str
    what: str
    conditions: str
    value: str
    unit: str
    spread: str
    report: str

    def row(self) -> tuple[str, ...]:
        """Return the cells of the page, the command linked to the report."""
        link = f"[`{command_of(self.report)}`](../benchmarks/results/{self.report}.md)"
        return (
            self.question, self.what, self.conditions, self.value, self.unit, self.spread, link,
        )  # fmt: skip


def figures() -> list[Figure]:
    """Read every figure that `measured.yaml` names from its report."""
    groups = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    return [figure_of(entry) for group in groups for entry in entries_of(group)]


def entries_of(group: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the figures of a group, each with what the group and its variants say."""
    for *variants, figure in product(*group.get("each", ()), group["figures"]):
        parts = [group, *variants, figure]
        entry = {key: value for part in parts for key, value in part.items()}
        entry["row"] = [cell for part in parts for cell in part.get("row", ())]
        entry["conditions"] = "; ".join(
            part["conditions"] for part in parts if "conditions" in part
        )
        yield entry


def figure_of(entry: dict[str, Any]) -> Figure:
    """Read one figure; `measured.yaml` says at its head what the keys of an entry are.

    Raises:
        ValueError: Not exactly one cell of the report is what the entry asks for.
    """
    cells = cells_of(entry, entry.get("column"))
    numbers = [NUMBER.findall(cell)[0].replace(",", "") for cell in cells]
    spread = [entry["of"]] if "of" in entry else []
    if "pick" in entry:
        values = [float(number) for number in numbers]
        value = f"{PICKS[entry['pick']](values):.10g}"
        ends = [numbers[values.index(end)] for end in (min(values), max(values))]
    elif len(cells) == 1:
        value = numbers[0]
        interval = SPREAD.search(cells[0])
        ends = [end.replace(",", "") for end in interval.groups()[:2]] if interval else []
        if interval and OLDER in interval[3]:
            spread = [f"{entry['of']} by the bootstrap"]
    else:
        raise ValueError(f"{LIST.name}: '{entry['what']}': {len(cells)} cells instead of one")
    if ends:
        spread.insert(0, " to ".join(shown(end, entry) for end in ends))
    if "beside" in entry:
        (cell,) = cells_of(entry, entry["beside"])
        spread.insert(0, cell)
    return Figure(
        entry["question"], entry["what"], entry["conditions"], shown(value, entry),
        entry.get("unit", ""), ", ".join(spread), entry["report"],
    )  # fmt: skip


def cells_of(entry: dict[str, Any], column: str | int | None) -> list[str]:
    """Return the cells of a column in an entry's rows, or what its expression matches."""
    text = (RESULTS / f"{entry['report']}.md").read_text(encoding="utf-8")
    texts = [text] if column is None else []
    for part in tables_of(text) if column is not None else ():
        if not re.search(entry.get("under", ""), part.heading):
            continue
        if not {entry.get("header", column), column} <= {*part.header, *range(len(part.header))}:
            continue
        at = column if isinstance(column, int) else part.header.index(column)
        texts += [row[at] for row in part.rows if set(entry["row"]) <= set(row) and row[at]]
    if "find" not in entry:
        return texts
    return [match for text in texts for match in re.findall(entry["find"], text)]


def shown(number: str, entry: dict[str, Any]) -> str:
    """Return a report's number in the unit of the page, with a space between thousands."""
    if "times" in entry or "digits" in entry:
        exact = Decimal(number) * Decimal(str(entry.get("times", 1)))
        number = str(exact.quantize(Decimal(1).scaleb(-entry["digits"]), ROUND_HALF_UP))
    whole, point, decimals = number.partition(".")
    return (f"{int(whole):,}".replace(",", " ") if len(whole) > 4 else whole) + point + decimals


def page() -> str:
    """Lay out the whole table."""
    rows = [figure.row() for figure in figures()]
    return f"{HEAD}\n\n{table(HEADER, rows, words=len(HEADER))}\n"


def command_of(name: str) -> str:
    """Return the script that a report names as its command."""
    text = (RESULTS / f"{name}.md").read_text(encoding="utf-8")
    match = COMMAND.search(text)
    if match is None:
        raise ValueError(f"{name}.md names no command")
    return match.group(1)


def misses(answers: str | None = None) -> list[str]:
    """Return a sentence for each figure in bold of docs/measured.md, and the table, if outdated.

    Args:
        answers: The text of docs/measured.md; None: as it is.
    """
    answers = ANSWERS.read_text(encoding="utf-8") if answers is None else answers
    published = {(f"{figure.value} {figure.unit}".strip(), figure.spread) for figure in figures()}
    sentences = [
        f"{ANSWERS.name}: '{value} ({spread})' is not a figure of {PAGE.name}"
        for value, spread in STATED.findall(" ".join(answers.split()))
        if (value, spread) not in published
    ]
    if PAGE.read_text(encoding="utf-8") != page():
        sentences.append(f"{PAGE.name} is not what the reports give; run measured.py")
    return sentences


def main() -> None:
    """Write the table, or compare both pages with the reports."""
    args = arguments(__doc__, check=option(False, "write nothing, only compare"))
    if not args.check:
        PAGE.write_text(page(), encoding="utf-8")
        return
    sentences = misses()
    print("\n".join(sentences) or "the pages say what the reports say")
    raise SystemExit(bool(sentences))


if __name__ == "__main__":
    main()
