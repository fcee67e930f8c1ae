"""Search of the cheapest changes: scanners first, then obstacles as far as they can pay."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np

from ambinav.geometry.collision.reach import Reach, reach_of
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.trip_routes import NoRouteError
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Stages
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.candidates import Candidate, Kind, apart
from ambinav.studies.design.requirement.hardware import Hardware
from ambinav.studies.design.requirement.requirement import Requirement, bad_area
from ambinav.studies.design.requirement.states import (
    Batch,
    CountedFloor,
    ObstacleSearch,
    State,
    Terms,
)
from ambinav.studies.design.requirement.trip_forecasts import TripForecaster, TripLosses

Build: TypeAlias = Callable[[Environment, RangeScanner], AmbiguityMap]
KEPT: Final = 24
"""States whose maps are kept in memory; others are mapped again when they are needed."""
SLACK: Final = 1e-9
"""Sums of the same costs may differ by this share because of rounding."""


@dataclass(frozen=True, eq=False)
class MappedState:
    """A state by a full map of the changed building.

    Attributes:
        state: The state, its areas by the map.
        environment: The changed building.
        full_map: Its map.
        reach: Floor that the robot reaches in the building as it is.
        losses: Lost robots on the trips; None: there are no trips.
    """

    state: State
    environment: Environment
    full_map: AmbiguityMap
    reach: Reach
    losses: TripLosses | None = None

    @cached_property
    def amap(self) -> AmbiguityMap:
        """The map, judged for the robot in the changed building."""
        reach = reach_of(self.environment, self.reach.radius, self.reach.start)
        return self.full_map.for_robot(reach)

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
        candidates: Number of places that were tried, by kind of obstacle.
    """

    hardware: Hardware
    bad: float | None
    reason: str = ""
    candidates: Mapping[Kind, int] = field(default_factory=dict)


