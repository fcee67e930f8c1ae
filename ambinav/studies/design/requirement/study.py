"""The complete study of `ambinav design for`: the cheapest changes that meet a requirement."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from shapely.geometry.base import BaseGeometry

from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Stages, silent_stages
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.candidates import Kind, PlaceRules
from ambinav.studies.design.place.positions import check_zones
from ambinav.studies.design.place.study import check_passage
from ambinav.studies.design.requirement.costs import Allowed, Costs
from ambinav.studies.design.requirement.hardware import hardware_options
from ambinav.studies.design.requirement.requirement import Requirement
from ambinav.studies.design.requirement.search import (
    Build,
    ChangeSearch,
    MappedState,
    Step,
    TriedHardware,
)
from ambinav.studies.design.requirement.states import State, Terms
from ambinav.studies.design.requirement.trip_forecasts import TripForecaster


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
        forecaster: Trips that a requirement on lost robots is about; else None.
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
    forecaster: TripForecaster | None = None

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
    trips: TripForecaster | None = None,
    source: str = "costs",
    stages: Stages = silent_stages,
) -> Solution:
    """Find the cheapest changes that meet a requirement, or the best within a budget.

    Args:
        environment: The building.
        scanner: The present scanner.
        build: Makes the map of a building and a scanner, always with the same settings.
        allowed: Allowed changes.
        costs: Their costs.
        rules: Rules for the positions of obstacles, given kind and scanner.
        reach: Floor that the robot reaches.
        requirement: What must hold; None: as little bad floor as the budget allows.
        budget: Largest cost; None: not limited.
        keep_out: Polygons that no obstacle may touch.
        trips: Trips of a requirement on lost robots.
        source: Names the costs in messages.
        stages: Begins a stage by its name; what it returns is called with the share done.

    Raises:
        InputError: neither requirement nor budget is given, a requirement on lost robots without
            trips or trips without one, a change has no cost, a passage narrower than the robot, no
            floor counts, the polygons lie beside the building or leave no place for an obstacle, or
            see `PlaceRules.suited`.
    """
    if requirement is None and budget is None:
        raise InputError('requirement: none is given; write one such as "bad < 2 %", or --budget.')
    if (trips is None) is not (requirement is None or requirement.most_lost is None):
        raise InputError(
            "requirement: trips are needed for one on lost robots, and are for no other; give "
            '"lost < 5 %" and the trips.'
        )
    if budget is not None and not (math.isfinite(budget) and budget >= 0.0):
        raise InputError(f"--budget: {budget:g} is not zero or above; give an amount, e.g. 500.")
    allowed.check(costs, source)
    check_zones(keep_out, environment)
    for kind in allowed.most:
        check_passage(rules(kind, scanner).suited(environment), reach)
    options, remarks = hardware_options(scanner, allowed, costs, source)
    terms = Terms(
        allowed.most,
        {kind: price for kind, price in costs.prices().items() if kind in allowed.most},
        lambda kind, hardware: rules(kind, hardware.scanner).suited(environment),
        reach,
        keep_out,
        () if trips is None else trips.stops,
    )
    search = ChangeSearch(environment, build, terms, requirement, budget, stages, trips)
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
        tried, search.maps,
        (*remarks, *dict.fromkeys(search.reasons), *(trips.notes if trips is not None else ())),
        trips,
    )  # fmt: skip
