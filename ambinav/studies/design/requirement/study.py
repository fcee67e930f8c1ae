"""The complete study of `ambinav design for`: the cheapest changes that meet a requirement."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from shapely.geometry.base import BaseGeometry

from ambinav.casting.scans import plane_only
from ambinav.geometry.collision.reach import Reach, reach_of
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.candidates import Candidate, Kind, PlaceRules
from ambinav.studies.design.place.study import Report, check_passage
from ambinav.studies.design.requirement.costs import Allowed, Costs
from ambinav.studies.design.requirement.hardware import Hardware, hardware_options
from ambinav.studies.design.requirement.requirement import Requirement, bad_area
from ambinav.studies.design.requirement.states import (
    CountedFloor,
    Floats,
    ObstacleSearch,
    State,
    Terms,
)

Build = Callable[[Environment, RangeScanner], AmbiguityMap]
SLACK: Final = 1e-9
"""Sums of the same costs may differ by this share because of rounding."""


@dataclass(frozen=True, eq=False)
class MappedState:
    """A state by a full map of the changed building.

    Attributes:
        state: The state, its areas by the map.
        amap: The map, judged for the robot.
    """

    state: State
    amap: AmbiguityMap

    @property
    def own_areas(self) -> Floats:
        """Area in each zone of the changed building's own judged floor, square metres."""
        shares = self.amap.zone_shares(mask=self.amap.judged.counted)
        return np.array([share.area for share in shares])


@dataclass(frozen=True, eq=False)
class Step:
    """A change of the solution.

    Attributes:
        obstacle: The obstacle to put up; None: the scanner is changed.
        cost: Of the change.
        after: The building after it, by a full map.
    """

    obstacle: Candidate | None
    cost: float
    after: MappedState


@dataclass(frozen=True, eq=False)
class TriedHardware:
    """A scanner that was allowed.

    Attributes:
        hardware: The scanner.
        bad: Bad floor with it alone, square metres; None: no map was made.
        reason: Why no map was made; else empty.
        candidates: Places for obstacles that were tried.
    """

    hardware: Hardware
    bad: float | None
    reason: str = ""
    candidates: int = 0


@dataclass(frozen=True, eq=False)
class Solution:
    """The cheapest changes found that meet a requirement, or the best within the budget.

    Attributes:
        environment: The building as it is.
        scanner: The present scanner.
        requirement: The requirement; None: as little bad floor as the budget allows.
        budget: Largest cost; None: not limited.
        allowed: Allowed changes.
        terms: Terms of the obstacles.
        before: The building as it is.
        steps: The changes, in order.
        met: Whether the requirement holds in the end; None without one.
        states: Every state that was looked at, those by full maps included.
        tried: Every allowed scanner.
        maps: Number of full maps.
        remarks: Remarks for the reader, in sentences.
    """

    environment: Environment
    scanner: RangeScanner
    requirement: Requirement | None
    budget: float | None
    allowed: Allowed
    terms: Terms
    before: MappedState
    steps: tuple[Step, ...]
    met: bool | None
    states: tuple[State, ...]
    tried: tuple[TriedHardware, ...]
    maps: int
    remarks: tuple[str, ...]

    @property
    def after(self) -> MappedState:
        """The building with all changes."""
        return self.steps[-1].after if self.steps else self.before

    @property
    def cost(self) -> float:
        """Cost of all changes."""
        return self.after.state.cost