class ChangeSearch:
    """The state of the search: what is known, and the cheapest solution so far.

    Args:
        environment: The building.
        build: Makes the map of a building and a scanner, always with the same settings.
        terms: Terms of obstacles.
        requirement: What must hold; None: as little bad floor as the budget allows.
        budget: Largest cost; None: not limited.
        stages: Begins a stage by its name; what it returns is called with the share done.
        forecaster: Trips of a requirement on lost robots.
    """

    def __init__(
        self,
        environment: Environment,
        build: Build,
        terms: Terms,
        requirement: Requirement | None,
        budget: float | None,
        stages: Stages,
        forecaster: TripForecaster | None = None,
    ) -> None:
        self.forecaster = forecaster
        self.environment, self.build, self.terms = environment, build, terms
        self.requirement, self.stages = requirement, stages
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
            reason = "costs more than the solution"
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
        if not self.terms.most:
            return
        trial = self.tried[hardware]
        cheapest = hardware.cost + min(self.terms.prices.values(), default=math.inf)
        if not trial.bad or cheapest > self.limit or self._is_dear(cheapest):
            return
        weight = self._weight(hardware)
        if weight is not None and not weight.any():
            return
        self.tried[hardware] = replace(trial, candidates=self._place(hardware))

    def nearest(self) -> State:
        """Return the state within the budget that comes nearest to the requirement."""
        within = [state for state in self.states if state.cost <= self.limit]
        # Lost robots to the digit that is shown: nothing is bought for less.
        digits = 15 if self.forecaster is None else 1
        return min(
            within,
            key=lambda state: (
                round(self._distance(state), digits), state.cost, len(state.obstacles)
            ),
        )  # fmt: skip

    def meets(self, mapped: MappedState) -> bool:
        """Return whether the requirement holds.

        One on floor must hold on the counted floor and in an audit; one on lost robots by the
        forecast and in drives.
        """
        if self.requirement is None or not self.requirement.holds(mapped.state):
            return False
        most = self.requirement.most_lost
        if most is not None:
            return mapped.losses is not None and mapped.losses.confirms(most)
        return self.requirement.holds(replace(mapped.state, areas=mapped.own_areas))

    def mapped(self, state: State) -> MappedState:
        """Return a state by a full map of the changed building."""
        key = state.hardware, frozenset(state.obstacles)
        if key not in self._mapped:
            floor = self._floor_of(state.hardware)
            added = [candidate.obstacle for candidate in state.obstacles]
            edited = self.environment.edited(add=added)
            amap = self._map(edited, state.hardware) if added else self._bare[state.hardware]
            areas = floor.with_map(amap).areas()
            losses = (
                None if self.forecaster is None else self.forecaster.losses(amap, edited, added)
            )
            lost = None if losses is None else losses.lost
            state = replace(state, areas=areas, lost=lost)
            if len(self._mapped) >= KEPT:
                del self._mapped[next(iter(self._mapped))]
            self._mapped[key] = MappedState(state, edited, amap, self.terms.reach, losses)
        return self._mapped[key]

    def steps(self, best: State) -> tuple[Step, ...]:
        """Return the changes of a state in the order of gain per cost, each with a full map."""
        hardware, obstacles = best.hardware, best.obstacles
        bare = self.with_nothing.hardware
        changes = self._in_order(hardware, obstacles)
        steps: list[Step] = []
        cost, current, placed = 0.0, bare, list[Candidate]()
        done = self.stages(f"maps of {len(changes)} steps")
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

    def _in_order(
        self, hardware: Hardware, obstacles: Sequence[Candidate]
    ) -> list[Candidate | None]:
        """Sort changes by gain per cost, each after those before it; None: the scanner.

        For trips, the scanner first, and the obstacles as the search has them.
        """
        if self.forecaster is not None:
            scanner = [] if hardware is self.with_nothing.hardware else [None]
            return [*scanner, *obstacles]
        with_it = self._obstacles_of(hardware).in_order(obstacles) if obstacles else ()
        ordered: list[Candidate | None] = [obstacle for obstacle, _ in with_it]
        bare = self.with_nothing.hardware
        if hardware is bare:
            return ordered
        gain = self.with_nothing.bad - bad_area(self._floor_of(hardware).areas())
        without = self._obstacles_of(bare).in_order(obstacles) if obstacles else ()
        first: list[Candidate | None] = []
        for obstacle, removed in without:
            if removed / self.terms.prices[obstacle.kind] * hardware.cost <= gain:
                break
            first.append(obstacle)
        return [*first, None, *(obstacle for obstacle in ordered if obstacle not in first)]

    def _place(self, hardware: Hardware) -> dict[Kind, int]:
        """Look for obstacles for a scanner; return the number of tried places by kind."""
        search = self._obstacles_of(hardware)
        trials, reasons = search.try_places(self.stages)
        self.reasons += reasons.values()
        untried = [reasons[kind] for kind in reasons if kind != "tag" or hardware.reads_tags]
        is_only = len(self.tried) == 1
        if untried and not trials and is_only and self.terms.keep_out is not None:
            raise InputError(untried[-1])
        if not trials:
            return {}
        done = self.stages(f"{hardware.name}: obstacles together")
        most = sum(self.terms.most.values())
        chains = list(search.chains(trials))
        for number, chain in enumerate(chains):
            for count, batch in enumerate(chain, start=1):
                self._consider_batch(batch)
                done((number + count / most) / len(chains))
                if batch.bound > self.limit or self._is_dear(batch.bound):
                    break
        done(1.0)
        candidates = [candidate for each in trials.values() for candidate in each.candidates]
        if self.forecaster is not None:
            self._place_by_causes(hardware, candidates)
        return {kind: len(each.candidates) for kind, each in trials.items()}

    def _place_by_causes(self, hardware: Hardware, candidates: Sequence[Candidate]) -> None:
        """Put up one obstacle after the other near where most robots get lost by the forecast."""
        floor, terms = self._floor_of(hardware), self.terms
        passage = max(terms.rules(kind, hardware).min_passage for kind in terms.most)
        current = self.mapped(State(hardware, (), hardware.cost, floor.areas()))
        most = sum(terms.most.values())
        done = self.stages(f"{hardware.name}: obstacles where robots get lost")
        for count in range(most):
            assert current.losses is not None
            chosen = current.state.obstacles
            states = [
                State(hardware, obstacles, hardware.cost + terms.cost(obstacles), floor.areas())
                for candidate in current.losses.near_cause(candidates)
                if terms.allows(obstacles := (*chosen, candidate))
                and all(apart(candidate, other, passage) for other in chosen)
            ]
            for state in states:
                self._consider(state)
            best, largest = current, 0.0
            for state in states:
                mapped = self._usable(state) if self._is_payable(state.cost) else None
                gain = 0.0 if mapped is None else _saved(current.state, mapped.state)
                if mapped is not None and gain > largest:
                    best, largest = mapped, gain
            done((count + 1) / most)
            if best is current:
                break
            current = best

    def _consider_batch(self, batch: Batch) -> None:
        """Keep the states of a batch, as far as they can be the solution."""
        if not batch.states:
            return
        *fewer, every = batch.states
        if self.forecaster is None:
            fewer = list(batch.states)
        elif self._is_payable(every.cost) and not self._consider(every):
            # A forecast needs a map: if all obstacles do not do, fewer are not tried.
            return
        for state in fewer:
            self._consider(state)

    def _consider(self, state: State) -> bool:
        """Keep a state; take it as the solution, and return True, if it is the cheapest so far."""
        payable = self._is_payable(state.cost)
        if self.forecaster is not None:
            if not payable:
                return False
            # Until it has a map its areas are those of the weighted floor.
            usable = self._usable(state)
            if usable is None:
                return False
            state = usable.state
        self.states.append(state)
        if (
            self.requirement is not None
            and payable
            and self.requirement.holds(state)
            and self._is_better(state)
            and self.meets(self.mapped(state))
        ):
            self.best = state
        return self.best is state

    def _usable(self, state: State) -> MappedState | None:
        """Return a state by a full map; None if its obstacles leave no route for a trip."""
        try:
            return self.mapped(state)
        except NoRouteError:
            return None

    def _is_payable(self, cost: float) -> bool:
        """Return whether a cost is within the budget and not too dear."""
        return cost <= self.limit and not self._is_dear(cost)

    def _is_better(self, state: State) -> bool:
        """Return whether a state is cheaper than the solution so far, or as cheap and less bad."""
        best = self.best
        if best is None or state.cost < best.cost * (1.0 - SLACK):
            return True
        return state.bad < best.bad * (1.0 - SLACK)

    def _is_dear(self, cost: float) -> bool:
        """Return whether a cost is above that of the solution so far; for lost robots, no less.

        At one cost the least bad floor is best. That of lost robots would need drives of each.
        """
        if self.best is None:
            return False
        slack = SLACK if self.forecaster is None else -SLACK
        return cost > self.best.cost * (1.0 + slack)

    def _distance(self, state: State) -> float:
        if self.requirement is None:
            return state.bad
        return self.requirement.distance(state)

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
        return ObstacleSearch(
            self.environment, hardware, self._bare[hardware], floor, self.terms,
            self._weight(hardware),
        )  # fmt: skip

    def _weight(self, hardware: Hardware) -> Floats | None:
        """Return the weight of each cell in a search for trips; None: of a search without."""
        floor = self._floor_of(hardware)
        losses = self.mapped(State(hardware, (), hardware.cost, floor.areas())).losses
        return None if losses is None else losses.weights(self._bare[hardware])

    def _map(self, environment: Environment, hardware: Hardware) -> AmbiguityMap:
        self.maps += 1
        return self.build(environment, hardware.scanner)


def _saved(before: State, after: State) -> float:
    """Return by how much fewer robots get lost for what is paid, on the worst trip."""
    assert before.lost is not None
    assert after.lost is not None
    return float(before.lost.max() - after.lost.max()) / (after.cost - before.cost)
