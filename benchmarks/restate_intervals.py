"""Give the shares of older reports in results/ score intervals, from the counts that they print.

Reports before 2026-11-25 have intervals of shares by the bootstrap. Where a report says how many
runs there were and what share of them, the interval is computed as the scripts do today
(`ambinav.drive.bootstrap`). Where rounding leaves several counts, it holds the intervals of all.

    python benchmarks/restate_intervals.py
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from ambinav.drive.bootstrap import Interval, paired_share, share

RESULTS = Path(__file__).with_name("results")
RUNS = 30
"""Of a route in the reports of sonar and claim."""
OLD = ", bootstrap"
"""What an interval of the older kind is marked with."""


def counts_of(shown: str, runs: int, digits: int) -> list[int]:
    """Return all counts of `runs` that are shown as this percentage."""
    return [k for k in range(runs + 1) if f"{100.0 * k / runs:.{digits}f}" == shown]


def happened(count: int, runs: int) -> np.ndarray:
    """Return as many truth values."""
    return np.arange(runs) < count


def hull(intervals: Iterable[Interval], digits: int) -> tuple[str, str]:
    """Return the outer ends of intervals, in percent."""
    known = list(intervals)
    assert known
    low, high = min(i.low for i in known), max(i.high for i in known)
    return f"{100.0 * low:.{digits}f}", f"{100.0 * high:.{digits}f}"


def cells(line: str) -> list[str]:
    """Return the cells of a line of a table."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def joined(row: Sequence[str]) -> str:
    """Return a line of a table."""
    return f"| {' | '.join(row)} |"


def sonar(text: str) -> str:
    """Restate `sonar.md`: shares of the runs on one route, or on both in words."""
    totals: dict[tuple[str, str], int] = {}
    for name, loop, odometry, shown in re.findall(
        r"^- (.*?), (open|closed) loop, odometry of ([\d.]+) .*?: ([\d.]+) % \(", text, re.M
    ):
        (totals[name, f"{loop}, {odometry}"],) = counts_of(shown, 12 * RUNS, 1)

    def in_words(match: re.Match[str]) -> str:
        (count,) = counts_of(match[1], int(match[2]), 1)
        low, high = hull([share(happened(count, int(match[2])))], 1)
        return f"{match[1]} % ({low} to {high}) of {match[2]} runs lost"

    text = re.sub(r"([\d.]+) % \([\d.]+ to [\d.]+\) of (\d+) runs lost", in_words, text)
    lines, heading, label = [], "", ""
    for line in text.splitlines():
        if line.startswith("#"):
            heading = line.strip("# ")
            label = heading if line.startswith("###") else label
        row = cells(line) if line.startswith("|") else []
        if len(row) == 10 and row[1].isdigit():
            runs = int(row[1]) // 2
            at = [2, 6]
            shown = [re.match(r"\d+", row[i])[0] for i in at]  # type: ignore[index]
            odometry = "9" if "twice as bad" in heading else "4.5"
            loop = "closed" if "closed loop" in heading else "open"
            name = {"the ring": label}.get(row[0], row[0])
            total = totals.get((name, f"{loop}, {odometry}"))
            both = [
                (a, b)
                for a in counts_of(shown[0], runs, 0)
                for b in counts_of(shown[1], runs, 0)
                if total is None or a + b == total
            ]
            for k, i in enumerate(at):
                ends = hull((share(happened(pair[k], runs)) for pair in both), 0)
                row[i] = f"{shown[k]} ({ends[0]} to {ends[1]})"
            line = joined(row)
        lines.append(line)
    return "\n".join(lines) + "\n"


def difference(lost: Sequence[int], gained: Sequence[int] | None = None) -> Interval:
    """Return the difference of shares, by how many runs of each pair are lost on one route only.

    Args:
        lost: On the shortest route alone.
        gained: On the aware route alone; None: none.
    """
    gained = [0] * len(lost) if gained is None else gained
    ours = np.concatenate([happened(count, RUNS) for count in gained])
    theirs = np.concatenate([happened(count, RUNS)[::-1] for count in lost])
    pair = np.repeat(np.arange(len(lost)), RUNS)
    return paired_share(ours, theirs, group=pair).scaled(100.0)


