"""The largest rise of bad floor counts what has not changed."""

from __future__ import annotations

from typing import Literal

from ambinav.studies.fleet.difference import QUANTITIES, FleetDifference, SiteChange
from ambinav.studies.fleet.difference import _change as change_of
from ambinav.studies.fleet.document import FleetFigures


def test_an_unchanged_site_is_a_rise_of_zero() -> None:
    better = SiteChange(
        site="a", scanner="s", change="better", before_m2=9.0, after_m2=4.0, change_m2=-5.0,
        advice=None,
    )  # fmt: skip
    for compared, rise in ((1, -5.0), (2, 0.0)):
        report = FleetDifference(
            summary="", before="A", after="B", same=3, compared=compared, changes=(better,)
        )
        assert QUANTITIES["bad change"].read(report) == rise


def test_what_is_no_longer_judged_is_no_fall_of_bad_floor() -> None:
    def row(site: str, bad: float | None, status: Literal["done", "failed"] = "done"):
        return FleetFigures(
            site=site, scanner="s", building=site, status=status, error="", digest="", bad_m2=bad,
            bad_share=None if bad is None else 0.5,
        )  # fmt: skip

    for kind, after in (("not judged", row("a", None)), ("failed", row("a", None, "failed"))):
        change = change_of(("a", "s"), row("a", 9.0), after)
        assert change is not None
        assert (change.change, change.before_m2, change.after_m2) == (kind, 9.0, None)
        better = change_of(("b", "s"), row("b", 4.0), row("b", 1.0))
        report = FleetDifference(
            summary="", before="A", after="B", same=0, compared=1, changes=(change, better)
        )
        for name in ("bad change", "total bad change"):
            assert QUANTITIES[name].read(report) is None
        assert QUANTITIES[kind].read(report) == 1.0
