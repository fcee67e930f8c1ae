"""Output of a leaderboard: report.md, report.json, table.csv, overview.png."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Final

from ambinav.reports.criterion import AcceptanceCriterion
from ambinav.reports.table import difference_text, interval_text, is_shown, value_text
from ambinav.runtime.progress import Stages, silent_stages
from ambinav.runtime.provenance import discard_stale
from ambinav.runtime.runfolder import LOCK, WORK
from ambinav.studies.study import Content, Study
from ambinav.version import __version__
from ambinav_envs.evaluation import Episodes
from ambinav_envs.leaderboard.board import BASELINE, Board, fitting, run
from ambinav_envs.leaderboard.figures import (
    FIGURES,
    SCORE,
    TASK_FIGURES,
    Row,
    make_rows,
    plain,
    to_csv,
)
from ambinav_envs.leaderboard.methods import TRUE_POSE
from ambinav_envs.leaderboard.normalized import BLIND, NormalizedScores, normalized_scores
from ambinav_envs.leaderboard.overview import plot_board
from ambinav_envs.leaderboard.returns import agreeing
from ambinav_envs.leaderboard.store import computed_by
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.fit import difference_text as differs_text

OVERVIEW: Final = "overview"
STUDY: Final = Study(
    "leaderboard", "ambinav_envs.leaderboard", (OVERVIEW,), ("table.csv",), documents=("json", "md")
)

CRITERION: Final = AcceptanceCriterion(lost=0.5)
"""Criterion for a method against the shortest routes, on lost rate and length."""


def benchmark(
    board: Board, folder: Path, stages: Stages = silent_stages, image_format: str = "png"
) -> tuple[Row, ...]:
    """Run a leaderboard and write it; results of an earlier call in the folder are reused.

    What other code left there is discarded, which a warning says.

    Args:
        board: Configuration of the leaderboard.
        folder: Output folder.
        stages: Begins a stage by its name; what it returns is called with the share done.
        image_format: Format of the picture, one of `ambinav.plotting.style.FORMATS`.

    Returns:
        The rows of the table.

    Raises:
        InputError: see `RunFolder.check`, `fitting` and `run`; or another call is at work there.
    """
    STUDY.folder.check(folder)
    board = fitting(board)
    with STUDY.folder.hold(folder):
        discard_stale(folder / WORK, computed_by(), kept=(LOCK,))
        results = run(board, folder / WORK, stages)
        scores = scores_of(results, board.seed)
        rows = rows_of(board, results, scores)
        title = f"Leaderboard, {board.episodes} episodes each"
        drawn = STUDY.draw(folder, {OVERVIEW: lambda: plot_board(rows, title)}, image_format)
        STUDY.write_documents(folder, content(board, scores, rows), drawn)
        STUDY.remove_pictures(folder, drawn.values())
    return rows


def scores_of(
    results: Mapping[str, Mapping[str, Episodes]], seed: int
) -> dict[str, NormalizedScores]:
    """Compute the normalized scores of the settings in which both reference methods took part."""
    return {
        setting: normalized_scores(setting, episodes, episodes[BLIND], episodes[TRUE_POSE], seed)
        for setting, episodes in results.items()
        if {BLIND, TRUE_POSE} <= set(episodes)
    }


def rows_of(
    board: Board,
    results: Mapping[str, Mapping[str, Episodes]],
    scores: Mapping[str, NormalizedScores],
) -> tuple[Row, ...]:
    """Return the table of all settings; returns appear only where rewards match the baseline's."""
    rows = []
    for setting in board.settings:
        parameters = {m.name: board.parameters(setting, m) for m in board.methods}
        reference = parameters.get(BASELINE, next(iter(parameters.values())))
        episodes = agreeing(results[setting.name], parameters, reference)
        score_of = scores[setting.name].scores if setting.name in scores else {}
        rows += [
            replace(row, score=score_of.get(row.method))
            for row in make_rows(setting.name, episodes, BASELINE, board.seed)
        ]
    return tuple(rows)


def document(
    board: Board, scores: Mapping[str, NormalizedScores], rows: Sequence[Row]
) -> dict[str, Any]:
    """Return all figures with intervals and differences, and how they were computed."""
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "ambinav": __version__,
        "episodes": board.episodes,
        "seed": board.seed,
        "options": dict(board.options),
        "layer": NavigationParameters.of(board.options).cost_layer,
        "conditions": board.conditions,
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
                "criterion": criterion_text(row, _base(row, rows)),
                **row.to_plain(),
                "reward": row["return"].value.value if row["return"].value.count else None,
                SCORE: plain(row.score),
            }
            for row in rows
        ],
        "normalized_by": {setting: score.to_plain() for setting, score in scores.items()},
    }


def content(board: Board, scores: Mapping[str, NormalizedScores], rows: Sequence[Row]) -> Content:
    """Return the content of the documents, and the table."""
    filters: dict[str, Callable[..., str]] = {
        "value": value_text,
        "interval": interval_text,
        "difference": partial(difference_text, bold=True),
        "criterion": lambda row: criterion_text(row, _base(row, rows)),
    }
    values: dict[str, Any] = {
        "board": board,
        "rows": rows,
        "settings": list(dict.fromkeys(row.setting for row in rows)),
        "figures": FIGURES,
        "task_figures": TASK_FIGURES,
        "scores": scores,
        "blind": BLIND,
        "true_pose": TRUE_POSE,
        "baseline": BASELINE,
        "conditions": board.conditions,
        "layer": NavigationParameters.of(board.options).cost_layer,
        "differs": {name: differs_text(differences) for name, differences in board.differs.items()},
    }
    files = {"table.csv": to_csv(rows)}
    return Content(document(board, scores, rows), values, filters, files=files)


def criterion_text(row: Row, base: Row | None) -> str:
    """Tell whether a method is lost at most half as often as the baseline, and not much longer.

    Judged by the figures and the interval of their difference, so that it may be unclear.
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
    if not shown:
        return "no difference shown"
    if not CRITERION.lost_met(after, before):
        return "lost less often, not halved"
    ratio = 1.0 + longer.value / base["length"].value.value
    return "met" if CRITERION.length_met(ratio) else "halved, but too long"


def _base(row: Row, rows: Sequence[Row]) -> Row | None:
    return next((r for r in rows if (r.setting, r.method) == (row.setting, BASELINE)), None)
