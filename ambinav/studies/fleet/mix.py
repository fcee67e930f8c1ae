"""The few kinds of scanners that serve all sites best, each site with the best of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final

import numpy as np

from ambinav.studies.fleet.document import FleetFigures, MixPart

KINDS: Final = 3
"""Most kinds of scanners in a mix."""


def best_mixes(rows: Sequence[FleetFigures]) -> tuple[MixPart, ...]:
    """Return the best mix of one scanner, of two, and so on up to `KINDS` while one more helps.

    The best one leaves the least bad floor on all sites together, of equal ones the least share of
    the worst site. All sets are compared. Only sites with figures for every scanner count.

    Args:
        rows: Figures of the sites.

    Returns:
        Empty if there is only one scanner, or no site with figures for all of them.
    """
    names = sorted({row.scanner for row in rows})
    figures = {(row.site, row.scanner): row for row in rows if row.bad_m2 is not None}
    sites = [
        site
        for site in dict.fromkeys(row.site for row in rows)
        if all((site, name) in figures for name in names)
    ]
    if len(names) < 2 or not sites:
        return ()
    bad, share = (
        np.array([[getattr(figures[site, name], key) for name in names] for site in sites])
        for key in ("bad_m2", "bad_share")
    )
    mixes, before = list[MixPart](), np.inf
    for size in range(1, min(KINDS, len(names)) + 1):
        ranked = []
        for chosen in itertools.combinations(range(len(names)), size):
            best = np.array(chosen)[bad[:, chosen].argmin(axis=1)]
            site = np.arange(len(sites))
            ranked.append((bad[site, best].sum(), share[site, best].max(), chosen, best))
        total, worst, chosen, best = min(ranked, key=lambda mix: mix[:3])
        if not total < before:
            break
        before = total
        mixes.append(
            MixPart(
                scanners={names[k]: tuple(np.array(sites)[best == k].tolist()) for k in chosen},
                bad_m2=float(total),
                worst_share=float(worst),
            )
        )
    return tuple(mixes)
