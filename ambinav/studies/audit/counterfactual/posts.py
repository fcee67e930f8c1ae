"""Posts for an audit: places where a few posts help, found in about a second.

Bad floor is looked at in a sample, candidates are tried coarsely and then about the best of them,
and what the chosen ones do is computed on the whole map in the end. `ambinav design place` looks
longer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely

from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import BAD, NOT_FREE, ZONES
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent, within
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.audit.counterfactual.search import AS_GOOD, PAYS
from ambinav.studies.audit.counterfactual.trips import Trips
from ambinav.studies.audit.post_search import PostSearch
from ambinav.studies.design.improved import improved_floor, largest_places, zones_after
from ambinav.studies.design.place.candidates import Candidate, PlaceRules
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.place.greedy import NOTHING, place, try_alone
from ambinav.studies.design.place.map_setting import MapSetting
from ambinav.studies.design.place.positions import Positions
from ambinav.studies.design.place.study import Remedy
from ambinav.studies.design.region import Places, Region

PLACES: Final = 160
"""Bad places at which posts are tried."""
CANDIDATES: Final = 96
"""Candidates, at the most,"""
COARSER: Final = 4
"""step between those that are tried in a first round,"""
FINE: Final = 12
"""and number of those near the best that are tried in a second round."""
ABREAST: Final = 0.5
"""Distance between two robots that pass each other, metres; posts leave room for it."""
MOST_STANDS: Final = 300
"""Places of the floor from which it is asked how much bad floor is in sight."""


def could_pay(amap: AmbiguityMap, scanner: RangeScanner, rival: float, count: int = 3) -> bool:
    """Return whether posts may remove a tenth of the bad floor and as much as another change does.

    Args:
        amap: The map, whose judged floor counts.
        scanner: The scanner.
        rival: Bad floor that another change removes, square metres.
        count: How many posts.
    """
    if count * math.pi * scanner.max_range**2 < AS_GOOD * rival:
        return False
    bad = amap.judged.counted & np.isin(amap.floor("zone").values, BAD)
    points = amap.centres(bad)
    if not len(points):
        return False
    floor = amap.centres(amap.judged.counted)
    stands = floor[:: max(len(floor) // MOST_STANDS, 1)]
    seen = _in_sight(stands, points, scanner.max_range, count) * amap.cell_area
    return seen >= PAYS * len(points) * amap.cell_area and seen >= AS_GOOD * rival


def find_posts(
    environment: Environment,
    scanner: RangeScanner,
    amap: AmbiguityMap,
    reach: Reach,
    count: int,
    trips: Trips | None,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> PostSearch:
    """Place posts that reduce the bad floor of the whole map.

    They leave room for two robots side by side wherever there is, and stay off the paths of trips.

    Args:
        environment: The building.
        scanner: The scanner.
        amap: Its map, whose judged floor counts.
        reach: Floor that the robot reaches.
        count: How many posts.
        trips: Between places of the building, whose paths are kept clear; None: none are known.
        rng: Draws places.
        progress: Called with the share done.
    """
    rules = PlaceRules(
        min_passage=max(4.0 * reach.radius + ABREAST, PlaceRules().min_passage),
        most=CANDIDATES,
        reflective=len(scanner.intensity_beams) > 0,
    ).suited(environment)
    zone = amap.floor("zone").values
    bad = amap.judged.counted & np.isin(zone, BAD)
    points = amap.centres(bad)
    lines = [shapely.LineString(path) for path in ([] if trips is None else trips.paths)]

    try:
        positions = Positions(
            environment, rules, points, scanner.max_range, reach.floor, lines, None, reach.radius
        )
        every, _ = positions.spread_evenly(CANDIDATES)
    except InputError as error:
        return PostSearch(count, rules, None, str(error))
    coarse = every[::COARSER]
    between = [candidate for i, candidate in enumerate(every) if i % COARSER]
    middles = np.array([candidate.middle for candidate in coarse])
    if _in_sight(middles, points, scanner.max_range, count) < PAYS * len(points):
        reason = (
            f"{count} posts can be within {scanner.max_range:g} m of less than a tenth of the bad "
            "floor; they were not tried."
        )
        return PostSearch(count, rules, None, reason)
    setting = MapSetting.of(amap, scanner, rules.reflective or environment.has_reflectors)
    lattice, _ = setting.lattice(environment)
    bad_points = np.flatnonzero(bad[lattice.free])
    places = Places.at_all_headings(bad_points, np.full(len(bad_points), amap.cell_area))
    effects = Effects(environment, setting, places.sampled(lattice, PLACES, rng))
    progress(0.2)
    trials = try_alone(effects, coarse, within(progress, 0.2, 0.5))
    best = [trials.candidates[i] for i in trials.order[:count]]
    fine = _nearest(between, best, FINE)
    trials = trials.and_of(try_alone(effects, fine, within(progress, 0.5, 0.7)))
    placement = place(
        effects, trials, count, rules.min_passage, least=NOTHING,
        progress=within(progress, 0.7, 0.9),
    )  # fmt: skip
    remedy = Remedy(
        environment, scanner, amap, amap.judged, (Region.of_map(),), rules, reach, trials, placement
    )
    if not placement.placed:
        progress(1.0)
        return PostSearch(count, rules, remedy, "")
    after, remaining_area = amap, []
    for chosen in range(1, len(placement.placed) + 1):
        after = after.update(remedy.edited(chosen))
        improved = improved_floor(amap, after, amap.judged)
        remaining_area.append(float((bad & ~improved).sum()) * amap.cell_area)
    progress(1.0)
    worst_places = largest_places(amap, improved, amap.judged)
    then = zones_after(amap, after)
    then = np.where(then == NOT_FREE, zone, then)[amap.judged.counted]
    areas = tuple(float((then == code).sum()) * amap.cell_area for code in range(len(ZONES)))
    return PostSearch(count, rules, remedy, "", tuple(remaining_area), worst_places, areas)


def _in_sight(stands: Floats, points: Floats, sight: float, count: int) -> int:
    """Count the points within sight of `count` greedily chosen positions; walls are ignored."""
    near = np.array([np.hypot(*(points - place).T) <= sight for place in stands])
    is_unseen = np.ones(len(points), dtype=np.bool_)
    for _ in range(count):
        gains = (near & is_unseen).sum(axis=1)
        is_unseen &= ~near[int(gains.argmax())]
    return int((~is_unseen).sum())


def _nearest(candidates: Sequence[Candidate], best: list[Candidate], count: int) -> list[Candidate]:
    """Return the `count` candidates nearest to the best ones."""
    middles = np.array([candidate.middle for candidate in best])
    away = [float(np.hypot(*(middles - candidate.middle).T).min()) for candidate in candidates]
    return [candidates[i] for i in np.argsort(away, kind="stable")[:count].tolist()]