def meet_requirement(
    environment: Environment,
    scanner: RangeScanner,
    build: Build,
    allowed: Allowed,
    costs: Costs,
    rules: Callable[[Kind, RangeScanner], PlaceRules],
    reach: Reach,
    *,
    requirement: Requirement | None = None,
    budget: float | None = None,
    keep_out: BaseGeometry | None = None,
    source: str = "costs",
    report: Report = lambda text: lambda share: None,
) -> Solution:
    """Find the cheapest changes that meet a requirement, or the best within a budget.

    Args:
        environment: The building, in the plane.
        scanner: The present scanner.
        build: Makes the map of a building and a scanner, always with the same settings.
        allowed: Allowed changes.
        costs: Their costs.
        rules: Rules for the positions of obstacles, given kind and scanner.
        reach: Floor that the robot reaches.
        requirement: What must hold; None: as little bad floor as the budget allows.
        budget: Largest cost; None: not limited.
        keep_out: Polygons that no obstacle may touch.
        source: Names the costs in messages.
        report: Given a text, returns what is called with the share done.

    Raises:
        InputError: neither requirement nor budget is given, a change has no cost, a building in
            space, a passage narrower than the robot, no floor counts, or the polygons leave no
            place for any obstacle.
    """
    plane_only(environment, "what would meet a requirement")
    if requirement is None and budget is None:
        raise InputError('requirement: none is given; write one such as "bad < 2 %", or --budget.')
    if budget is not None and not (math.isfinite(budget) and budget >= 0.0):
        raise InputError(f"--budget: {budget:g} is not zero or above; give an amount, e.g. 500.")
    allowed.check(costs, source)
    for kind in allowed.most:
        check_passage(rules(kind, scanner), reach)
    options, remarks = hardware_options(scanner, allowed, costs, source)
    terms = Terms(
        allowed.most,
        {kind: price for kind, price in costs.prices().items() if kind in allowed.most},
        lambda kind, hardware: rules(kind, hardware.scanner),
        reach,
        keep_out,
    )
    search = _Search(environment, build, terms, requirement, budget, report)
    # A scanner that meets it alone bounds what obstacles may cost.
    for hardware in options:
        search.map_alone(hardware)
    for hardware in options:
        search.place(hardware)
    steps = search.steps(search.best or search.nearest())
    tried = tuple(search.tried[hardware] for hardware in options)
    before = search.mapped(search.with_nothing)
    end = steps[-1].after if steps else before
    return Solution(
        environment, scanner, requirement, budget, allowed, terms, before, steps,
        None if requirement is None else search.meets(end), tuple(search.states),
        tried, search.maps, (*remarks, *dict.fromkeys(search.reasons)),
    )  # fmt: skip


