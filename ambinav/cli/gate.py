"""Gates: conditions that end a command with status 3, and files with their results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer

from ambinav.cli.running import check_file, reporting
from ambinav.reports.conditions import (
    Condition,
    Outcome,
    Quantities,
    Unchecked,
    judge,
    parse_condition,
)
from ambinav.runtime.errors import InputError

HOLDS = 3
"""Exit status where a condition holds."""


AUDIT = "ambinav.studies.audit.figures"
DIFF = "ambinav.studies.diff.figures"
FLEET_DIFF = "ambinav.studies.fleet.difference"
"""Modules whose `QUANTITIES` conditions may name; imported only when they are needed."""


def _quantities(module: str) -> Quantities:
    quantities: Quantities = import_module(module).QUANTITIES
    return quantities


def _fail_if(module: str) -> Any:
    """Return the option --fail-if, which prints a table of all figures of a module for `list`."""

    def listed(texts: list[str] | None) -> list[str] | None:
        if not texts or "list" not in texts:
            return texts
        with reporting():
            quantities = _quantities(module).values()
            width = max(len(quantity.name) for quantity in quantities)
            for quantity in quantities:
                typer.echo(f"{quantity.name:{width}}  {quantity.unit:2}  {quantity.meaning}")
        raise typer.Exit

    return typer.Option("--fail-if", callback=listed, is_eager=True)


@dataclass(frozen=True, kw_only=True)
class Gate:
    """Options common to all gates.

    Attributes:
        junit (FILE): Write JUnit XML, with a test case for each condition. [default: none]
        sarif (FILE): Write SARIF 2.1.0, with a result for each condition that holds. [default:
            none]
    """

    PANEL: ClassVar[str] = "Gate"
    COMMAND: ClassVar[str]
    """Name of the command line."""
    FIGURES: ClassVar[str]
    """Module with what conditions may name."""

    fail_if: list[str] | None = None
    junit: Path | None = None
    sarif: Path | None = None

    def conditions(self, output: Path | None) -> tuple[Condition, ...]:
        """Read the conditions and check the files before the long work.

        Args:
            output: The report's folder, in which other files have no place.

        Raises:
            InputError: a condition cannot be read, or a file cannot be written or has nothing to
                say.
        """
        texts = self.fail_if or []
        parsed = tuple(parse_condition(text, _quantities(self.FIGURES)) for text in texts)
        files = {"--junit": self.junit, "--sarif": self.sarif}
        chosen = {option: path for option, path in files.items() if path is not None}
        for option, path in chosen.items():
            if not parsed:
                raise InputError(
                    f"{option}: {path} needs a condition to report; add --fail-if CONDITION."
                )
            if output is not None and path.resolve().is_relative_to(output.resolve()):
                raise InputError(
                    f"{option}: {path} lies in the report's folder {output}, which is replaced as "
                    "a whole; choose another place."
                )
            check_file(path)
        if len(chosen) == 2 and len({path.resolve() for path in chosen.values()}) == 1:
            raise InputError(f"--sarif: {self.sarif} is also given as --junit; name two files.")
        return parsed

    def judge(
        self,
        conditions: tuple[Condition, ...],
        report: object,
        map_file: str | Path,
        *,
        as_json: bool,
    ) -> None:
        """Check the conditions on a report, and `conclude`.

        Args:
            conditions: Conditions as returned by `conditions`.
            report: Report that their quantities read.
            map_file: The map that it is about.
            as_json: Whether stdout belongs to JSON, so that stderr is spoken to.

        Raises:
            typer.Exit: with status 3: a condition holds.
            InputError: the report lacks a figure, or a file cannot be written.
        """
        outcomes = [judge(condition, report) for condition in conditions]
        self.conclude(outcomes, map_file, as_json=as_json)

    def conclude(
        self,
        outcomes: Sequence[Outcome],
        map_file: str | Path,
        *,
        as_json: bool,
        unchecked: Unchecked = (),
    ) -> None:
        """Write the files of some outcomes, and print them; arguments and errors as of `judge`.

        What is `unchecked` goes into the files only: the caller says it.
        """
        from ambinav.reports.junit import write_junit
        from ambinav.reports.sarif import write_sarif

        if self.junit is not None:
            write_junit(outcomes, f"ambinav {self.COMMAND} {map_file}", self.junit, unchecked)
        if self.sarif is not None:
            write_sarif(outcomes, self.COMMAND, map_file, self.sarif, unchecked)
        for outcome in outcomes:
            typer.echo(f"{'failed' if outcome.holds else 'passed'}: {outcome.text}", err=as_json)
        if any(outcome.holds for outcome in outcomes):
            raise typer.Exit(HOLDS)


@dataclass(frozen=True, kw_only=True)
class AuditGate(Gate):
    """The gate of an audit.

    Attributes:
        fail_if (CONDITION): End with status 3 if this holds, e.g. "open > 2 %" or "longest open
            stretch > 4 m"; repeatable. "list" names all figures. [default: none]
    """

    COMMAND = "audit"
    FIGURES = AUDIT

    fail_if: Annotated[list[str] | None, _fail_if(AUDIT)] = None

    def aliasing(self, conditions: tuple[Condition, ...], is_requested: bool | None) -> bool | None:
        """Return whether to search for perceptual aliasing: a condition may require it.

        Raises:
            InputError: it was refused.
        """
        from ambinav.studies.audit.figures import ALIASING

        about = [condition for condition in conditions if condition.quantity.name in ALIASING]
        if about and is_requested is False:
            raise InputError(
                f'--fail-if: "{about[0]}" is about perceptual aliasing; leave --no-aliasing out.'
            )
        return True if about else is_requested


@dataclass(frozen=True, kw_only=True)
class DiffGate(Gate):
    """The gate of a difference.

    Attributes:
        fail_if (CONDITION): End with status 3 if this holds, e.g. "new open area > 1 m2" or "worse
            area > 5 m2"; repeatable. "list" names all figures. [default: none]
    """

    COMMAND = "diff"
    FIGURES = DIFF

    fail_if: Annotated[list[str] | None, _fail_if(DIFF)] = None


@dataclass(frozen=True, kw_only=True)
class FleetGate(Gate):
    """The gate of a fleet: the figures of an audit, at any site.

    Attributes:
        fail_if (CONDITION): End with status 3 if this holds at any site, e.g. "bad > 5 %";
            repeatable. "list" names all figures. [default: none]
    """

    COMMAND = "fleet audit"
    FIGURES = AUDIT

    fail_if: Annotated[list[str] | None, _fail_if(AUDIT)] = None

    def conditions(self, output: Path | None) -> tuple[Condition, ...]:
        """Read the conditions and check the files; see `Gate.conditions`."""
        from ambinav.studies.audit.figures import ALIASING

        parsed = super().conditions(output)
        for condition in parsed:
            if condition.quantity.name in ALIASING:
                raise InputError(
                    f'--fail-if: "{condition}" is about perceptual aliasing, which is not searched '
                    "for in a fleet; use `ambinav audit`."
                )
        return parsed


@dataclass(frozen=True, kw_only=True)
class FleetDiffGate(Gate):
    """The gate of a difference of fleets.

    Attributes:
        fail_if (CONDITION): End with status 3 if this holds, e.g. "bad change > 1 m2"; repeatable.
            "list" names all figures. [default: none]
    """

    COMMAND = "fleet diff"
    FIGURES = FLEET_DIFF

    fail_if: Annotated[list[str] | None, _fail_if(FLEET_DIFF)] = None
