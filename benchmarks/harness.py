"""Common parts of the benchmarks: data folder, interleaved timing, and Markdown reports."""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.runtime.provenance import code_digest

ROOT = Path(__file__).resolve().parents[1]
# Where the environments lie: in the repository, or in the folder that AMBINAV_DATA names.
ENVIRONMENTS = {
    "demo": "configs/demo.geojson",
    "aces": "maps_from_logs/aces.yaml",
    "willow_full_005": "maps/willow_full_005.yaml",
    "stata_hallways_5cm": "maps/stata_hallways_5cm.yaml",
    "nav2_depot": "maps/nav2_depot.yaml",
    "edmonton": "maps_from_logs/edmonton.yaml",
    "infinite-corridor": "maps_from_logs/infinite-corridor.yaml",
    "intel": "maps_from_logs/intel.yaml",
    "freiburg-079": "maps_from_logs/freiburg-079.yaml",
    "aws_small_house": "maps/aws_small_house.yaml",
    "nav2_tb3_sandbox": "maps/nav2_tb3_sandbox.yaml",
    "belgioioso": "maps_from_logs/belgioioso.yaml",
    "mrpt_uwb_hall": "maps/mrpt_uwb_hall.yaml",
    "stata_basement": "maps/stata_basement.yaml",
    "ipa_lab_intel": "maps_research_only/ipa_lab_intel.yaml",
    "navrep_markclutter": "maps/navrep_markclutter.yaml",
    "institute": "plans/institute.ifc",
    "duplex": "plans/duplex.ifc",
    "barcelona_pavilion": "plans/barcelona_pavilion.ifc",
}
LEVELS = {"institute": "Erdgeschoss", "duplex": "Level 1"}
"""Storeys of the plans that have several."""
BUNDLED = ("demo",)
MAP_FOLDERS = ("maps", "maps_from_logs", "maps_research_only", "planner_maps")
SOURCES = ("ambinav", "planners", "envs", "benchmarks")

T = TypeVar("T")


def environment_path(name: str) -> Path:
    """Return the file of the environment called `name` in `ENVIRONMENTS`.

    Ends the program with status 2 and one sentence if the recorded data is not there.
    """
    if name in BUNDLED:
        return ROOT / ENVIRONMENTS[name]
    return data_file(ENVIRONMENTS[name])


def environment_of(name: str) -> Environment:
    """Load the environment called `name` in `ENVIRONMENTS`; of several storeys that of `LEVELS`."""
    return load_environment(environment_path(name), level=LEVELS.get(name))


def data_file(name: str) -> Path:
    """Return a file or folder of the recorded data; ends the program as `environment_path`."""
    folder = os.environ.get("AMBINAV_DATA")
    if not folder:
        _refuse(
            f"{name} is recorded data and AMBINAV_DATA is not set; set it to the folder that holds "
            "maps/, maps_from_logs/ and logs/."
        )
    path = Path(folder) / name
    if not path.exists():
        _refuse(f"{path}: no such file; AMBINAV_DATA must name the folder that holds it.")
    return path


def recorded_maps(names: Sequence[str] | None = None) -> list[Path]:
    """Return the occupancy maps of the recorded data, folder by folder; those named, or all."""
    paths = [path for folder in MAP_FOLDERS for path in sorted(data_file(folder).glob("*.yaml"))]
    return [path for path in paths if not names or path.stem in names]


def _refuse(sentence: str) -> NoReturn:
    print(f"{Path(sys.argv[0]).name}: {sentence}", file=sys.stderr)
    raise SystemExit(2)