KNOWN = {(2, "95.0", "0.0"): (27, 30), (2, "38.3", "0.0"): (7, 16)}
"""Runs lost of two pairs; the table of lost robots by both stretches has each by itself."""


def claimed(pairs: int, shortest: str, aware: str, old: tuple[str, str, str]) -> Interval | None:
    """Return the interval of a difference in `claim.md`; None: the counts are not known.

    They are known where no run differs (the old interval is a point), where there is one pair and
    one of its routes loses nobody, and where one run alone is lost.
    """
    runs = pairs * RUNS
    if set(old) == {"+0.0"}:
        return difference([0] * pairs)
    if (pairs, shortest, aware) in KNOWN:
        return difference(KNOWN[pairs, shortest, aware])
    for one_sided, sign in (((shortest, aware), 1), ((aware, shortest), -1)):
        lost, none = (counts_of(shown, runs, 1) for shown in one_sided)
        if none == [0] and len(lost) == 1 and (pairs == 1 or lost == [1]):
            counts = [*lost, *[0] * (pairs - 1)]
            zero = [0] * pairs
            return difference(counts, zero) if sign == 1 else difference(zero, counts)
    return None


def claim(text: str) -> str:
    """Restate `claim.md`: paired differences of lost robots, the runs of a pair as a group."""
    number = r"([+-][\d.]+)"

    def restated(pairs: int, shortest: str, aware: str, old: tuple[str, str, str]) -> str:
        new = claimed(pairs, shortest, aware, old)
        if new is None:
            return f"{old[1]} to {old[2]}{OLD}"
        assert f"{new.value:+.1f}" in (old[0], old[0].replace("+0.0", "-0.0")), (old, new)
        if (new.low > 0.0 or new.high < 0.0) != (float(old[1]) > 0.0 or float(old[2]) < 0.0):
            print("verdict changes:", pairs, shortest, aware, old, new)
        return f"{new.low:+.1f} to {new.high:+.1f}"

    lines, header = [], []
    for line in text.splitlines():
        if line.startswith("| ") and "difference, points" in line:
            header = cells(line)
        elif line.startswith("| ") and not line.startswith("| ---") and header:
            row = cells(line)
            lost = header.index("lost, shortest")
            if len(row) == len(header) and row[header.index("pairs")] != "0":
                at = header.index("difference, points")
                old = re.fullmatch(rf"{number} \({number} to {number}\)", row[at])
                assert old is not None, line
                shares = [row[i].removesuffix(" %") for i in (lost, lost + 1)]
                pairs = int(row[header.index("pairs")])
                row[at] = f"{old[1]} ({restated(pairs, *shares, old.groups())})"
                line = joined(row)
        elif not line.startswith("|"):
            header = []
        found = re.search(r", (\d+) pairs \(", line)
        if line.startswith("- lasers") or line.startswith("- ring"):
            assert found is not None

            def in_words(match: re.Match[str], pairs: int = int(found[1])) -> str:
                pairs = int(match[2]) if match[2] else pairs
                new = restated(pairs, match[3], match[4], (match[5], match[6], match[7]))
                return f"{match[1]}({match[5]} points, {new})"

            line = re.sub(
                r"(`\w+`(?: \((\d+) pairs\))? loses ([\d.]+) % on the shortest and ([\d.]+) % on "
                rf"the aware routes )\({number} points, {number} to {number}\)",
                in_words,
                line,
            )
        lines.append(line)
    return "\n".join(lines) + "\n"


def place(text: str) -> str:
    """Restate `place.md`: robots lost without posts and with them."""
    lines = []
    for line in text.splitlines():
        row = cells(line) if line.startswith("|") else []
        if len(row) == 11 and row[3].isdigit():
            runs = int(row[3])
            for i in (4, 5):
                shown = row[i].partition("%")[0]
                low, high = hull((share(happened(k, runs)) for k in counts_of(shown, runs, 0)), 0)
                row[i] = f"{shown}% ({low} to {high})"
            line = joined(row)
        lines.append(line)
    return "\n".join(lines) + "\n"


SHARES = ("arrived", "missed", "collided", "timeout", "ever lost")
EPISODES = 128


