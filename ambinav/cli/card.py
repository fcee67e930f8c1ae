"""`ambinav card`: a policy and its evaluation as a folder for a model hub."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ambinav.cli import options
from ambinav.cli.running import check_writable, reporting
from ambinav.runtime.packages import ENVIRONMENTS, need


@options.documented
def card(
    policy: Annotated[Path, typer.Argument()],
    evaluation: Annotated[Path, typer.Argument()],
    output: Annotated[Path, typer.Option("--output", "-o")],
    as_json: options.AsJson = False,
) -> None:
    """Write a model card as model hubs read it, from a policy's own card and its evaluation.

    README.md begins with the YAML of the Hugging Face Hub in the form of Stable-Baselines3's tools.
    Nothing is uploaded.

    Example: `ambinav card run/best.zip out/evaluation -o out/hub`

    Parameters:
        policy (POLICY): A policy file.
        evaluation (EVALUATION): Folder written by `ambinav evaluate POLICY -o`.
        output (DIR): Folder for README.md, results.json and the policy.
    """
    with reporting():
        check_writable(output / "README.md")
        need("a model card", ENVIRONMENTS)
        from ambinav_envs.leaderboard.model_card import write_model_card

        readme = write_model_card(policy, evaluation, output)
        if as_json:
            typer.echo(json.dumps({"readme": str(readme)}))
        else:
            typer.echo(f"written to {output}")
