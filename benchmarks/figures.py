"""Every published figure before and after: the README's by hand, the reports' from tables.

`figures.yaml` says what the README states, by subject, and why a report has changed. The tables of
`results/` are compared with those of the commit that it names, cell by cell: the same heading, the
same words in a row, the same column. A row or a column of today that names a localizer stands for
the one without it where it is `product`. Intervals are left out of the comparison.

    python benchmarks/figures.py --out docs/figures.md
    python benchmarks/figures.py --check

The second makes nothing: it fails where docs/measured-table.md or the figures of docs/measured.md
are not what the reports give (`measured.py`), or where docs/figures.md is not what would be made.
"""

from __future__ import annotations

import argparse
import re
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import measured
import yaml
from harness import ROOT, table
from report_tables import Table, tables_of

RESULTS = "benchmarks/results"
STATES = {
    "measured": "measured again",
    "same": "as before",
    "learning": "as before until the issue on learning",
    "open": "to be measured again",
    "withdrawn": "withdrawn",
    "new": "new",
}
MAIN = "product"
"""The localizer that a report without the name of one had."""
NUMBER = re.compile(r"\d")
INTERVAL = re.compile(
    r"(?<=[\d%m]) (?:\([-+]?[\d.]+ ?%? to [-+]?[\d.]+ ?[%m]?\)|\[-?[\d.e+]+, -?[\d.e+]+\])"
)
GONE = "gone"


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures.md")
    parser.add_argument(
        "--list", type=Path, default=Path(__file__).with_name("figures.yaml"), help="what is stated"
    )
    parser.add_argument("--check", action="store_true", help="write nothing, only compare")
    args = parser.parse_args()
    plain = yaml.safe_load(args.list.read_text(encoding="utf-8"))
    if not args.check:
        args.out.write_text(page(plain), encoding="utf-8")
        return
    misses = measured.misses()
    # Earlier reports are read from the history, which a shallow clone lacks.
    if is_known(plain["before"]) and args.out.read_text(encoding="utf-8") != page(plain):
        misses.append(f"{args.out.name} is not what figures.py makes of the reports; run it again")
    print("\n".join(misses) or "the pages say what the reports say")
    raise SystemExit(bool(misses))


def is_known(commit: str) -> bool:
    """Return whether the history contains a commit."""
    done = subprocess.run(["git", "cat-file", "-e", commit], cwd=ROOT, capture_output=True)
    return done.returncode == 0


def page(plain: dict[str, Any]) -> str:
    """Return the whole page: the README's figures by subject, the list of reports, their tables."""
    base = plain["before"]
    stated = [figure for part in plain["readme"] for figure in part["figures"]]
    parts = [
        f"# {plain['title']}",
        plain["text"].strip(),
        "## What README.md and measured-table.md state",
    ]
    parts.append(counted([figure["status"] for figure in stated]))
    header = ("figure", "before", "now", "cause of the change", "made by")
    for part in plain["readme"]:
        rows = [
            [
                figure["what"], _with(figure["before"], figure.get("commit")), now(figure),
                figure.get("cause", ""), f"`{figure['command']}`",
            ]
            for figure in part["figures"]
        ]  # fmt: skip
        parts += [f"### {part['subject']}", table(header, rows, words=5)]
    parts.append("## The reports in benchmarks/results")
    changed, rows, states = [], [], []
    listed = {entry["report"] for entry in plain["reports"]}
    others = sorted(path.name for path in (ROOT / RESULTS).glob("*.md") if path.name not in listed)
    for report_entry in [*plain["reports"], *({"report": name} for name in others)]:
        name = report_entry["report"]
        old, new = before(base, name), after(name)
        same = old == new
        status = report_entry.get("status") or ("open" if same else "measured" if old else "new")
        states.append(status)
        link = f"[{name}](../{RESULTS}/{name})" if new else f"`{name}`"
        rows.append(
            [link, commit_of(old), "" if same else commit_of(new), STATES[status],
             report_entry.get("cause", "")]
        )  # fmt: skip
        if old and new and not same:
            changed.append((name, compared(old, new)))
    header = ("report", "before at", "now at", "status", "cause of the change")
    parts += [counted(states), table(header, rows, words=5)]
    parts += ["## What has changed in the reports", plain["tables"].strip()]
    for name, tables in changed:
        parts += [f"<details><summary>{name}</summary>", tables, "</details>"]
    return "\n\n".join(parts) + "\n"


