"""The report of a training, a page of Markdown."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from ambinav_envs.training import folder as files
from ambinav_envs.training.config import Training
from ambinav_envs.training.curve import duration_text

SHOWN = {
    "arrived": ("arrived", 100.0, "{:.1f} %"),
    "collided": ("touched something", 100.0, "{:.1f} %"),
    "timeout": ("out of time", 100.0, "{:.1f} %"),
    "missed": ("stopped elsewhere", 100.0, "{:.1f} %"),
    "lost": ("ever lost", 100.0, "{:.1f} %"),
    "length": ("path by shortest path, of those that arrived", 1.0, "{:.3f}"),
    "exposure": ("ambiguity per metre", 1.0, "{:.3f}"),
    "reward": ("sum of rewards", 1.0, "{:.2f}"),
}
"""Name, factor and form of each figure."""


def report_text(config: Training, record: Mapping[str, Any], summary: Mapping[str, Any]) -> str:
    """Return the report: the training, its results, and the files.

    Args:
        config: Configuration of the training.
        record: Output of `folder.about`.
        summary: Result of `train`.
    """
    environment = config.environment
    arguments = ", ".join(f"{key} {value}" for key, value in environment.items() if key != "id")
    judged = record["judged_in"]
    count = "any" if judged["count"] is None else judged["count"]
    sessions = len(record["sessions"])
    began = "one go" if sessions == 1 else f"{sessions} goes"
    lines = [
        f"# {config.algorithm} in {environment['id']}",
        "",
        f"{summary['steps']:,} steps in {duration_text(summary['seconds'])}, in {began}, with "
        f"{config.envs} environments and {config.threads} threads, seed {config.seed}. "
        f"Arguments: {arguments or 'none'}.",
        "",
        "![The curve](curve.png)",
        "",
        f"Judged on {config.evaluation.episodes} episodes in buildings of {judged['name']} from "
        f"number {judged['first']} on ({count} of them), always the same ones, the policy "
        "deterministic:",
        "",
        f"| | last policy, `{files.FINAL}` | best by reward, `{files.BEST}` |",
        "|---|---:|---:|",
    ]
    for key, (name, factor, form) in SHOWN.items():
        cells = (_cell(summary[which], key, factor, form) for which in ("final", "best"))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    best = summary["best"]["steps"]
    lines += [
        "",
        f"The best one is of step {best:,.0f}; it was chosen by these very episodes, so that its "
        "figures are better than it is: judge it with `ambinav evaluate` on others.",
    ]
    reached = summary["stage"]
    if config.curriculum:
        lines += ["", f"{reached} of {len(config.curriculum)} stages of the curriculum were left."]
    if config.curriculum and reached < len(config.curriculum):
        longest = config.curriculum[reached].longest
        lines += ["", f"It has never trained on paths longer than {longest:g} m."]
    words = record["sessions"][-1]["command"]
    command = shlex.join(word for word in words if word != "--resume")
    lines += ["", f"Again, with another folder: `{command}`" if command else ""]
    return "\n".join(lines).rstrip() + "\n"


def _cell(figures: Mapping[str, Any], key: str, factor: float, form: str) -> str:
    value = figures.get(key)
    return "-" if value is None else form.format(factor * value)
