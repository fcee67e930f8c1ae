"""Every published figure before and after: the README's by hand, the reports' from their tables.

`figures.yaml` says what the README states, and why a report has changed. The tables of
`results/` are compared with those of the commit that it names, cell by cell: the same heading, the
same words in a row, the same column. A row or a column of today that names a localizer stands for
the one without it where it is `product`.

    python benchmarks/figures.py --out docs/figures.md
"""

from __future__ import annotations

import argparse
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from harness import ROOT, table

RESULTS = "benchmarks/results"
STATES = {
    "measured": "measured again",
    "same": "as before",
    "learning": "as before; left to the issue on learning",
    "open": "to be measured again",
    "withdrawn": "withdrawn",
    "new": "new",
}
MAIN = "product"
"""The localizer that a report without the name of one had."""
NUMBER = re.compile(r"\d")


@dataclass(frozen=True)
class Table:
    """A table of a report.

    Attributes:
        heading: The headings above it but the title.
        header: Its columns.
        rows: Its cells.
    """

    heading: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def main() -> None:
    """Lay the page out."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures.md")
    parser.add_argument(
        "--list", type=Path, default=Path(__file__).with_name("figures.yaml"), help="what is stated"
    )
    args = parser.parse_args()
    plain = yaml.safe_load(args.list.read_text(encoding="utf-8"))
    args.out.write_text(page(plain), encoding="utf-8")


def page(plain: dict[str, Any]) -> str:
    """The whole page."""
    base = plain["before"]
    parts = [f"# {plain['title']}", plain["text"].strip(), "## What the README states"]
    header = ("what", "made by", "before", "after", "status", "cause")
    rows = [
        [
            one["what"], f"`{one['command']}`", _with(one["before"], one.get("commit")),
            _with(one.get("after", ""), one.get("after_commit")), STATES[one["status"]],
            one.get("cause", ""),
        ]
        for one in plain["readme"]
    ]  # fmt: skip
    parts.append(table(header, rows, words=6))
    parts.append("## The reports in benchmarks/results")
    changed, rows = [], []
    listed = {one["report"] for one in plain["reports"]}
    others = sorted(path.name for path in (ROOT / RESULTS).glob("*.md") if path.name not in listed)
    for one in [*plain["reports"], *({"report": name} for name in others)]:
        old, new = before(base, one["report"]), after(one["report"])
        same = old == new
        status = one.get("status") or ("open" if same else "measured" if old else "new")
        rows.append(
            [f"`{one['report']}`", commit_of(old), "" if same else commit_of(new), STATES[status],
             one.get("cause", "")]
        )  # fmt: skip
        if old and new and not same:
            changed.append((one["report"], compared(old, new)))
    parts.append(table(("report", "before at", "after at", "status", "cause"), rows, words=5))
    for name, tables in changed:
        parts += [f"## {name}", tables]
    return "\n\n".join(parts) + "\n"


def _with(text: str, commit: str | None) -> str:
    return f"{text} ({commit})" if commit else str(text)


def before(base: str, name: str) -> str:
    """A report at a commit; empty if there was none."""
    done = subprocess.run(
        ["git", "show", f"{base}:{RESULTS}/{name}"], cwd=ROOT, capture_output=True, text=True
    )
    return done.stdout if done.returncode == 0 else ""


def after(name: str) -> str:
    """A report as it is; empty if there is none any more."""
    path = ROOT / RESULTS / name
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def commit_of(text: str) -> str:
    """The commit that a report names."""
    found = re.search(r"^- commit: (\w{7})", text, flags=re.MULTILINE)
    return found.group(1) if found else ""


def tables_of(text: str) -> Iterator[Table]:
    """The tables of a report, in their order."""
    heading: dict[int, str] = {}
    lines: list[str] = []
    for line in [*text.splitlines(), ""]:
        if line.startswith("|"):
            lines.append(line)
            continue
        if len(lines) > 2:
            cells = [tuple(cell.strip() for cell in row.strip("|").split("|")) for row in lines]
            above = [name for level, name in heading.items() if level > 1]
            yield Table(" / ".join(above).replace("a way", "a route"), cells[0], tuple(cells[2:]))
        lines = []
        if found := re.match(r"(#+) (.*)", line):
            level = len(found.group(1))
            heading = {k: v for k, v in heading.items() if k < level} | {level: found.group(2)}


def keyed(one: Table) -> dict[tuple[Any, ...], str]:
    """Cells by heading, words of the row and column; the same words again have another number."""
    found: dict[tuple[Any, ...], str] = {}
    for row in one.rows:
        words = words_of(one, row)
        if words is None:
            continue
        for name, cell in zip(one.header, row, strict=True):
            key: tuple[Any, ...] = (one.heading, words, name.removesuffix(f", {MAIN}"))
            number = sum(1 for k in found if k[:3] == key)
            found[(*key, number)] = cell
    return found


def words_of(one: Table, row: tuple[str, ...]) -> tuple[str, ...] | None:
    """The leading cells of a row that are words; None for another localizer than `MAIN`."""
    if len(row) != len(one.header):
        return None
    if "localizer" in one.header and MAIN in {r[one.header.index("localizer")] for r in one.rows}:
        at = one.header.index("localizer")
        if row[at] != MAIN:
            return None
        row = row[:at] + row[at + 1 :]
    words: list[str] = []
    for cell in row:
        if words and (not cell or NUMBER.match(cell.lstrip("+-"))):
            break
        words.append(cell)
    return tuple(words)


def compared(old: str, new: str) -> str:
    """The old tables, each cell that is another one now with both values."""
    known: dict[tuple[Any, ...], str] = {}
    for one in tables_of(new):
        known |= keyed(one)
    parts, shared = [], False
    for one in tables_of(old):
        if not keyed(one).keys() & known.keys():
            continue
        shared = True
        lines = []
        for row in one.rows:
            words = words_of(one, row)
            counts: dict[str, int] = {}
            line = []
            for at, (name, cell) in enumerate(zip(one.header, row, strict=False)):
                number = counts.get(name, 0)
                counts[name] = number + 1
                now = known.get((one.heading, words, name, number))
                if now is None and cell and at >= len(words or ()):
                    now = "gone"
                line.append(cell if now in (None, cell) else f"{cell} → {now}")
            lines.append(line)
        if any("→" in cell for line in lines for cell in line):
            title = [f"### {one.heading}"] if one.heading else []
            parts += [*title, table(one.header, lines, words=1)]
    if not shared:
        return "Its tables are other ones now; the report holds them."
    return "\n\n".join(parts) or "No figure of tables that are in both has changed."


if __name__ == "__main__":
    main()
