"""The largest rise of bad floor counts what has not changed."""

from __future__ import annotations

from ambinav.studies.fleet.difference import QUANTITIES, FleetDifference, SiteChange


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
