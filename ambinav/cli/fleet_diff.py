"""`ambinav fleet diff`: what changed between two audits of a fleet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.gate import FleetDiffGate
from ambinav.cli.printing import finish, show, table
from ambinav.cli.running import reporting

if TYPE_CHECKING:
    from ambinav.studies.fleet.difference import FleetDifference

_OUTPUT = "An output of `ambinav fleet audit`: a folder or a URL."


@options.documented
def diff_fleets(
    first: Annotated[str, typer.Argument(metavar="A", help=_OUTPUT, show_default=False)],
    second: Annotated[str, typer.Argument(metavar="B", help=_OUTPUT, show_default=False)],
    *,
    gate: FleetDiffGate,
    as_json: options.AsJson = False,
) -> None:
    """List the sites that became worse or better, appeared, vanished or failed from A to B.

    Example: `ambinav fleet diff may june --fail-if "bad change > 1 m2"`
    """
    with reporting():
        from ambinav.studies.fleet.difference import fleet_difference, open_fleet

        conditions = gate.conditions(None)
        report = fleet_difference(open_fleet(first), open_fleet(second), (first, second))
        finish(report, _show, as_json=as_json)
        gate.judge(conditions, report, second, as_json=as_json)


def _show(report: FleetDifference) -> None:
    show(report.summary)
    rows = (
        (each.site, each.scanner, each.change, _area(each.before_m2), _area(each.after_m2),
         _area(each.change_m2, "+"), each.advice or "")
        for each in report.changes
    )  # fmt: skip
    columns = "site", "scanner", "change", "A", "B", "increase", "needs"
    if report.changes:
        left = "site", "scanner", "change", "needs"
        show("", table(columns, rows, left=left, fold=True))


def _area(value: float | None, sign: str = "") -> str:
    return "" if value is None else f"{value:{sign},.1f} m²"
