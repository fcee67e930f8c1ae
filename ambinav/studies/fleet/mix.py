"""The few kinds of scanners that serve all sites best, each site with the best of them."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np

from ambinav.studies.fleet.document import FleetFigures, MixPart

KINDS: Final = 3
"""Most kinds of scanners in a mix."""


def best_mixes(rows: Sequence[FleetFigures]) -> tuple[MixPart, ...]:
    """Return the best mix of one scanner, of two, and so on to `KINDS`, as far as one more helps.

    The best one leaves the least bad floor on all sites together, of equal ones the least share of
    the worst site. All sets are compared. A site counts if it was audited for several scanners, and
    one of them has figures there; a scanner without figures at a site does not serve it.

    Returns:
        Empty if no site counts.
    """
    audits = Counter(row.site for row in rows)
    choices = [row for row in rows if audits[row.site] > 1]
    figures = {(row.site, row.scanner): row for row in choices if row.bad_m2 is not None}
    names = sorted({row.scanner for row in choices})
    sites = [*dict.fromkeys(site for site, _ in figures)]
    if not sites:
        return ()
    bad, share = np.full((2, len(sites), len(names)), np.inf)
    for (place, name), row in figures.items():
        cell = sites.index(place), names.index(name)
        bad[cell], share[cell] = row.bad_m2, row.bad_share
    mixes, before = list[MixPart](), np.inf
    for size in range(1, min(KINDS, len(names)) + 1):
        ranked = []
        for chosen in itertools.combinations(range(len(names)), size):
            best = np.array(chosen)[bad[:, chosen].argmin(axis=1)]
            site = np.arange(len(sites))
            ranked.append((bad[site, best].sum(), share[site, best].max(), chosen, best))
        total, worst, chosen, best = min(ranked, key=lambda mix: mix[:3])
        if not total < before:  # no gain, or a site that no scanner of any set serves
            continue
        before = total
        mixes.append(
            MixPart(
                scanners={names[k]: tuple(np.array(sites)[best == k].tolist()) for k in chosen},
                bad_m2=float(total),
                worst_share=float(worst),
            )
        )
    return tuple(mixes)