class _Search:
    """The state of the search: what is known, and the cheapest solution so far."""

    def __init__(
        self,
        environment: Environment,
        build: Build,
        terms: Terms,
        requirement: Requirement | None,
        budget: float | None,
        report: Report,
    ) -> None:
        self.environment, self.build, self.terms = environment, build, terms
        self.requirement, self.report = requirement, report
        self.limit = math.inf if budget is None else budget * (1.0 + SLACK)
        self.best: State | None = None
        self.states: list[State] = []
        self.tried: dict[Hardware, TriedHardware] = {}
        self.reasons: list[str] = []
        self.maps = 0
        self._bare: dict[Hardware, AmbiguityMap] = {}
        self._mapped: dict[tuple[Hardware, frozenset[Candidate]], MappedState] = {}
        self._floor: CountedFloor | None = None

    @property
    def with_nothing(self) -> State:
        """The building as it is."""
        return self.states[0]

    def map_alone(self, hardware: Hardware) -> None:
        """Map the building for a scanner, without obstacles."""
        reason = ""
        if hardware.cost > self.limit:
            reason = "costs more than the budget"
        elif self._is_dear(hardware.cost):
            reason = "costs no less than the solution"
        else:
            try:
                state = State(hardware, (), hardware.cost, self._floor_of(hardware).areas())
            except InputError as error:
                if hardware.change == "none":
                    raise
                reason = str(error)
        if reason:
            self.tried[hardware] = TriedHardware(hardware, None, reason)
            return
        self.tried[hardware] = TriedHardware(hardware, state.bad)
        self._consider(state)

    def place(self, hardware: Hardware) -> None:
        """Look for obstacles that help with a scanner, as far as they can pay."""
        known = self.tried[hardware]
        cheapest = hardware.cost + min(self.terms.prices.values(), default=math.inf)
        if not known.bad or cheapest > self.limit or self._is_dear(cheapest):
            return
        self.tried[hardware] = replace(known, candidates=self._place(hardware))

    def nearest(self) -> State:
        """Return the state within the budget that comes nearest to the requirement."""
        within = [state for state in self.states if state.cost <= self.limit]
        return min(
            within, key=lambda state: (self._distance(state), state.cost, len(state.obstacles))
        )

    def meets(self, mapped: MappedState) -> bool:
        """Return whether the requirement holds on the counted floor and in an audit."""
        return self.requirement is not None and all(
            self.requirement.holds(areas) for areas in (mapped.state.areas, mapped.own_areas)
        )

    def mapped(self, state: State) -> MappedState:
        """Return a state by a full map of the changed building."""
        key = state.hardware, frozenset(state.obstacles)
        if key not in self._mapped:
            floor = self._floor_of(state.hardware)
            edited = self.environment.edited(
                add=[candidate.obstacle for candidate in state.obstacles]
            )
            amap = self._bare[state.hardware]
            reach = self.terms.reach
            if state.obstacles:
                amap = self._map(edited, state.hardware)
                reach = reach_of(edited, reach.radius, reach.start)
            areas = floor.with_map(amap).areas()
            self._mapped[key] = MappedState(replace(state, areas=areas), amap.for_robot(reach))
        return self._mapped[key]

    def steps(self, best: State) -> tuple[Step, ...]:
        """Return the changes of a state in the order of gain per cost, each with a full map."""
        hardware, obstacles = best.hardware, best.obstacles
        bare = self.with_nothing.hardware
        ordered: tuple[tuple[Candidate, float], ...] = ()
        if obstacles:
            ordered = self._obstacles_of(hardware).in_order(obstacles)
        changes: list[Candidate | None] = [candidate for candidate, _ in ordered]
        if hardware is not bare:
            # Before the obstacles that gain less for their price.
            gain = self.with_nothing.bad - float(bad_area(self._floor_of(hardware).areas()))
            worth = [gain_of / self.terms.prices[one.kind] for one, gain_of in ordered]
            less = [k for k, each in enumerate(worth) if each * hardware.cost <= gain]
            changes.insert(min(less, default=len(changes)), None)
        steps: list[Step] = []
        cost, current, placed = 0.0, bare, list[Candidate]()
        done = self.report(f"maps of {len(changes)} steps")
        for change in changes:
            if change is None:
                current, price = hardware, hardware.cost
            else:
                placed.append(change)
                price = self.terms.prices[change.kind]
            cost += price
            state = State(current, tuple(placed), cost, best.areas)
            mapped = self.mapped(state)
            self.states.append(mapped.state)
            steps.append(Step(change, price, mapped))
            done(len(steps) / len(changes))
        return tuple(steps)

    def _place(self, hardware: Hardware) -> int:
        """Look for obstacles for a scanner; return the number of places that were tried."""
        search = self._obstacles_of(hardware)
        trials, reasons = search.try_places(self.report)
        self.reasons += reasons
        if not trials and self.terms.keep_out is not None:
            raise InputError(reasons[-1])
        done = self.report(f"{hardware.name}: obstacles together")
        most = sum(self.terms.most.values())
        for chain in search.chains(trials):
            for count, batch in enumerate(chain, start=1):
                for state in batch.states:
                    self._consider(state)
                done(min(count / most, 1.0))
                if batch.bound > self.limit or self._is_dear(batch.bound):
                    break
        done(1.0)
        return sum(len(each.candidates) for each in trials.values())

    def _consider(self, state: State) -> None:
        """Keep a state; take it as the solution if it is the cheapest that meets."""
        self.states.append(state)
        if (
            self.requirement is not None
            and state.cost <= self.limit
            and not self._is_dear(state.cost)
            and self.requirement.holds(state.areas)
            and self.meets(self.mapped(state))
        ):
            self.best = state

    def _is_dear(self, cost: float) -> bool:
        """Return whether a cost is no less than that of the solution so far."""
        return self.best is not None and cost >= self.best.cost * (1.0 - SLACK)

    def _distance(self, state: State) -> float:
        if self.requirement is None:
            return bad_area(state.areas)
        return self.requirement.distance(state.areas)

    def _floor_of(self, hardware: Hardware) -> CountedFloor:
        """Return the counted floor with the zones of a scanner's map, which is made once."""
        if hardware not in self._bare:
            amap = self._map(self.environment, hardware)
            if self._floor is None:
                self._floor = CountedFloor.of(amap.for_robot(self.terms.reach))
            self._bare[hardware] = amap
        assert self._floor is not None
        return self._floor.with_map(self._bare[hardware])

    def _obstacles_of(self, hardware: Hardware) -> ObstacleSearch:
        floor = self._floor_of(hardware)
        return ObstacleSearch(self.environment, hardware, self._bare[hardware], floor, self.terms)

    def _map(self, environment: Environment, hardware: Hardware) -> AmbiguityMap:
        self.maps += 1
        return self.build(environment, hardware.scanner)
