"""A solution as data: contents of report.json and source of the written reports."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from pydantic import Field

from ambinav.drive.odometries import odometry_name
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.reports.fields import Metres, Part, Share, SquareMetres
from ambinav.studies.design.improved import ImprovedPart, most_improved
from ambinav.studies.design.place.document import REFLECTORS_WEIGH, RulesPart, rules_part
from ambinav.studies.design.place.placed_part import (
    BuildingDocument,
    Rounded,
    head_of,
    placed_geojson,
)
from ambinav.studies.design.requirement.requirement import bad_area
from ambinav.studies.design.requirement.search import MappedState, Step
from ambinav.studies.design.requirement.states import State
from ambinav.studies.design.requirement.study import Solution
from ambinav.studies.design.requirement.trip_part import TripPart, trip_parts, worst_trip
from ambinav.studies.design.scanners.fronts import Front

FORMAT: Final = "ambinav-design-for/1"


class FloorPart(Part):
    """Bad floor of a full map."""

    bad_area_m2: SquareMetres = Field(
        description="corridor and open zones of the floor that counts"
    )
    bad_share: Share = Field(description="of the floor that counts: judged before any change")
    corridor_area_m2: SquareMetres
    open_area_m2: SquareMetres
    value: Rounded | None = Field(description="of the requirement's figure; null: none is given")
    audit_bad_share: Share = Field(description="of the changed building's own judged floor")


class StepPart(Part):
    """A change, in order, with the building after it."""

    number: int
    change: str = Field(description="post, panel, tag, scanner, mount or second-scanner")
    text: str
    x_m: Metres | None = Field(description="of an obstacle; null for a change of the scanner")
    y_m: Metres | None
    direction_deg: float | None = Field(description="of a panel or a tag")
    on_wall: bool | None
    cost: Rounded
    cost_so_far: Rounded
    after: FloorPart


class PointPart(Part):
    """A state of the curve: its cost, the bad floor that it leaves, and the lost robots."""

    label: str
    cost: Rounded
    bad_area_m2: SquareMetres
    bad_share: Share
    lost: Share | None = Field(description="on the worst trip, by the forecast; null: no trips")
    on_front: bool = Field(description="no other state is as good in both and better in one")


class OptionPart(Part):
    """An allowed scanner, without obstacles."""

    change: str
    title: str
    scanner: str
    cost: Rounded
    bad_area_m2: SquareMetres | None = Field(description="null: no map was made")
    lost: Share | None = Field(description="on the worst trip, by the forecast; null: not known")
    reason: str = Field(description="why no map was made; else empty")
    candidates: int = Field(description="places for obstacles that were tried with it")


class Document(BuildingDocument):
    """The whole report."""

    format: str = FORMAT
    requirement: str | None
    budget: float | None
    summary: str
    met: bool | None = Field(description="null: no requirement is given")
    cost: Rounded
    counted_area_m2: SquareMetres
    before: FloorPart
    after: FloorPart
    steps: tuple[StepPart, ...]
    improved: tuple[ImprovedPart, ...] = Field(
        description="the three places where most floor becomes good, the largest first"
    )
    trips: tuple[TripPart, ...] = Field(description="of a requirement on lost robots; else empty")
    localizer: str | None = Field(description="class of localizer; null without trips")
    odometry: str | None = Field(description="errors of the odometry; null without trips")
    curve: tuple[PointPart, ...] = Field(description="by rising cost")
    options: tuple[OptionPart, ...]
    prices: dict[str, float] = Field(description="of an obstacle of each allowed kind")
    rules: tuple[RulesPart, ...] = Field(description="of each allowed kind")
    states: int = Field(description="sets of changes whose effect was computed")
    maps: int = Field(description="full maps that were made")
    remarks: tuple[str, ...]
    parameters: dict[str, Any] = Field(description="of the maps")
    geojson: dict[str, Any] = Field(description="the obstacles, as changes.geojson holds them")


def document(solution: Solution) -> Document:
    """Collect the figures of the report."""
    terms, hardware = solution.terms, solution.before.state.hardware
    alone = {
        state.hardware: float(state.lost.max())
        for state in solution.states
        if state.lost is not None and not state.obstacles
    }
    losses, trips = solution.before.losses, trip_parts(solution)
    return Document(
        **head_of(solution.environment, solution.scanner, terms.reach),
        requirement=None if solution.requirement is None else str(solution.requirement),
        budget=solution.budget,
        summary=_summary(solution, trips),
        met=solution.met,
        cost=solution.cost,
        counted_area_m2=float(solution.before.state.areas.sum()),
        before=_floor(solution, solution.before),
        after=_floor(solution, solution.after),
        steps=tuple(_step(solution, number, step) for number, step in enumerate(solution.steps, 1)),
        improved=most_improved(solution.before.amap, solution.after.amap),
        trips=trips,
        localizer=None if losses is None else losses.forecaster.localizer.name,
        odometry=None if losses is None else odometry_name(losses.forecaster.odometry),
        curve=_curve(solution),
        options=tuple(
            OptionPart.of(
                each,
                change=each.hardware.change,
                title=each.hardware.title or f"Keep {each.hardware.scanner.name}",
                scanner=each.hardware.scanner.name,
                cost=each.hardware.cost,
                bad_area_m2=each.bad,
                lost=alone.get(each.hardware),
                candidates=sum(each.candidates.values()),
            )
            for each in solution.tried
        ),
        prices={str(kind): price for kind, price in terms.prices.items()},
        rules=tuple(
            rules_part(
                terms.rules(kind, hardware),
                sum(each.candidates.get(kind, 0) for each in solution.tried),
                solution.environment,
            )
            for kind in terms.most
        ),
        states=len({(each.hardware, frozenset(each.obstacles)) for each in solution.states}),
        maps=solution.maps,
        remarks=_remarks(solution),
        parameters=solution.before.amap.parameters,
        geojson=_geojson(solution),
    )


def money(value: float) -> str:
    """Format an amount in the currency of the user's file, which does not say which."""
    return f"{value:,.2f}".removesuffix(".00")


