"""Check that docs/measured.md agrees with the reports in results/.

`measured.yaml` names for every row and paragraph of the page the reports that its numbers are read
from. A number agrees if one of these reports has one that rounds to it. That finds a page that was
left behind when a report was made anew, and a slip of the pen; it does not find a number that
stands in the right report for something else.

    python benchmarks/figures.py --check
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from harness import ROOT

PAGE = ROOT / "docs" / "measured.md"
RESULTS = ROOT / "benchmarks" / "results"
LIST = Path(__file__).with_name("measured.yaml")
NUMBER = re.compile(r"(?<![\w.])(?:\d{1,3}(?:[ ,]\d{3})+(?!\d)|\d+(?:\.\d+)?(?:e[-+]?\d+)?)")
BESIDE = re.compile(r"\([0-9a-f]{7}\b[^)]*\)|\[[^\]]*\]\([^)]*\)|`[^`]*`")
"""Text whose numbers are not figures: commits, links, code."""
ROUND = 200
"""From here on zeros at the end of a whole number are taken for rounding: 379 000, 260."""


@dataclass(frozen=True)
class Entry:
    """A row or paragraph of the page.

    Attributes:
        starts: First words of the entry.
        reports: Reports with its numbers, names in results/ without `.md`.
        times: By what their numbers are multiplied to come to the page's units.
        beside: Numbers of the text that are of no report: conditions, sums.
    """

    starts: str
    reports: tuple[str, ...]
    times: tuple[float, ...] = (1.0,)
    beside: tuple[str, ...] = ()

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Entry:
        """Create an entry from its form in `measured.yaml`."""
        return cls(
            plain["starts"],
            tuple(plain["reports"]),
            (1.0, *plain.get("times", ())),
            tuple(str(number) for number in plain.get("beside", ())),
        )


def misses(page: str | None = None) -> list[str]:
    """Return one sentence for each statement of the page that its reports do not contain.

    Args:
        page: Its text; None: that of docs/measured.md.
    """
    page = PAGE.read_text(encoding="utf-8") if page is None else page
    entries = [Entry.of(plain) for plain in yaml.safe_load(LIST.read_text(encoding="utf-8"))]
    parts = dict(parts_of(page))
    sentences = []
    for entry in entries:
        starting = [start for start in parts if start.startswith(entry.starts)]
        if len(starting) != 1:
            sentences.append(
                f"{LIST.name}: {len(starting)} rows of the page begin '{entry.starts}'"
            )
            continue
        known = [
            float(number) * factor
            for name in entry.reports
            for number in numbers((RESULTS / f"{name}.md").read_text(encoding="utf-8"))
            for factor in entry.times
        ]
        sentences += [
            f"{PAGE.name}: '{entry.starts}': {number} is not in {', '.join(entry.reports)}"
            for number in numbers(parts.pop(starting[0]))
            if number not in entry.beside and not agrees(number, known)
        ]
    sentences += [f"{LIST.name}: nothing says where '{start[:60]}' comes from" for start in parts]
    return sentences


def parts_of(page: str) -> Iterator[tuple[str, str]]:
    """Yield start and text of each part of the page with figures.

    Of a row of three cells these are the first and the second; of a paragraph, twice itself.
    """
    for paragraph in re.split(r"\n{2,}", page):
        rows = [
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in paragraph.splitlines()
            if line.startswith("|")
        ]
        if rows and len(rows[0]) == 3:
            yield from ((row[0], row[1]) for row in rows[2:])
        elif not paragraph.startswith("#") and numbers(paragraph):
            yield paragraph, paragraph


def numbers(text: str) -> list[str]:
    """Return the numbers of a text, without separators of thousands."""
    return [re.sub("[ ,]", "", digits) for digits in NUMBER.findall(BESIDE.sub("", text))]


def agrees(number: str, known: Sequence[float]) -> bool:
    """Return whether one of the known numbers rounds to this one."""
    if "e" in number:
        step = 0.1 * float(number)
    elif "." in number:
        step = 10.0 ** -len(number.partition(".")[2])
    else:
        zeros = len(number) - len(number.rstrip("0")) if int(number) >= ROUND else 0
        step = 10.0**zeros
    return any(abs(float(number) - candidate) <= 0.5000001 * step for candidate in known)
