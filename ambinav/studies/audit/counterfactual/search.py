"""Search of changes: scanner, heading, routes and building, with the bad floor each leaves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, get_args

import numpy as np

from ambinav.drive.bootstrap import Interval
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import BAD, CORRIDOR, LOCALIZABLE, NOT_FREE, TRANSITION, ZONES
from ambinav.runtime.array_types import Bytes
from ambinav.runtime.progress import Progress, silent
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.audit.counterfactual.alternatives import Kind, ScannerChange, scanner_changes
from ambinav.studies.audit.counterfactual.sample import FloorSample
from ambinav.studies.audit.counterfactual.trips import Trips
from ambinav.studies.design.improved import ImprovedPart, largest_places

KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
PAYS: Final = 0.1
"""Share of the bad floor that a change must remove to be named, unless it reaches a gate."""
ROUNDS: Final = ((30, 10), (80, 60), (200, 250))
"""Bad places, and others, at which scanners are tried: all of them, then ever fewer."""
KEPT: Final = (4, 2, 2)
"""So many of each kind go on from a round."""
AS_GOOD: Final = 0.9
"""Share of the best change's gain from which an easier change is considered as good."""


@dataclass(frozen=True, eq=False)
class Counterfactual:
    """The building with one change.

    Attributes:
        kind: Kind of the change.
        title: Title in the imperative.
        detail: Further consequences, in a sentence; or empty.
        before: Bad floor as it is, square metres.
        after: Bad floor then, on the same judged floor; with an interval where it was computed at a
            sample of places.
        improved: Where most floor becomes good; none where that is not known.
        zones: Judged floor in each zone then, square metres, in the order of `ZONES`; None where
            that is not known.
        scanner: The new scanner; None: the present one.
        size: Range, metres, or aperture, degrees: less is less work.
    """

    kind: Kind
    title: str
    detail: str
    before: float
    after: Interval
    improved: tuple[ImprovedPart, ...] = ()
    zones: tuple[float, ...] | None = None
    scanner: RangeScanner | None = None
    size: float = 0.0

    @property
    def removed(self) -> float:
        """Bad floor removed by the change, square metres."""
        return self.before - self.after.value

    @property
    def effort(self) -> int:
        """Rank of the kind of change: a lower rank is less work."""
        return KINDS.index(self.kind)


def find_counterfactuals(
    amap: AmbiguityMap,
    environment: Environment,
    scanner: RangeScanner,
    rng: np.random.Generator,
    trips: Trips | None,
    progress: Progress = silent,
) -> tuple[Counterfactual, ...]:
    """Try headings, routes and scanners; return the best of each kind, most floor removed first.

    Args:
        amap: The map, whose judged floor counts throughout.
        environment: Building of the map.
        scanner: Scanner of the map.
        rng: Draws places.
        trips: Trips in the building (`find_trips`); None: it has none.
        progress: Called with the share done.

    Returns:
        None of them where no floor is bad.
    """
    counted = amap.judged.counted
    before = sum(share.area for share in amap.zone_shares(mask=counted)[CORRIDOR:])
    if not before > 0.0:
        return ()
    changes = [*_headings(amap, before), *_routes(before, trips)]
    progress(0.1)
    changes += _scanners(amap, environment, scanner, rng, progress)
    progress(1.0)
    return tuple(sorted(changes, key=lambda change: change.after.value))


def as_good(changes: Sequence[Counterfactual]) -> tuple[Counterfactual, ...]:
    """Return the changes that remove nearly as much as the best one, least work first."""
    gain = max((change.removed for change in changes), default=0.0)
    near = [
        change for change in changes if change.removed > 0.0 and change.removed >= AS_GOOD * gain
    ]
    return by_effort(near)


def by_effort(changes: Sequence[Counterfactual]) -> tuple[Counterfactual, ...]:
    """Sort changes by work, least first; of equals the one that removes more comes first."""
    return tuple(
        sorted(changes, key=lambda change: (change.effort, change.size, change.after.value))
    )