def _summary(solution: Solution, trips: tuple[TripPart, ...]) -> str:
    budget = "" if solution.budget is None else f" within a budget of {money(solution.budget)}"
    changes = f"{state_label(solution.after.state)} for {money(solution.cost)}"
    requirement, figure = f'"{solution.requirement}"', _figure(solution, trips)
    if solution.met is None:
        best = (
            f"The best found{budget} is {changes}" if solution.steps else f"Nothing helps{budget}"
        )
        return f"{best}: {figure}."
    if solution.met and not solution.steps:
        return f"{requirement} holds already: nothing to do, at no cost; {figure}."
    if solution.met:
        return f"{requirement} is met by {changes}, the cheapest changes found{budget}: {figure}."
    none = "no allowed change helps" if solution.budget is None else "no change within it helps"
    best = f"the best found is {changes}" if solution.steps else none
    figure += _audited(solution)
    return f"{requirement} cannot be met by the changes that were tried{budget}; {best}: {figure}."


def _audited(solution: Solution) -> str:
    """Return what an audit of the changed building shows, if that alone misses the requirement."""
    required, after = solution.requirement, solution.after
    if required is None or required.most_lost is not None or not required.holds(after.state):
        return ""
    value = required.value(replace(after.state, areas=after.own_areas))
    figure = required.condition.quantity
    unit = "% of the floor" if figure.unit == "%" else figure.unit
    return f", but an audit of the changed building counts {value:.4g} {unit} as {figure.name}"


def _figure(solution: Solution, trips: tuple[TripPart, ...]) -> str:
    """Return what the changes do to bad floor, or to lost robots."""
    name, changed = solution.environment.name, bool(solution.steps)
    if not trips:
        before, after = _amount(solution.before.state), _amount(solution.after.state)
        figure = f"goes from {before} to {after}" if changed else f"stays {before}"
        return f"bad floor of {name} {figure}{_required(solution)}"
    before, after = worst_trip(trips, after=False), worst_trip(trips, after=True)
    figure = f"goes from {before} to {after}" if changed else f"stays {before}"
    text = f"the forecast share of lost robots on the worst trip through {name} {figure}"
    if solution.met:
        return f"{text}, and drives confirm the limit on each trip"
    assert solution.requirement is not None
    holds = solution.requirement.holds(solution.after.state)
    return f"{text}, but drives do not confirm it" if holds else text


