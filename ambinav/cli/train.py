"""`ambinav train`: train a policy from a configuration into a run folder."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambinav.cli import options
from ambinav.cli.limits import above_zero, at_least
from ambinav.cli.running import INTERRUPTED, check_writable, reporting, say
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import TRAINED, need

if TYPE_CHECKING:
    from ambinav_envs.training.run import StatusCallback, TrainingStatus


@options.documented
def train(
    config_file: Annotated[Path, typer.Argument()],
    output: Annotated[Path, typer.Option("--output", "-o")],
    resume: bool = False,
    seed: Annotated[int | None, at_least(0)] = None,
    minutes: Annotated[float | None, above_zero("30", "minutes")] = None,
    steps: Annotated[int | None, above_zero("1000000", "steps")] = None,
    task: str | None = None,
    as_json: options.AsJson = False,
) -> None:
    """Train a policy that navigates with a localizer in the loop.

    Writes policy files (best.zip, final.zip), the learning curve, checkpoints, TensorBoard files if
    it is installed, and all that is needed to repeat the run. After Ctrl-C, `--resume` continues.

    Example: `ambinav train configs/ppo.yaml -o out/ppo`

    Parameters:
        config_file (CONFIG.yaml): Algorithm, environment, network and duration; see configs and
            docs/training.md.
        output (DIR): Folder for all files of the run.
        resume: Resume from the latest checkpoint in DIR.
        seed (N): Seed. [default: that of the configuration]
        minutes (M): Training time, instead of the configuration's limits.
        steps (N): Training steps, instead of the configuration's limits.
        task (ID): Gymnasium id of the environment. [default: the configuration's]
    """
    with reporting():
        if minutes is not None and steps is not None:
            raise InputError("--minutes and --steps are given; give one of the two.")
        need("training", TRAINED)
        from ambinav_envs.training.config_file import load_training_config
        from ambinav_envs.training.folder import CHECKPOINTS
        from ambinav_envs.training.train import check_folder
        from ambinav_envs.training.train import train as run

        limits: dict[str, Any] = {}
        if minutes is not None or steps is not None:
            limits = {"minutes": minutes, "steps": steps}
        config = load_training_config(config_file, limits=limits, seed=seed, task=task)
        check_writable(output)
        check_folder(config, output, resume)
        try:
            with _showing_progress(as_json) as callback:
                command = ("ambinav", *sys.argv[1:])
                summary = run(config, output, resume=resume, command=command, callback=callback)
        except (KeyboardInterrupt, SystemExit) as stop:
            saved_in = output / CHECKPOINTS
            say(
                f"ambinav: interrupted; the training so far is in {saved_in}, and the same command "
                "with --resume continues from there."
                if saved_in.is_dir()
                else "ambinav: interrupted before the first round was done; nothing was saved."
            )
            if isinstance(stop, SystemExit):
                # Terminated, with a status of its own.
                raise
            raise typer.Exit(INTERRUPTED) from None
        if as_json:
            typer.echo(json.dumps(summary, allow_nan=False))
        else:
            _result(output, summary)


@contextlib.contextmanager
def _showing_progress(quiet: bool) -> Iterator[StatusCallback]:
    """Yield a callback that shows the training progress: a bar, and a line for each evaluation."""
    if quiet:
        yield lambda status: None
        return
    if not sys.stderr.isatty():
        yield lambda status: _evaluation_line(status, say)
        return
    from rich import progress
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
    )
    with progress.Progress(*columns, console=console) as bars:
        task = bars.add_task("training", total=1.0)
        last = 0.0

        def show(status: TrainingStatus) -> None:
            nonlocal last
            if status.share < last:
                # The maps are built; the training time starts now.
                bars.reset(task)
            last = status.share
            bars.update(task, completed=status.share, description=_status_text(status))
            _evaluation_line(status, lambda text: console.print(text, soft_wrap=True))

        yield show


def _status_text(status: TrainingStatus) -> str:
    """Describe progress, speed and success of the training in a few words."""
    if status.preparing:
        return "maps of the buildings"
    words = [f"{status.steps:,} steps"]
    if status.rate == status.rate:
        words.append(f"{status.rate:,.0f}/s")
    if status.train is not None and status.train["episodes"]:
        words.append(f"arrived {100.0 * status.train['arrived']:.0f} %")
    return ", ".join(words)


def _evaluation_line(status: TrainingStatus, say: Callable[[str], None]) -> None:
    """Print a line for an evaluation, if there is one."""
    figures = status.evaluation
    if figures is not None:
        shares = ("arrived", "collided", "timeout", "missed", "lost")
        outcomes = ", ".join(f"{name} {100.0 * figures[name]:.1f} %" for name in shares)
        say(f"{status.steps:,} steps: {outcomes}, reward {figures['reward']:.2f}")


def _result(output: Path, summary: dict[str, Any]) -> None:
    final, best = summary["final"], summary["best"]
    minutes = summary["seconds"] / 60.0
    typer.echo(
        f"{summary['steps']:,} steps in {minutes:.1f} minutes: of {final['episodes']:.0f} episodes "
        f"that judge it {100.0 * final['arrived']:.1f} % arrived; at the best evaluation, "
        f"after {best['steps']:,.0f} steps, {100.0 * best['arrived']:.1f} %."
    )
    typer.echo(f"policy: {output / 'final.zip'}\nreport: {output / 'report.md'}")
