"""States of a building with one scanner: sets of obstacles, each with its exact effect.

Of requirements on floor, which sets are looked at depends neither on the requirement nor on the
budget, which only end the search. So a larger budget never leaves more bad floor, and a laxer
requirement never costs more.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import BAD, ZONES
from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Stages
from ambinav.studies.design.improved import zones_after
from ambinav.studies.design.place.candidates import Candidate, Kind, PlaceRules
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.place.gains import Gains
from ambinav.studies.design.place.greedy import Trials, place_each, try_alone
from ambinav.studies.design.place.map_setting import MapSetting
from ambinav.studies.design.place.positions import Positions
from ambinav.studies.design.region import Places
from ambinav.studies.design.requirement.hardware import Hardware


@dataclass(frozen=True, eq=False)
class CountedFloor:
    """Floor that counts throughout: that of the building as it is, with the present scanner.

    Attributes:
        mask: Cells that count, shape (ny, nx).
        zone: Their zones, uint8, shape (ny, nx): what a cell has that is no longer free.
        amap: Map of these cells.
    """

    mask: Bools
    zone: Bytes
    amap: AmbiguityMap

    @classmethod
    def of(cls, amap: AmbiguityMap) -> CountedFloor:
        """Return the judged floor of a map.

        Raises:
            InputError: none of it counts.
        """
        mask = amap.judged.counted
        if not mask.any():
            raise InputError(
                "none of the floor is explored and reached by the robot, so no requirement can be "
                "judged; give --start or a smaller --robot-radius."
            )
        return cls(mask, amap.floor("zone").values, amap)

    def with_map(self, amap: AmbiguityMap) -> CountedFloor:
        """Return the same floor with the zones of another map of the building.

        Cells that are not free there keep what they had: to cover bad floor gains nothing.
        """
        zone = zones_after(self.amap, amap)
        return CountedFloor(self.mask, np.where(zone < len(ZONES), zone, self.zone), self.amap)

    def areas(self, mask: Bools | None = None) -> Floats:
        """Return the area in each zone, square metres, shape (zones,); of a part of the floor."""
        zone = self.zone[self.mask if mask is None else self.mask & mask]
        counts = np.bincount(zone, minlength=len(ZONES))
        return np.asarray(counts * self.amap.cell_area, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class State:
    """The building with some changes.

    Attributes:
        hardware: The scanner.
        obstacles: The additional obstacles.
        cost: Of all changes.
        areas: Counted floor in each zone, square metres, shape (zones,).
        lost: Forecast share of robots that get lost on each trip, shape (T,); None: without trips.
    """

    hardware: Hardware
    obstacles: tuple[Candidate, ...]
    cost: float
    areas: Floats
    lost: Floats | None = None

    @property
    def bad(self) -> float:
        """Area of corridor and open zones, square metres."""
        return float(self.areas[list(BAD)].sum())


@dataclass(frozen=True, eq=False)
class Batch:
    """A placement and what is left of it without one of its obstacles.

    Attributes:
        states: The states, cheapest first; none if an earlier chain has the same placement.
        bound: No state of this batch or a later one of its chain costs less.
    """

    states: tuple[State, ...]
    bound: float


@dataclass(frozen=True, eq=False)
class Terms:
    """Terms of obstacles that hold for all scanners.

    Attributes:
        most: Largest number of each allowed kind.
        prices: Price of each.
        rules: Rules for their positions, given the kind and the scanner.
        reach: Floor that the robot reaches.
        keep_out: Polygons that none may touch; None: there are none.
        stops: Positions where the robot must still fit, metres: ends of trips.
    """

    most: Mapping[Kind, int]
    prices: Mapping[Kind, float]
    rules: Callable[[Kind, Hardware], PlaceRules]
    reach: Reach
    keep_out: BaseGeometry | None = None
    stops: tuple[tuple[float, float], ...] = ()

    def allows(self, obstacles: Sequence[Candidate]) -> bool:
        """Return whether there are no more of a kind than are allowed."""
        count = Counter(obstacle.kind for obstacle in obstacles)
        return all(number <= self.most[kind] for kind, number in count.items())

    def cost(self, obstacles: Sequence[Candidate]) -> float:
        """Return the price of some obstacles."""
        return float(sum(self.prices[obstacle.kind] for obstacle in obstacles))


class ObstacleSearch:
    """Search of obstacles for one scanner.

    Args:
        environment: The building.
        hardware: The scanner.
        amap: Its map.
        floor: Floor that counts, with the zones of this map.
        terms: Terms of obstacles.
        weight: Weight of each cell of the map, square metres, shape (ny, nx): obstacles are to help
            where it is above zero, and the areas of their states are sums of it. None: the cells'
            area.
    """

    def __init__(
        self,
        environment: Environment,
        hardware: Hardware,
        amap: AmbiguityMap,
        floor: CountedFloor,
        terms: Terms,
        weight: Floats | None = None,
    ) -> None:
        self.environment, self.hardware, self.terms = environment, hardware, terms
        self.rules = {kind: terms.rules(kind, hardware) for kind in terms.most}
        reflective = any(rule.reflective for rule in self.rules.values())
        reflective |= environment.has_reflectors
        setting = MapSetting.of(amap, hardware.scanner, reflective)
        free = setting.lattice(environment)[0].free
        if weight is None:
            weight = np.full(free.shape, amap.cell_area)
        point = np.flatnonzero((floor.mask & (weight > 0.0))[free])
        places = Places.at_all_headings(point, weight[free][point])
        self.effects = Effects(environment, setting, places)
        self.gains = Gains(self.effects)
        self._batches: dict[frozenset[Candidate], Batch] = {}
        self.elsewhere = floor.areas(~free)

    def try_places(self, stages: Stages) -> tuple[dict[Kind, Trials], dict[Kind, str]]:
        """Try every place for an obstacle alone; say why kinds of obstacles have none.

        Args:
            stages: Begins a stage by its name; what it returns is called with the share done.
        """
        scanner = self.hardware.scanner
        places = self.effects.places.point[self.effects.bad]
        bad = np.column_stack(self.effects.setting.lattice(self.environment)[0].points)[places]
        every: dict[Kind, Trials] = {}
        reasons: dict[Kind, str] = {}
        start = self.terms.reach.start
        # The robot must still fit where it sets out, and at the ends of trips.
        stops = self.terms.stops if start is None else (start, *self.terms.stops)
        lines = [shapely.LineString([stop, stop]) for stop in stops]
        for kind, rule in self.rules.items():
            if kind == "tag" and not self.hardware.reads_tags:
                reasons[kind] = f"No tags for {scanner.name}: it measures no intensities."
                continue
            try:
                positions = Positions(
                    self.environment, rule, bad, scanner.max_range, self.terms.reach.floor,
                    lines, self.terms.keep_out, self.terms.reach.radius,
                )  # fmt: skip
                allowed, _ = positions.spread()
            except InputError as error:
                reasons[kind] = str(error)
                continue
            title = f"{self.hardware.name}: {len(allowed)} places for {kind}s"
            every[kind] = try_alone(self.effects, allowed, stages(title))
        return every, reasons

    def chains(self, trials_of: Mapping[Kind, Trials]) -> Iterator[Iterator[Batch]]:
        """Yield searches over all kinds, with all, one and none of the dearest, then of each alone.

        By gain per price a dear obstacle often stands where a cheap one would do.
        """
        first, *others = trials_of.values()
        joined = reduce(Trials.and_of, others, first)
        most = dict(self.terms.most)
        dearest = max(trials_of, key=lambda kind: self.terms.prices[kind])
        if others:
            yield self._chain(joined, most)
            yield self._chain(joined, most | {dearest: 1})
        if len(others) > 1:
            yield self._chain(joined, most | {dearest: 0})
        for trials in trials_of.values():
            yield self._chain(trials, most)

    def state(self, obstacles: Sequence[Candidate]) -> State:
        """Return the building with some obstacles."""
        change = self.effects.tried([obstacle.obstacle for obstacle in obstacles])
        areas = self.elsewhere + self.effects.areas(change)
        cost = self.hardware.cost + self.terms.cost(obstacles)
        return State(self.hardware, tuple(obstacles), cost, areas)

    def in_order(self, obstacles: Sequence[Candidate]) -> tuple[tuple[Candidate, float], ...]:
        """Return obstacles by what each gains for its price after those before it.

        With the bad floor that each removes, square metres.
        """
        effects, left = self.effects.copy(), list(obstacles)
        ordered = []
        while left:
            changes = [effects.tried([candidate.obstacle]) for candidate in left]
            gains = [
                change.gain.cost / self.terms.prices[candidate.kind]
                for change, candidate in zip(changes, left, strict=True)
            ]
            best = int(np.argmax(gains))
            effects.put(changes[best])
            ordered.append((left.pop(best), changes[best].gain.bad))
        return tuple(ordered)

    def _chain(self, trials: Trials, most: Mapping[Kind, int]) -> Iterator[Batch]:
        passage = max(rule.min_passage for rule in self.rules.values())
        for obstacles in place_each(self.gains, trials, most, self.terms.prices, passage):
            if frozenset(obstacles) in self._batches:
                yield self._batches[frozenset(obstacles)]
                continue
            states = [self.state(obstacles)]
            if len(obstacles) > 1:
                states += [
                    self.state(obstacles[:i] + obstacles[i + 1 :]) for i in range(len(obstacles))
                ]
            states.sort(key=lambda state: (state.cost, state.bad))
            # Each placement costs more than those before it, but another first one may be cheaper.
            least = self.hardware.cost + min(self.terms.prices[kind] for kind in self.terms.most)
            bound = states[0].cost if len(obstacles) > 1 else min(states[0].cost, least)
            batch = Batch(tuple(states), bound)
            self._batches[frozenset(obstacles)] = replace(batch, states=())
            yield batch
