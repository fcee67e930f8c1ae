"""Mixes of scanners against all assignments of scanners to sites."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambinav.studies.fleet.document import FleetFigures
from ambinav.studies.fleet.mix import KINDS, best_mixes


def row(site: str, scanner: str, bad: float | None) -> FleetFigures:
    share = None if bad is None else bad / 100.0
    status = "failed" if bad is None else "done"
    return FleetFigures(
        site=site, scanner=scanner, building="b", status=status, error="", bad_m2=bad,
        bad_share=share, digest="",
    )  # fmt: skip


@pytest.mark.slow
@given(sites=st.integers(1, 5), scanners=st.integers(2, 4), seed=st.integers(0, 1000))
def test_no_assignment_of_as_many_scanners_leaves_less(
    sites: int, scanners: int, seed: int
) -> None:
    bad = np.random.default_rng(seed).integers(0, 30, (sites, scanners)).astype(float)
    rows = [
        row(f"site {i}", f"scanner {k}", bad[i, k]) for i in range(sites) for k in range(scanners)
    ]
    mixes = best_mixes(rows)
    assert [len(mix.scanners) for mix in mixes] == [*range(1, len(mixes) + 1)]
    for count in range(1, min(KINDS, scanners) + 1):
        least = min(
            sum(bad[i, k] for i, k in enumerate(given))
            for given in itertools.product(range(scanners), repeat=sites)
            if len(set(given)) <= count
        )
        # Where one more does not help, there is no larger mix.
        assert mixes[min(count, len(mixes)) - 1].bad_m2 == pytest.approx(least)
    for mix in mixes:
        served = {site: name for name, own in mix.scanners.items() for site in own}
        assert len(served) == sites
        assert mix.worst_share == pytest.approx(
            max(bad[int(site[5:]), int(name[8:])] for site, name in served.items()) / 100.0
        )


def test_a_scanner_that_fails_at_a_site_does_not_serve_it() -> None:
    rows = [row("a", "x", 5.0), row("a", "y", 3.0), row("b", "x", 1.0), row("b", "y", None)]
    alone, both = best_mixes(rows)
    assert (alone.scanners, alone.bad_m2) == ({"x": ("a", "b")}, 6.0)
    assert (both.scanners, both.bad_m2) == ({"x": ("b",), "y": ("a",)}, 4.0)
    (only,) = best_mixes(rows[2:])
    assert (only.scanners, only.bad_m2) == ({"x": ("b",)}, 1.0)
    # No scanner serves both.
    apart = [row("a", "x", 5.0), row("a", "y", None), row("b", "x", None), row("b", "y", 2.0)]
    (pair,) = best_mixes(apart)
    assert (pair.scanners, pair.bad_m2) == ({"x": ("a",), "y": ("b",)}, 7.0)


def test_sites_with_a_scanner_of_their_own_do_not_count() -> None:
    rows = [row("a", "x", 5.0), row("a", "y", 3.0), row("own", "z", 9.0), row("none", "x", None)]
    (mix,) = best_mixes(rows)
    assert (mix.scanners, mix.bad_m2) == ({"y": ("a",)}, 3.0)
    assert best_mixes(rows[::2]) == best_mixes(rows[2:]) == ()