def _required(solution: Solution) -> str:
    """Return what the changes do to what is required, where that is not bad floor."""
    required = solution.requirement
    if required is None or required.condition.quantity.name.startswith("bad"):
        return ""
    quantity = required.condition.quantity
    unit = "" if not quantity.unit else f" {quantity.unit}"
    after = f"{required.value(solution.after.state):.3g}{unit}"
    if not solution.steps:
        return f", {quantity.name} stays {after}"
    return f", {quantity.name} from {required.value(solution.before.state):.3g}{unit} to {after}"


def _amount(state: State) -> str:
    return f"{state.bad:,.1f} m² ({100.0 * state.bad / state.areas.sum():.1f} %)"


def state_label(state: State) -> str:
    """Describe a state in a few words, such as "2 posts, sick-tim571"."""
    counts: dict[str, int] = {}
    for obstacle in state.obstacles:
        counts[obstacle.kind] = counts.get(obstacle.kind, 0) + 1
    parts = [f"{count} {kind}{'' if count == 1 else 's'}" for kind, count in counts.items()]
    if state.hardware.label:
        prefix = "scanner " if state.hardware.change == "mount" else ""
        parts.append(prefix + state.hardware.label)
    return ", ".join(parts) or "as it is"


def _floor(solution: Solution, mapped: MappedState) -> FloorPart:
    areas, own_areas = mapped.state.areas, mapped.own_areas
    return FloorPart(
        bad_area_m2=mapped.state.bad,
        bad_share=mapped.state.bad / float(areas.sum()),
        corridor_area_m2=float(areas[CORRIDOR]),
        open_area_m2=float(areas[OPEN]),
        value=None if solution.requirement is None else solution.requirement.value(mapped.state),
        audit_bad_share=bad_area(own_areas) / max(float(own_areas.sum()), 1e-9),
    )


def _step(solution: Solution, number: int, step: Step) -> StepPart:
    placed, state = step.obstacle, step.after.state
    reflecting = placed is not None and placed.obstacle.reflective and placed.kind != "tag"
    return StepPart(
        number=number,
        change=state.hardware.change if placed is None else placed.kind,
        text=state.hardware.title
        if placed is None
        else f"Put up a {'reflecting ' if reflecting else ''}{placed.kind}",
        x_m=None if placed is None else placed.middle[0],
        y_m=None if placed is None else placed.middle[1],
        direction_deg=None if placed is None else placed.direction_deg,
        on_wall=None if placed is None else placed.on_wall,
        cost=step.cost,
        cost_so_far=state.cost,
        after=_floor(solution, step.after),
    )


def _curve(solution: Solution) -> tuple[PointPart, ...]:
    """Return the best state of each cost and label, and which are not dominated."""
    best: dict[tuple[str, float], State] = {}
    for state in solution.states:
        key = state_label(state), round(state.cost, 4)
        if key not in best or _remaining_bad(state) < _remaining_bad(best[key]):
            best[key] = state
    counted = float(solution.before.state.areas.sum())
    values = [(label, _remaining_bad(state), cost) for (label, cost), state in best.items()]
    front = Front.of("cost", "cost", "", values)
    return tuple(
        PointPart(
            label=point.name,
            cost=point.against,
            bad_area_m2=state.bad,
            bad_share=state.bad / counted,
            lost=None if state.lost is None else float(state.lost.max()),
            on_front=point.dominated_by is None,
        )
        for point in front.points
        for state in [best[point.name, point.against]]
    )


def _remaining_bad(state: State) -> float:
    """Return what a state leaves of what is to be less: lost robots of trips, or bad floor."""
    return state.bad if state.lost is None else float(state.lost.max())


def _remarks(solution: Solution) -> tuple[str, ...]:
    remarks = list(solution.remarks)
    remarks += [
        f"{each.hardware.title}: cannot be used: {each.reason}"
        for each in solution.tried
        if each.bad is None and each.reason.endswith(".")
    ]
    if any(step.obstacle and step.obstacle.obstacle.reflective for step in solution.steps):
        remarks.append(REFLECTORS_WEIGH)
    if solution.steps:
        remarks.append("The search is greedy: what it found is not proven to be the best.")
    return tuple(remarks)


def _geojson(solution: Solution) -> dict[str, Any]:
    """Return the obstacles as GeoJSON, readable by the page of `ambinav serve`."""
    placed = [
        (step.obstacle, {"number": number, "cost": step.cost})
        for number, step in enumerate(solution.steps, start=1)
        if step.obstacle is not None
    ]
    return placed_geojson([obstacle for obstacle, _ in placed], [about for _, about in placed])
