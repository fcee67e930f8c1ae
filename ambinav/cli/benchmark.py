"""`ambinav benchmark`: the leaderboard of planners and policies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.evaluate import arguments_of
from ambinav.cli.limits import Natural, at_least
from ambinav.cli.map_options import BuildingOptions, check_with_map
from ambinav.cli.printing import show, table
from ambinav.cli.running import check_report, progress_bars, reporting, resumable
from ambinav.cli.submission import SubmissionOptions
from ambinav.runtime.packages import ENVIRONMENTS, need

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ambinav_envs.leaderboard.board import Board
    from ambinav_envs.leaderboard.figures import Row

EPISODES, BUILDINGS = 300, 100
QUICK_EPISODES, QUICK_BUILDINGS = 30, 10
SHOWN = {
    "arrived": "arrived (%)",
    "collided": "collided (%)",
    "lost": "lost (%)",
    "error": "error (m)",
    "length": "length ratio",
    "exposure": "exposure per m",
}
"""Figures on the terminal, with their intervals."""
OUTPUT = Path("leaderboard")
WIDTH = 150
"""Columns of text where there is no terminal."""


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """Options on the planners and policies that drive.

    Attributes:
        policy (FILE|NAME|module:callable): A policy in addition to the baselines; repeatable. Of
            a submission: the policy, or TASK=POLICY for one task.
        planner (NAME[:WEIGHT]): A planner instead of the default ones; repeatable.
    """

    PANEL: ClassVar[str] = "Methods"

    policy: list[str] | None = None
    planner: list[str] | None = None
    force: options.Force = False
    trust: options.Trust = False


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """Options on the episodes and their number.

    Attributes:
        episodes (N): Episodes of each method in each setting.
        seed (N): Seed of the episodes, 0 or more.
        suite (NAME): A suite: buildings, conditions and methods; repeatable. [default: standard:
            procedural and hall]
        task (ID): Gymnasium id of a task instead; repeatable.
        map_file (FILE): A building in addition to those of the suites; repeatable.
    """

    PANEL: ClassVar[str] = "Episodes"

    episodes: Annotated[
        int | None, at_least(1), typer.Option("--episodes", "-n", show_default=f"{EPISODES}")
    ] = None
    seed: Natural = 0
    suite: list[str] | None = None
    task: list[str] | None = None
    map_file: Annotated[list[Path] | None, typer.Option("--map")] = None
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help=f"{QUICK_EPISODES} episodes in {QUICK_BUILDINGS} buildings, to try it; with "
            "--submit one in each of 3.",
        ),
    ] = False


@options.documented
def benchmark(
    methods: MethodOptions,
    episode_options: EpisodeOptions,
    building: BuildingOptions,
    submission: SubmissionOptions,
    values: Annotated[list[str] | None, typer.Argument()] = None,
    output: Annotated[Path, typer.Option("--output", "-o")] = OUTPUT,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Evaluate all planners and policies on the same episodes, in one table.

    Writes report.md, report.json, table.csv and a picture. docs/leaderboard.md explains them. A
    policy that was trained with another scanner or robot is refused, unless --force is given.
    Policy files are data: no code in them is run. module:callable is code and needs --trust.

    With --submit a policy drives the frozen benchmark instead: fixed tasks, buildings and seeds,
    and one score. --rerun does this again, and ends with status 3 if anything differs.

    Example: `ambinav benchmark -o out/board --policy run/best.zip`

    Parameters:
        values ([KEY=VALUE]...): Arguments of the environment, common to all methods, e.g.
            localizer=mcl.
        output (DIR): Folder for the report; resumes an interrupted leaderboard in it.
    """
    with reporting():
        unchanged = MethodOptions(policy=methods.policy, trust=methods.trust)
        if submission.is_given(
            methods == unchanged
            and (episode_options, building)
            == (EpisodeOptions(quick=episode_options.quick), BuildingOptions())
            and (values, output, pictures) == (None, OUTPUT, "png")
        ):
            submission.run(methods.policy or [], methods.trust, episode_options.quick, as_json)
            return
        check_with_map(episode_options.map_file, building)
        common = arguments_of(values or [])
        # Missing companions of a policy's file are reported when it is loaded.
        need("the leaderboard", ENVIRONMENTS)
        from ambinav.runtime.runfolder import WORK
        from ambinav_envs.leaderboard.report import STUDY
        from ambinav_envs.leaderboard.report import benchmark as run

        check_report(STUDY, output, pictures)
        board = _board(methods, episode_options, building, common)
        with resumable(output / WORK, "what is finished is"), progress_bars(as_json) as bars:
            rows = run(board, output, bars, pictures)
        if as_json:
            typer.echo((output / STUDY.json).read_text(encoding="utf-8").rstrip())
        else:
            _show(rows, output / STUDY.markdown)


def _board(
    methods: MethodOptions,
    episode_options: EpisodeOptions,
    building: BuildingOptions,
    common: dict[str, Any],
) -> Board:
    """Create the leaderboard of the selected methods and venues."""
    from ambinav_envs.leaderboard.board import Board, chosen_suites, settings_for
    from ambinav_envs.leaderboard.methods import all_methods

    count, buildings = (
        (QUICK_EPISODES, QUICK_BUILDINGS) if episode_options.quick else (EPISODES, BUILDINGS)
    )
    suites, tasks = episode_options.suite or [], episode_options.task or []
    chosen = chosen_suites(suites, tasks)
    names = [name for entry in chosen for name in entry.planners]
    policies = [*(methods.policy or []), *(p for entry in chosen for p in entry.policies or ())]
    shipped = not chosen or any(entry.policies is None for entry in chosen)
    return Board(
        all_methods(methods.planner or names, policies, trust=methods.trust, shipped=shipped),
        settings_for(
            episode_options.map_file or [], buildings, suites, tasks, **building.reading()
        ),
        episode_options.episodes or count,
        episode_options.seed,
        common,
        methods.force,
    )


def _show(rows: Sequence[Row], report: Path) -> None:
    from ambinav.reports.table import interval_text, value_text

    def cells(row: Row) -> Iterator[str]:
        yield row.method
        yield from (value_text(row[key], brief=True) for key in SHOWN)
        yield "-" if row.score is None else interval_text(row.score, 2)

    columns, method = ("method", *SHOWN.values(), "normalized"), ("method",)
    for setting in dict.fromkeys(row.setting for row in rows):
        setting_rows = map(cells, (row for row in rows if row.setting == setting))
        figures = table(columns, setting_rows, left=method, no_wrap=method, title=setting)
        show(figures, "", width=WIDTH)
    show(f"report: {report}", width=WIDTH, wrap=False)
