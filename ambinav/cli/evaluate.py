"""`ambinav evaluate`: the performance of a policy over episodes with fixed seeds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambinav.cli import options
from ambinav.cli.limits import Count, Natural
from ambinav.cli.map_options import BuildingOptions, check_with_map
from ambinav.cli.printing import show, table
from ambinav.cli.running import check_writable, progress_bars, reporting
from ambinav.cli.space_options import HeightOptions
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import ENVIRONMENTS, need

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ambinav_envs.leaderboard.evaluated import Evaluation
    from ambinav_envs.leaderboard.twin_runs import TwinRuns

TWIN_SHOWN = ("arrived", "spl", "return")
"""Figures with the true pose on the terminal, each with its difference to those by the estimate."""


@options.documented
def evaluate(
    policy: Annotated[str, typer.Argument()],
    building: BuildingOptions,
    space: HeightOptions,
    values: Annotated[list[str] | None, typer.Argument()] = None,
    task: str | None = None,
    suite: str | None = None,
    map_file: Annotated[Path | None, typer.Option("--map")] = None,
    episodes: Annotated[Count, typer.Option("--episodes", "-n")] = 200,
    seed: Natural = 0,
    output: Annotated[Path | None, typer.Option("--output", "-o")] = None,
    twins: Annotated[bool, typer.Option("--twins/--no-twins")] = True,
    trained_in: Annotated[str | None, typer.Option("--env")] = None,
    trust: options.Trust = False,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Evaluate a policy: report how often it arrives, gets lost, and collides.

    The environment is that of the policy's training, with buildings that it has not seen (numbers
    from 1 000 000 of the suite). With another scanner or robot the policy is refused, unless
    --force is given. A policy file is data: no code in it is run. module:callable and files written
    by model.save of Stable-Baselines3 are code and need --trust; the latter also need --env ID.

    Example: `ambinav evaluate run/best.zip --episodes 500 people=3 odometry_scale=2`

    Parameters:
        policy (POLICY): A policy file, the name of a reactive baseline, or module:callable.
        values ([KEY=VALUE]...): Arguments of the environment, e.g. people=3 odometry_scale=2.
            [default: as in training]
        task (ID): Gymnasium id to drive in. [default: as in training]
        suite (NAME): Buildings to draw from. [default: as in training]
        map_file (FILE): One building, instead of a suite.
        episodes (N): Number of episodes.
        seed (N): Seed of the episodes, 0 or more.
        output (DIR): Folder for evaluation.json and episodes.csv.
        twins: Also evaluate the policy with the true pose, and shortest routes that are followed
            blindly, for the normalized score; this takes several times as long.
        trained_in (ID): For a file of model.save: the environment of its training; KEY=VALUE its
            arguments.
    """
    with reporting():
        if suite is not None and map_file is not None:
            raise InputError("--suite and --map are both given; give one of the two.")
        check_with_map(map_file, building, space)
        space.check()
        changed = arguments_of(values or [])
        if output is not None:
            check_writable(output / "evaluation.json")
        # Missing companions of a policy's file are reported when it is loaded.
        need("evaluating", ENVIRONMENTS)
        from ambinav_envs.leaderboard.evaluated import evaluate_policy, write_evaluation

        if suite is not None:
            changed["suite"] = suite
        if map_file is not None:
            changed["map"] = map_file
            if (building, space) != (BuildingOptions(), HeightOptions()):
                changed["map"] = space.load(map_file, None, **building.reading())
        with progress_bars(as_json) as bars:
            result = evaluate_policy(
                policy,
                changed,
                episodes,
                seed,
                bars("episodes"),
                force=force,
                twins=twins,
                trust=trust,
                trained_in=trained_in,
                task=task,
            )
        if output is not None:
            write_evaluation(result, output)
        if as_json:
            typer.echo(result.to_json())
        else:
            _show(result, output)


def arguments_of(values: list[str]) -> dict[str, Any]:
    """Parse arguments of an environment from KEY=VALUE, each value as YAML.

    Raises:
        InputError: an argument cannot be parsed, or is given twice.
    """
    import yaml

    arguments: dict[str, Any] = {}
    for text in values:
        key, equals, value = text.partition("=")
        if not (equals and key.isidentifier()):
            raise InputError(f"{text!r} is not an argument; write KEY=VALUE, e.g. people=3.")
        if key in arguments:
            raise InputError(f"{key} is given twice; give it once.")
        try:
            arguments[key] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise InputError(f"{key}: {value!r} cannot be read; write it as in YAML.") from error
    return arguments


def _show(result: Evaluation, output: Path | None) -> None:
    columns = "figure", "value"
    show(table(columns, _texts(result), left=columns, show_header=False))
    if output is not None:
        show(f"written to {output}", wrap=False)


def _texts(result: Evaluation) -> Iterator[tuple[str, str]]:
    """Yield lines about the policy: what drove, and its figures."""
    from ambinav.reports.table import value_text

    row = result.row
    yield row.method, f"{row.episodes} episodes in {row.setting}"
    if result.code:
        yield "code", "run with your rights, since it is trusted (--trust)"
    for name, texts in result.differs.items():
        yield f"not the {name} it was trained with", "; ".join(texts)
    for cell in row.cells:
        unit = f" ({cell.figure.unit})" if cell.figure.unit else ""
        yield f"{cell.figure.title}{unit}", value_text(cell)
    if result.twins is not None:
        yield from _twin_texts(result.twins)


def _twin_texts(twin_runs: TwinRuns) -> Iterator[tuple[str, str]]:
    """Yield lines about the policy's references: what each is, and its figure."""
    from ambinav.reports.table import difference_text, interval_text, value_text
    from ambinav_envs.leaderboard.twin_runs import OWN

    scores = twin_runs.scores
    shown = scores.room.low > 0.0
    yield (
        "normalized score",
        interval_text(scores.scores[OWN], 2) if shown else "- (no room is shown)",
    )
    yield "blind, shortest route: arrived (%)", interval_text(scores.blind, 1)
    yield "blind, by the true pose: arrived (%)", interval_text(scores.true_pose, 1)
    yield "room between the two (points)", interval_text(scores.room, 1, "+")
    for cell in (twin_runs.twin[key] for key in TWIN_SHOWN):
        unit = f" ({cell.figure.unit})" if cell.figure.unit else ""
        yield (
            f"with the true pose: {cell.figure.title}{unit}",
            f"{value_text(cell)}; {difference_text(cell)}",
        )