def _headings(amap: AmbiguityMap, before: float) -> list[Counterfactual]:
    """Evaluate the best heading of each place and the best single heading."""
    if not amap.has_theta:
        return []
    counted = amap.judged.counted
    turned = _by_heading(
        amap,
        "Turn the robot to the best heading of each place",
        "The robot must turn on the spot there, or drive sideways.",
        before,
        [share.area for share in amap.zone_shares("best", counted)],
        amap.floor("zone", "best").values,
    )
    headings = amap.dataset["theta"].values
    zone = amap.dataset["zone"].transpose("theta", "y", "x").values
    each = []
    for codes in zone:
        # Where the robot cannot stand at this heading, nothing improves.
        able = counted & (codes != NOT_FREE)
        blocked_shares = amap.zone_shares("mean", counted & ~able)
        each.append(
            [
                float((able & (codes == code)).sum()) * amap.cell_area + share.area
                for code, share in enumerate(blocked_shares)
            ]
        )
    best = min(range(len(each)), key=lambda k: sum(each[k][code] for code in BAD))
    title = f"Keep the robot at a heading of {math.degrees(headings[best]):.0f}° in the map"
    detail = "The robot must drive sideways."
    return [turned, _by_heading(amap, title, detail, before, each[best], zone[best])]


def _by_heading(
    amap: AmbiguityMap, title: str, detail: str, before: float, areas: Sequence[float], zone: Bytes
) -> Counterfactual:
    """Return what choosing the heading changes: the areas of the zones, and the zones then."""
    bad = sum(areas[code] for code in BAD)
    after = Interval(bad, bad, bad, 0)
    counted, was = amap.judged.counted, amap.floor("zone").values
    good = counted & np.isin(was, BAD) & np.isin(zone, (LOCALIZABLE, TRANSITION))
    improved = largest_places(amap, good, amap.judged)
    return Counterfactual("heading", title, detail, before, after, improved, tuple(areas))


def _routes(before: float, trips: Trips | None) -> list[Counterfactual]:
    """Estimate the bad floor met by trips that trade bad floor against the detour."""
    if trips is None or not trips.bad > 0.0:
        return []
    longer = 100.0 * (trips.aware_length / trips.length - 1.0)
    after = before * trips.aware_bad / trips.bad
    detail = (
        f"On average over {trips.count} trips between places {trips.aware_bad:.1f} m instead of "
        f"{trips.bad:.1f} m run over bad floor, and a trip is {longer:.0f} % longer."
    )
    interval = Interval(after, after, after, 0)
    return [
        Counterfactual(
            "routes", "Plan routes around bad floor with ambinav plan", detail, before, interval
        )
    ]


def _scanners(
    amap: AmbiguityMap,
    environment: Environment,
    scanner: RangeScanner,
    rng: np.random.Generator,
    progress: Progress,
) -> list[Counterfactual]:
    """Return the best scanner of each kind of change."""
    changes = scanner_changes(scanner, environment)
    if not changes:
        return []
    floor = FloorSample.of(amap, environment, scanner)
    for number, counts in enumerate(ROUNDS):
        results = _evaluate(floor, changes, counts, rng)
        progress(0.1 + 0.9 * (number + 1) / len(ROUNDS))
        gain = max(change.removed for change in results)
        finalists = [
            at
            for kind in KINDS
            for at in _best_of_kind(kind, results, AS_GOOD * gain, KEPT[number])
        ]
        changes = [changes[at] for at in finalists]
        if not changes:
            return []
    return [results[at] for at in finalists]


def _best_of_kind(
    kind: Kind, changes: Sequence[Counterfactual], least_gain: float, count: int
) -> list[int]:
    """Return the indices of the best changes of a kind.

    For range and aperture, the smallest sufficient changes are included.
    """
    mine = [i for i, change in enumerate(changes) if change.kind == kind and change.removed > 0.0]
    best = sorted(mine, key=lambda i: changes[i].after.value)[:count]
    if kind in ("range", "aperture"):
        doing = [i for i in mine if changes[i].removed >= least_gain]
        best = sorted({*best[:1], *doing[: count - 1]})
    return best


def _evaluate(
    floor: FloorSample,
    changes: Sequence[ScannerChange],
    counts: tuple[int, int],
    rng: np.random.Generator,
) -> list[Counterfactual]:
    """Evaluate each scanner at the same places."""
    bad, localizable = floor.drawn(*counts, rng)
    point = np.union1d(bad, localizable)
    was_bad = np.isin(point, bad)
    results = []
    # Together, so that beams which several scanners share are cast once.
    zones = floor.zones([change.scanner for change in changes], point)
    for change, zone in zip(changes, zones, strict=True):
        parts = zone[was_bad], zone[~was_bad]
        results.append(
            Counterfactual(
                change.kind,
                change.title,
                "",
                floor.bad_area,
                floor.area_in(BAD, *parts),
                floor.improved(bad, parts[0]),
                tuple(floor.area_in((code,), *parts).value for code in range(len(ZONES))),
                change.scanner,
                change.value,
            )
        )
    return results
