"""`ambinav dataset`: what planners and policies drive, as Minari data sets."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from ambinav.cli import options
from ambinav.cli.evaluate import arguments_of
from ambinav.cli.limits import Count, Natural
from ambinav.cli.running import check_writable, progress_bars, reporting
from ambinav.runtime.packages import ENVIRONMENTS, need


@options.documented
def dataset(
    values: Annotated[list[str] | None, typer.Argument()] = None,
    output: Annotated[Path, typer.Option("--output", "-o")] = Path("datasets"),
    environment: Annotated[str, typer.Option("--env")] = "ambinav/Hall-v1",
    policy: list[str] | None = None,
    planner: list[str] | None = None,
    episodes: Annotated[Count, typer.Option("--episodes", "-n")] = 10,
    seed: Natural = 0,
    author: str | None = None,
    trust: options.Trust = False,
    as_json: options.AsJson = False,
) -> None:
    """Record episodes as Minari data sets, one for each planner and policy.

    Needs the extra `minari`. Recorded episodes can be replayed: the data set holds the
    environment and the seed of each episode. Beside it lies its card, a README.md as the Hugging
    Face Hub reads it.

    Example: `ambinav dataset -o out/datasets --env ambinav/Office-v1 --policy vfh`

    Parameters:
        values ([KEY=VALUE]...): Arguments of the environment, e.g. localizer=mcl.
        output (DIR): Folder for the data sets; set MINARI_DATASETS_PATH to it to read them.
        environment (ID): Id of the environment.
        policy (FILE|NAME|module:callable): A policy; repeatable. [default: the reactive baselines,
            unless --planner is given]
        planner (NAME[:WEIGHT]): A planner whose routes are followed; repeatable. [default:
            reference:5, unless there is --policy]
        episodes (N): Episodes of each policy and planner.
        seed (N): Seed of the episodes, 0 or more.
        author (NAME): Author, for metadata and card.
    """
    with reporting():
        arguments = arguments_of(values or [])
        check_writable(output)
        need("a data set", ENVIRONMENTS)
        need("a data set", ("minari", "h5py"), extra="minari")
        from ambinav_envs.leaderboard.dataset import record_datasets
        from ambinav_envs.leaderboard.methods import planner_methods, policy_method
        from ambinav_envs.policies.reactive.policy import REACTIVE

        if not policy and not planner:
            policy, planner = list(REACTIVE), ["reference:5"]
        methods = [
            *([] if not planner else planner_methods(planner)),
            *(policy_method(name, trust=trust) for name in dict.fromkeys(policy or [])),
        ]
        with progress_bars(as_json) as bars:
            made = record_datasets(
                methods, environment, arguments, episodes, seed, output, bars("episodes"), author
            )
        if as_json:
            typer.echo(json.dumps([asdict(data_set) for data_set in made]))
        else:
            for data_set in made:
                typer.echo(
                    f"{data_set.id}: {data_set.episodes} episodes, {data_set.steps:,} steps, "
                    f"{data_set.arrived} arrived"
                )
            typer.echo(f"read them with: MINARI_DATASETS_PATH={output}")
