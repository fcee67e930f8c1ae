"""Read the tables of the reports in results/."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """A table of a report.

    Attributes:
        heading: The headings above it, without the title.
        header: Its columns.
        rows: Its cells.
    """

    heading: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def tables_of(text: str) -> Iterator[Table]:
    """Yield the tables of a report, in their order."""
    heading: dict[int, str] = {}
    lines: list[str] = []
    for line in [*text.splitlines(), ""]:
        if line.startswith("|"):
            lines.append(line)
            continue
        if len(lines) > 2:
            cells = [tuple(cell.strip() for cell in row.strip("|").split("|")) for row in lines]
            above = [name for level, name in heading.items() if level > 1]
            yield Table(" / ".join(above), cells[0], tuple(cells[2:]))
        lines = []
        if match := re.match(r"(#+) (.*)", line):
            level = len(match.group(1))
            heading = {k: v for k, v in heading.items() if k < level} | {level: match.group(2)}