def transfer(text: str) -> str:
    """Restate `transfer.md`: shares of the episodes on a map, and of all with maps as groups."""
    sections = text.split("\n## ")
    counts: dict[str, dict[str, dict[str, int]]] = {}
    for section in sections[1:]:
        place_name = section.partition(",")[0]
        if f", {EPISODES} episodes" not in section.splitlines()[0]:
            continue
        for line in section.splitlines():
            row = cells(line) if line.startswith("| ") else []
            if len(row) == 8 and "[" in row[1]:
                own = counts.setdefault(place_name, {}).setdefault(row[0], {})
                for measure, cell in zip(SHARES, row[1:], strict=False):
                    (own[measure],) = counts_of(cell.split()[0], EPISODES, 1)
    judged = [name for name in counts if "choices" not in name]
    for number, section in enumerate(sections[1:], 1):
        name = section.partition(",")[0]
        pooled = name.startswith("all ")
        plain = pooled and "odometry_scale" not in section.splitlines()[0]
        maps = judged if pooled else [name]
        sections[number] = "\n".join(restated_lines(section, maps, plain, counts))
    return "\n## ".join(sections)


def restated_lines(
    section: str, maps: Sequence[str], plain: bool, counts: dict[str, dict[str, dict[str, int]]]
) -> Iterable[str]:
    """Yield the lines of a section with new intervals."""
    group = np.repeat(np.arange(len(maps)), EPISODES)
    shown: dict[str, list[str]] = {}
    for line in section.splitlines():
        row = cells(line) if line.startswith("| ") else []
        if len(row) == 8 and "[" in row[1]:
            shown[row[0]] = [cell.split()[0] for cell in row]
            for at, measure in enumerate(SHARES, 1):
                value = row[at].split()[0]
                if plain and value != "0.0":
                    row[at] = row[at].replace("]", f"{OLD}]")
                    continue
                own = [0 if plain else counts[name][row[0]][measure] for name in maps]
                new = share(np.concatenate([happened(k, EPISODES) for k in own]), group=group)
                assert f"{100 * new.value:.1f}" == value, (row, measure)
                row[at] = f"{value} [{100 * new.low:.1f}, {100 * new.high:.1f}]"
            line = joined(row)
        elif len(row) == 5 and row[0].startswith("less "):
            other, own_name = row[0].removeprefix("less "), next(iter(shown))
            for at, measure in enumerate(("arrived", "ever lost", "collided"), 1):
                row[at] = restated_pair(
                    row[at], [(own_name, other, measure, name) for name in maps], plain, counts,
                    shown, group,
                )  # fmt: skip
            line = joined(row)
        yield line


def restated_pair(
    cell: str,
    cases: Sequence[tuple[str, str, str, str]],
    plain: bool,
    counts: dict[str, dict[str, dict[str, int]]],
    shown: dict[str, list[str]],
    group: np.ndarray,
) -> str:
    """Return a difference with a score interval where on each map one side has none or all."""
    ours, theirs = [], []
    for own_name, other, measure, name in cases:
        if plain:
            at = 1 + SHARES.index(measure)
            if {shown[own_name][at], shown[other][at]} != {"0.0"}:
                return cell.replace("]", f"{OLD}]")
            a = b = 0
        else:
            a, b = counts[name][own_name][measure], counts[name][other][measure]
        if a not in (0, EPISODES) and b not in (0, EPISODES):
            return cell.replace("]", f"{OLD}]")
        ours.append(happened(a, EPISODES))
        theirs.append(happened(b, EPISODES))
    new = paired_share(np.concatenate(ours), np.concatenate(theirs), group=group).scaled(100.0)
    value = cell.strip("*").split()[0]
    assert f"{new.value:+.1f}" == value, (cell, new)
    bold = "**" if new.low > 0.0 or new.high < 0.0 else ""
    if bold != ("**" if cell.startswith("**") else ""):
        print("bold changes:", cases[0], cell, new)
    return f"{bold}{value} [{new.low:+.1f}, {new.high:+.1f}]{bold}"


ALL: dict[str, Callable[[str], str]] = {
    "sonar": sonar, "claim": claim, "place": place, "transfer": transfer,
}  # fmt: skip


def main() -> None:
    """Write the reports anew."""
    for name, restate in ALL.items():
        path = RESULTS / f"{name}.md"
        path.write_text(restate(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
