"""Writing a leaderboard: report.md, report.json, table.csv, overview.png."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import ambinav
from ambinav.errors import InputError
from ambinav.files import replacing
from ambinav.pages import fill
from ambinav.plotting.canvas import save_figure
from ambinav.plotting.style import FORMATS
from ambinav.provenance import discard_stale
from ambinav.runfolder import NAME as LOCK
from ambinav.runfolder import only_one
from ambinav_envs.evaluation import Episodes
from ambinav_envs.leaderboard.board import BASELINE, CONDITIONS, Bars, Board, fitting, run
from ambinav_envs.leaderboard.figures import (
    FIGURES,
    Row,
    difference_text,
    is_shown,
    make_rows,
    plain,
    to_csv,
    value_text,
)
from ambinav_envs.leaderboard.overview import plot_board
from ambinav_envs.leaderboard.store import computed_by
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.fit import difference_text as differs_text

JSON: Final = "report.json"
MARKDOWN: Final = "report.md"
TABLE: Final = "table.csv"
OVERVIEWS: Final = tuple(f"overview.{image_format}" for image_format in FORMATS)
WORK: Final = "work"
"""Folder of what is kept to go on after a break."""
OURS: Final = (JSON, MARKDOWN, TABLE, *OVERVIEWS, WORK)

HALVED, LONGER = 0.5, 0.1
"""The goal of a method against the shortest ways: lost at most half as often, for a way that is at
most so much longer."""


def check_output(folder: Path) -> None:
    """Check that a leaderboard may be written to a folder.

    Raises:
        InputError: it is a file, or holds something else than an earlier leaderboard.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: this is a file, not a folder; choose another output.")
    for item in sorted(folder.iterdir()) if folder.exists() else ():
        if item.name not in OURS and not _is_left_over(item):
            raise InputError(
                f"{folder}: this folder holds {item.name}, which is not of an earlier leaderboard; "
                "choose a new folder."
            )


def benchmark(
    board: Board, folder: Path, bars: Bars | None = None, image_format: str = "png"
) -> tuple[Row, ...]:
    """Make a leaderboard and write it; what an earlier call left in the folder is used.

    What other code left there is discarded, which a warning says.

    Args:
        board: Who takes part, and where.
        folder: Where to write.
        bars: Given a text, returns what takes the share done.
        image_format: Of the picture, one of `ambinav.plotting.style.FORMATS`.

    Returns:
        The rows of the table.

    Raises:
        InputError: see `check_output`, `fitting` and `run`; or another call is at work there.
    """
    check_output(folder)
    board = fitting(board)
    begin = bars or (lambda text: lambda share: None)
    with only_one(folder / WORK):
        for left in (*folder.iterdir(), *(folder / WORK).iterdir()):
            if _is_left_over(left):
                shutil.rmtree(left)
        discard_stale(folder / WORK, computed_by(), kept=(LOCK,))
        found = run(board, folder / WORK, begin)
        rows = rows_of(found, board.seed)
        for picture in OVERVIEWS:
            (folder / picture).unlink(missing_ok=True)
        picture = f"overview.{image_format}"
        with replacing(folder / picture) as scratch:
            save_figure(plot_board(rows, f"Leaderboard, {board.episodes} episodes each"), scratch)
        _write(folder / TABLE, to_csv(rows))
        _write(folder / JSON, to_json(board, found, rows) + "\n")
        _write(folder / MARKDOWN, to_markdown(board, rows, picture))
    return rows


def rows_of(found: Mapping[str, Mapping[str, Episodes]], seed: int) -> tuple[Row, ...]:
    """The table of all settings."""
    return tuple(
        row
        for setting, episodes in found.items()
        for row in make_rows(setting, episodes, BASELINE, seed)
    )


def to_json(board: Board, found: Mapping[str, Mapping[str, Episodes]], rows: Sequence[Row]) -> str:
    """All figures with intervals and differences, and how they came about."""
    told = {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "ambinav": ambinav.__version__,
        "episodes": board.episodes,
        "seed": board.seed,
        "options": dict(board.options),
        "layer": NavigationParameters.of(board.options).cost_layer,
        "conditions": {name: dict(options) for name, options in CONDITIONS.items()},
        "baseline": BASELINE,
        "methods": [
            {
                "name": m.name,
                "kind": m.kind,
                "text": m.text,
                "seeing": m.seeing,
                "differs": board.differs.get(m.name, {}),
                **m.identity,
            }
            for m in board.methods
        ],
        "rows": [
            {
                "setting": row.setting,
                "method": row.method,
                "goal": goal_text(row, _base(row, rows)),
                "figures": {cell.figure.key: plain(cell.value) for cell in row.cells},
                "differences": {cell.figure.key: plain(cell.difference) for cell in row.cells},
                "reward": float(found[row.setting][row.method].reward.mean()),
            }
            for row in rows
        ],
    }
    return json.dumps(told, indent=2, default=str)


def to_markdown(board: Board, rows: Sequence[Row], picture: str) -> str:
    """The report for readers; it shows the picture of this name."""
    filters: dict[str, Callable[..., str]] = {
        "value": value_text,
        "difference": difference_text,
        "goal": lambda row: goal_text(row, _base(row, rows)),
    }
    values: dict[str, Any] = {
        "board": board,
        "rows": rows,
        "settings": list(dict.fromkeys(row.setting for row in rows)),
        "figures": FIGURES,
        "baseline": BASELINE,
        "picture": picture,
        "conditions": CONDITIONS,
        "layer": NavigationParameters.of(board.options).cost_layer,
        "differs": {name: differs_text(found) for name, found in board.differs.items()},
    }
    return fill("ambinav_envs.leaderboard", "report.md.j2", filters, **values)


def goal_text(row: Row, base: Row | None) -> str:
    """Whether a method is lost at most half as often as the baseline, and not much longer.

    Told by the figures and the interval of their difference, so that it may be unclear.
    """
    if base is None or row is base or row["lost"].difference is None:
        return ""
    before, after = base["lost"].value.value, row["lost"].value.value
    shown = is_shown(row["lost"].difference)
    if shown and after > before:
        return "lost more often"
    if before == after == 0.0:
        return "nobody lost to begin with"
    longer = row["length"].difference
    if longer is None or longer.count == 0:
        return "no episode to compare lengths by"
    short = longer.value <= LONGER * base["length"].value.value
    if not shown:
        return "no difference shown"
    if after > HALVED * before:
        return "lost less often, not halved"
    return "met" if short else "halved, but too long a way"


def _base(row: Row, rows: Sequence[Row]) -> Row | None:
    own = (one for one in rows if one.setting == row.setting and one.method == BASELINE)
    return next(own, None)


def _is_left_over(path: Path) -> bool:
    """Whether `replacing` made this folder and was killed before it could remove it."""
    name, _, rest = path.name.removeprefix(".").rpartition(".")
    ours = name in OURS or path.parent.name == WORK
    return path.name.startswith(".") and bool(rest) and ours and path.is_dir()


def _write(path: Path, text: str) -> None:
    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