def now(figure: dict[str, Any]) -> str:
    """Return the present value of a figure of the README, or why there is none."""
    state = f"*{STATES[figure['status']]}*"
    if "after" not in figure:
        return state
    value = _with(figure["after"], figure.get("after_commit"))
    return f"{value}; {state}" if figure["status"] == "withdrawn" else value


def counted(states: list[str]) -> str:
    """Say how many figures are in which state."""
    number = [f"{states.count(name)} {text}" for name, text in STATES.items() if name in states]
    return f"{len(states)} in all: {', '.join(number)}."


def _with(text: str, commit: str | None) -> str:
    return f"{text} ({commit})" if commit else str(text)


def before(base: str, name: str) -> str:
    """Return a report at a commit; empty if there was none."""
    done = subprocess.run(
        ["git", "show", f"{base}:{RESULTS}/{name}"], cwd=ROOT, capture_output=True, text=True
    )
    return done.stdout if done.returncode == 0 else ""


def after(name: str) -> str:
    """Return the present report; empty if there is none."""
    path = ROOT / RESULTS / name
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def commit_of(text: str) -> str:
    """Return the commit that a report names."""
    match = re.search(r"^- commit: (\w{7})", text, flags=re.MULTILINE)
    return match.group(1) if match else ""


def keyed(report_table: Table) -> dict[tuple[Any, ...], str]:
    """Return cells by heading and the words of row and column; repeated keys get a number."""
    cells: dict[tuple[Any, ...], str] = {}
    counts: Counter[tuple[Any, ...]] = Counter()
    for row in report_table.rows:
        words = words_of(report_table, row)
        if words is None:
            continue
        for name, cell in zip(report_table.header, row, strict=True):
            key = (report_table.heading, words, name.removesuffix(f", {MAIN}"))
            cells[(*key, counts[key])] = cell
            counts[key] += 1
    return cells


def words_of(report_table: Table, row: tuple[str, ...]) -> tuple[str, ...] | None:
    """Return a row's leading cells that are words; None for a localizer other than `MAIN`."""
    if len(row) != len(report_table.header):
        return None
    if "localizer" in report_table.header and MAIN in {
        r[report_table.header.index("localizer")] for r in report_table.rows
    }:
        at = report_table.header.index("localizer")
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
    """Return the old tables, without unchanged rows and columns."""
    known: dict[tuple[Any, ...], str] = {}
    for report_table in tables_of(new):
        known |= keyed(report_table)
    shared = [
        report_table for report_table in tables_of(old) if keyed(report_table).keys() & known.keys()
    ]
    if not shared:
        return "Its tables are other ones now; the report holds them."
    parts = [text for report_table in shared if (text := _changed(report_table, known))]
    return "\n\n".join(parts) or "No figure of tables that are in both has changed."


def _changed(report_table: Table, known: dict[tuple[Any, ...], str]) -> str:
    """Return the changes of a table under its heading; empty if there are none."""
    rows, gone = [], []
    counts: Counter[tuple[Any, ...]] = Counter()
    for row in report_table.rows:
        words = words_of(report_table, row)
        if words is None:
            continue
        pairs = []
        for at, (name, cell) in enumerate(zip(report_table.header, row, strict=False)):
            number = counts[words, name]
            counts[words, name] += 1
            now = known.get((report_table.heading, words, name, number), GONE if cell else "")
            pairs.append((plain_of(cell), plain_of(cell if at < len(words) else now)))
        if any(text != GONE for _, text in pairs[len(words) :]):
            rows.append((len(words), pairs))
        else:
            gone.append(" ".join(words))
    lead = max((count for count, _ in rows), default=0)
    moved = [{at for at, (was, now) in enumerate(pairs) if was != now} for _, pairs in rows]
    columns = [
        at for at in range(len(report_table.header)) if at < lead or any(at in m for m in moved)
    ]
    lines = [
        [_cell(*pairs[at]) for at in columns]
        for (_, pairs), changes in zip(rows, moved, strict=True)
        if changes
    ]
    if not lines and not gone:
        return ""
    parts = [f"**{report_table.heading}**"] if report_table.heading else []
    if lines:
        parts.append(table([report_table.header[at] for at in columns], lines, words=max(lead, 1)))
    if gone:
        parts.append(f"No longer in the report: {'; '.join(gone)}.")
    return "\n\n".join(parts)


def _cell(was: str, now: str) -> str:
    return was if was == now else f"{was} → {now}"


def plain_of(cell: str) -> str:
    """Return a cell without its intervals."""
    return INTERVAL.sub("", cell)


if __name__ == "__main__":
    main()
