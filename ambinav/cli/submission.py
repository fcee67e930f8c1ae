"""`ambinav benchmark --submit` and `--rerun`: the frozen benchmark."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import typer

from ambinav.cli.checks import check_suffix, conflict
from ambinav.cli.gate import HOLDS
from ambinav.cli.printing import show, table
from ambinav.cli.running import check_file, progress_bars
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import ENVIRONMENTS, need

WIDTH = 110
"""Columns of text where there is no terminal."""
ENDS = ("arrived", "missed", "collided", "timeout")


@dataclass(frozen=True, kw_only=True)
class SubmissionOptions:
    """Options on submissions to the frozen benchmark.

    Attributes:
        submit (FILE.json): Drive the frozen benchmark with --policy, and write the submission.
            [default: none]
        rerun (FILE.json): Drive a submission again, and compare. [default: none]
        recorded (DIR): Also drive in the benchmark's recorded maps, which are in this folder.
            [default: without]
        secret (FILE): File of a maintainer with the hidden seed. [default: public seed]
    """

    PANEL: ClassVar[str] = "Frozen benchmark"

    submit: Path | None = None
    rerun: Path | None = None
    recorded: Path | None = None
    secret: Path | None = None

    def is_given(self, alone: bool) -> bool:
        """Return whether the frozen benchmark is driven and not the leaderboard.

        Args:
            alone: Whether no option is given that would change its episodes.

        Raises:
            InputError: an option has no effect, or would change them.
        """
        chosen = [name for name in ("submit", "rerun") if getattr(self, name) is not None]
        if not chosen:
            for name in ("recorded", "secret"):
                conflict(f"--{name}", getattr(self, name) is not None, "is for --submit, --rerun")
        elif len(chosen) > 1:
            raise InputError("--submit and --rerun are both given; give one of the two.")
        elif not alone:
            raise InputError(
                f"--{chosen[0]}: the episodes of the benchmark are fixed; give only --policy, "
                "--trust, --recorded, --secret, --quick and --json with it."
            )
        return bool(chosen)

    def run(self, policies: Sequence[str], trust: bool, quick: bool, as_json: bool) -> None:
        """Write a submission, or drive one again.

        Raises:
            InputError: see `ambinav_envs.leaderboard.submission`.
            typer.Exit: with status 3: an episode or a score differs.
        """
        need("the benchmark", ENVIRONMENTS)
        from ambinav.runtime.files import write_text
        from ambinav_envs.leaderboard.frozen import FrozenBenchmark
        from ambinav_envs.leaderboard.submission import entries_for, make_record, verify

        frozen = FrozenBenchmark.read()
        difference = None
        if self.submit is not None:
            check_suffix(self.submit, "--submit", (".json",))
            check_file(self.submit)
            entries = entries_for(frozen, policies, trust)
            with progress_bars(as_json) as bars:
                record = make_record(frozen, entries, bars, self.secret, self.recorded, quick)
            write_text(self.submit, json.dumps(record) + "\n")
        else:
            assert self.rerun is not None
            conflict("--quick", quick, "cannot verify a submission")
            with progress_bars(as_json) as bars:
                record, difference = verify(
                    self.rerun, frozen, bars, policies, trust, self.secret, self.recorded
                )
        shown = {part: record[part] for part in ("drawn", "recorded") if part in record}
        if as_json:
            plain = {part: {**scores, "episodes": None} for part, scores in shown.items()}
            typer.echo(json.dumps({**plain, "difference": difference}, indent=2))
        else:
            for part, scores in shown.items():
                columns = ("task", "score", *(f"{end} (%)" for end in ENDS))
                figures = table(
                    columns, _rows(scores), left=columns[:1], no_wrap=columns, title=part
                )
                show(figures, "", width=WIDTH)
            verdict = f"differs: {difference}" if difference else "episodes and scores agree"
            show(verdict if self.rerun else f"written to {self.submit}", wrap=False)
        if difference is not None:
            raise typer.Exit(HOLDS)


def _rows(part: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield a line for each task and one for all."""
    for name, figures in {**part["tasks"], "all": part["score"]}.items():
        score = f"{figures['value']:.3f} ({figures['low']:.3f} to {figures['high']:.3f})"
        yield (
            name,
            score,
            *(f"{100 * figures[e] / figures['count']:.1f}" if e in figures else "" for e in ENDS),
        )