@dataclass(frozen=True)
class Timing:
    """Wall-clock seconds of the repeats of one contestant, in the order of the rounds."""

    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median of the repeats, seconds."""
        return float(np.median(self.seconds))

    def rate(self, amount: float) -> str:
        """Return the median of amount / seconds in millions, and its range."""
        return spread([amount / seconds / 1e6 for seconds in self.seconds])

    def ratio(self, peer: Timing) -> str:
        """Return the ratio to the peer's rate: median and extremes over the rounds."""
        return spread([b / a for a, b in zip(self.seconds, peer.seconds, strict=True)])


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Format median and extremes, as "1.50 (1.41 to 1.63)"."""
    low, middle, high = min(values), float(np.median(values)), max(values)
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def interleave(
    contestants: Mapping[str, Callable[[], object]],
    repeats: int,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Timing]:
    """Time the contestants in rounds, each once a round, so that a slow moment hits them alike.

    A first round is not counted: it compiles, and faults the memory in.
    """
    seconds: dict[str, list[float]] = {name: [] for name in contestants}
    for turn in range(repeats + 1):
        for name, run in contestants.items():
            start = clock()
            run()
            if turn > 0:
                seconds[name].append(clock() - start)
    return {name: Timing(tuple(values)) for name, values in seconds.items()}


def timed(run: Callable[[], T]) -> tuple[float, T]:
    """Call a function; return the seconds and its result."""
    start = time.perf_counter()
    result = run()
    return time.perf_counter() - start, result


def table(header: Sequence[str], rows: Iterable[Sequence[object]], words: int = 1) -> str:
    """Format a Markdown table; its first `words` columns are words, the others numbers."""
    rule = ["---"] * words + ["---:"] * (len(header) - words)
    return "\n".join(
        "| " + " | ".join(str(cell) for cell in line) + " |" for line in (header, rule, *rows)
    )


def report(title: str, libraries: Sequence[str], body: str, out: Path | None) -> None:
    """Print a report with the machine and versions, and store it in `out` if that is given."""
    text = f"# {title}\n\n{_provenance(libraries)}\n\n{body.strip()}\n"
    print(text)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text, encoding="utf-8")


def option(default: Any, help: str = "", **how: Any) -> dict[str, Any]:
    """Return an option with a line of help, for `arguments`; `how` goes to argparse."""
    return {"default": default, "help": help or None, **how}


def parser_of(about: str | None, **options: Any) -> argparse.ArgumentParser:
    """Return a command line of options, and of `--out`, which is the file of the report by default.

    Args:
        about: Docstring of the script; its first line is the description.
        options: By name: the default, from which the type follows (False is a switch, a sequence
            takes several values), or what `option` returns.
    """
    parser = argparse.ArgumentParser(description=(about or "").partition("\n")[0])
    report_file = option(None, "store the report in this Markdown file too", type=Path)
    for name, setting in {"out": report_file, **options}.items():
        how = dict(setting) if isinstance(setting, dict) else {"default": setting}
        default = how["default"]
        if default is False:
            how.setdefault("action", "store_true")
        elif isinstance(default, tuple | list):
            how.setdefault("nargs", "+")
            how.setdefault("type", type(default[0]) if default else str)
        elif default is not None:
            how.setdefault("type", type(default))
        parser.add_argument(f"--{name.replace('_', '-')}", **how)
    return parser


def arguments(about: str | None, **options: Any) -> argparse.Namespace:
    """Read the command line that `parser_of` makes."""
    return parser_of(about, **options).parse_args()


def _provenance(libraries: Sequence[str]) -> str:
    command = shlex.join(["python", *sys.orig_argv[1:]])
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    lines = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "processor": f"{_processor()}, {os.cpu_count()} cores, load {load}",
        "commit": commit(),
        "command": f"`{command}`",
        "versions": ", ".join(
            [
                f"Python {platform.python_version()}",
                *(f"{name} {version(name)}" for name in libraries),
            ]
        ),
    }
    return "\n".join(f"- {name}: {value}" for name, value in lines.items())


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        fields: dict[str, str] = {}
        for line in info.read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            fields[key.strip()] = value.strip()
        if "model name" in fields:
            family = "/".join(fields.get(key, "?") for key in ("cpu family", "model", "stepping"))
            return f"{fields['model name']} (family/model/stepping {family})"
    return platform.processor() or platform.machine()


def commit() -> str:
    """Return the commit of the checkout, and whether it has uncommitted changes."""

    def git(*arguments: str) -> str:
        result = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
        return result.stdout.strip() if result.returncode == 0 else ""

    head = git("rev-parse", "--short=12", "HEAD")
    if not head:
        return "unknown (not a git repository)"
    changed = git("status", "--porcelain", "--untracked-files=no", "--", *SOURCES)
    return f"{head}, with uncommitted changes" if changed else head


def kept_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a file of JSON lines; none if it does not exist.

    A last line without its end, whose writer was stopped, does not count.
    """
    if not path.is_file():
        return []
    complete, _, _ = path.read_text(encoding="utf-8").rpartition("\n")
    return [json.loads(line) for line in complete.splitlines()]


@contextmanager
def appended(path: Path) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Append rows to a file of JSON lines; each is written to disk at once.

    Every row says at which commit it was made. One process at a time: a second one ends with
    status 2.
    """
    made_at = commit()
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            _refuse(f"{path}: another process is writing it; wait for that one or stop it.")
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)

        def append(row: Mapping[str, Any]) -> None:
            file.write(json.dumps({**row, "commit": made_at}).encode() + b"\n")
            file.flush()

        yield append


def kept_or_made(
    path: Path, key: Mapping[str, Any], make: Callable[[], Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the row with this key from a file of JSON lines; compute and append it if missing.

    Part of the key is the digest of the code, so that nothing is reused that other code computed.
    """
    full_key = {**key, "code": code_digest()}
    for row in kept_rows(path):
        if all(row.get(name) == value for name, value in full_key.items()):
            return row
    with appended(path) as append:
        append({**full_key, **make()})
    return kept_rows(path)[-1]


def run_script(*words: str) -> None:
    """Run a script of this folder in a separate process; exit with its error if it fails."""
    script = Path(__file__).with_name(words[0])
    result = subprocess.run(
        [sys.executable, str(script), *words[1:]], stderr=subprocess.PIPE, text=True, check=False
    )
    if result.returncode:
        raise SystemExit(f"{' '.join(words)}: {result.stderr}")


def in_all(
    rows_by_name: Mapping[str, list[dict[str, Any]]], names: Sequence[str], key: Sequence[str]
) -> dict[str, list[dict[str, Any]]]:
    """Keep the rows of each localizer whose keys all of the named localizers have.

    A study that was stopped may have driven more with one than with another; localizers without
    any row are not asked.
    """

    def of(row: Mapping[str, Any]) -> tuple[Any, ...]:
        return tuple(row[part] for part in key)

    keys = [{of(row) for row in rows_by_name[name]} for name in names if rows_by_name.get(name)]
    shared = set.intersection(*keys) if keys else set()
    return {name: [row for row in rows if of(row) in shared] for name, rows in rows_by_name.items()}


def joined_rows(
    routes: Iterable[Mapping[str, Any]], drives: Iterable[Mapping[str, Any]], names: Iterable[str]
) -> Iterator[dict[str, Any]]:
    """Yield each drive with the figures of the routes of its pair, which have these names."""
    by_pair = {row["pair"]: row for row in routes}
    for drive in drives:
        route = by_pair[drive["pair"]]
        yield {**drive, **{name: {**route[name], **drive[name]} for name in names}}


def commits(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return the commits at which rows were made, and how many at each."""
    counts: dict[str, int] = {}
    for row in rows:
        counts[row["commit"]] = counts.get(row["commit"], 0) + 1
    return "; ".join(f"{name} ({count})" for name, count in counts.items())
