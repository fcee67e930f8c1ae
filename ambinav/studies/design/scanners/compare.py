"""Comparison of scanners in a building: bad area, routes, costs, Pareto fronts."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from ambinav.config import check_generator
from ambinav.geometry.collision.reach import Reach, find_reach
from ambinav.geometry.environment import Environment
from ambinav.layers.registry import chosen_layers
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import BAD, CORRIDOR, OPEN, ZoneShare
from ambinav.reports.fields import Part
from ambinav.routes.route import Route
from ambinav.routes.sampled import sample_routes
from ambinav.runtime.array_types import Bools, Bytes
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent, step_of, within
from ambinav.sensing.robot_radius import common_robot_radius
from ambinav.sensing.scanner import RangeScanner
from ambinav.store.map_store import MapStore
from ambinav.studies.design.scanners.costs import Cost, Costs
from ambinav.studies.design.scanners.fronts import Front
from ambinav.studies.design.scanners.mounting import HEIGHT, mounted_in
from ambinav.studies.design.scanners.route_figures import (
    ErrorModel,
    RouteFigures,
    check_routes,
    route_figures,
)

Shares = tuple[ZoneShare, ...]

PAIRS = 20
"""Routes that are sampled where none are given."""
_ROUTES_SHARE = 0.1
"""Share of the reported progress for routes."""


class LayerPart(Part):
    """The mean of an added layer over the floor that counts."""

    title: str
    unit: str
    worse: str = Field(description="which end means badly localized: high or low")
    mean: float | None = Field(description="null: it has no value there")


class UnusablePart(Part):
    """A scanner without figures, and the reason."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class ScannerRow:
    """One scanner's figures.

    Attributes:
        scanner: The scanner.
        parts: Masks of the floor that counts: explored by this scanner, and reached by the robot.
        zone: uint8, shape (ny, nx): zone of each cell, over all headings where they matter.
        shares: Area and share of each zone of the floor that counts, in the order of ZONES.
        best: The same with the robot at the best heading of every place; None where the heading
            does not matter.
        worst: The same at the worst heading.
        headings: Number of headings of the map; None where the heading does not matter.
        routes: Figures of the routes; None where there are none.
        layers: Means of the layers that were asked for besides, by name.
        lacking: Layers that the scanner cannot have, and why.
        cost: What it costs.
        build_seconds: Time that its map took; None where it was opened from the store.
    """

    scanner: RangeScanner
    parts: JudgedFloor
    zone: Bytes
    shares: Shares
    best: Shares | None
    worst: Shares | None
    headings: int | None
    routes: RouteFigures | None
    layers: Mapping[str, LayerPart]
    lacking: Mapping[str, str]
    cost: Cost
    build_seconds: float | None

    @property
    def name(self) -> str:
        """Name of the scanner."""
        return self.scanner.name

    @property
    def counted_area(self) -> float:
        """Explored floor that the robot reaches, square metres."""
        return self.parts.area(self.parts.counted)

    @property
    def bad_area(self) -> float:
        """Corridor and open zones of the floor that counts, square metres."""
        return bad_area(self.shares)


@dataclass(frozen=True, eq=False)
class ScannerTable:
    """Table of the compared scanners.

    Attributes:
        environment: The building.
        reach: Floor that the robot reaches, the same for all.
        rows: Scanners by rising bad area, then expected error, then name.
        unusable: Scanners without figures, by name.
        routes: Routes on which all were measured; may be empty.
        model: Model of the expected error on them.
        sampled: Whether nobody gave the routes.
        fronts: Fronts by price and power where given, beams, range, expected error.
        amap: The map of one of them, for the walls in pictures.
        remarks: Remarks for the reader, in sentences.
    """

    environment: Environment
    reach: Reach
    rows: tuple[ScannerRow, ...]
    unusable: tuple[UnusablePart, ...]
    routes: tuple[Route, ...]
    model: ErrorModel
    sampled: bool
    fronts: tuple[Front, ...]
    amap: AmbiguityMap
    remarks: tuple[str, ...]

    @property
    def common(self) -> Bools:
        """Cells that count for every scanner of `rows`, shape (ny, nx)."""
        return np.asarray(np.logical_and.reduce([row.parts.counted for row in self.rows]))

    def common_bad_area(self, row: ScannerRow) -> float:
        """Return a scanner's bad area on the floor that counts for all scanners, square metres."""
        bad = self.common & np.isin(row.zone, BAD)
        return row.parts.area(bad)

    @property
    def front(self) -> Front | None:
        """Front marked in the table: by price, else power, else beams; None without floor."""
        return self.fronts[0] if self.fronts else None


def bad_area(shares: Shares) -> float:
    """Compute the area of the zones in which a robot gets lost, square metres."""
    return shares[CORRIDOR].area + shares[OPEN].area


def compare_scanners(
    environment: Environment,
    scanners: Iterable[RangeScanner | str | Path],
    *,
    spacing: float = 0.1,
    radius: float = 0.5,
    headings: int | None = None,
    map_std: float | None = None,
    layers: Iterable[str] = (),
    robot_radius: float | None = None,
    start: Sequence[float] | None = None,
    routes: Sequence[tuple[str, Route]] | None = None,
    pairs: int = PAIRS,
    rng: np.random.Generator | None = None,
    model: ErrorModel | None = None,
    costs: Costs | None = None,
    height: float = HEIGHT,
    store: bool | MapStore = True,
    progress: Progress = silent,
) -> ScannerTable:
    """Compare scanners in a building on the same floor and the same routes.

    The order of the scanners plays no part. One that is given twice counts once.

    Args:
        environment: The building.
        scanners: Scanners, names of presets, or scanner files; at least one.
        spacing: Spacing of the maps, metres; this and the next four as in `build_map`.
        radius: Radius of the neighbourhood of each pose, metres.
        headings: Number of headings of the maps.
        map_std: Standard deviation of the walls' position, metres; the localizer has it too.
        layers: Further layers, whose means are reported. Layers that a scanner does not support are
            left out and said.
        robot_radius: Radius of the robot that carries each of them, metres; None: the largest of
            the scanners' own (0.2 m of one that has none).
        start: x and y of a place that the robot sets out from, as in `find_reach`.
        routes: Routes, each with the name that messages call it by; None: they are sampled.
        pairs: Number of sampled pairs; 0: no figures of routes.
        rng: Draws their ends; None: a generator of seed 0.
        model: Odometry and localizer of the expected error; None: the defaults.
        costs: Price and power, by name.
        height: At which scanners are mounted that say none, in a building in space, metres.
        store: As in `build_map`.
        progress: Called with the share done.

    Raises:
        InputError: an argument cannot be used, two different scanners have one name, or no
            scanner can be used, with the reason of the first.
    """
    chosen, remarks = mounted_in(environment, distinct(scanners), height)
    names = (layers,) if isinstance(layers, str) else tuple(layers)
    chosen_layers(names, None)
    if rng is not None:
        check_generator(rng)
    if pairs < 0:
        raise InputError(f"pairs: {pairs} is negative; give 0 or more.")
    if costs is not None:
        remarks += costs.remarks(scanner.name for scanner in chosen)
    model = model or ErrorModel()
    if robot_radius is None:
        robot_radius = common_robot_radius(chosen)
    reach = find_reach(environment, robot_radius, start)
    driven: tuple[Route, ...] = ()
    if routes is not None:
        driven = check_routes(environment, reach.radius, routes)
    elif pairs:
        driven = sample_routes(environment, reach, pairs, rng or np.random.default_rng(0))
    rows: list[ScannerRow] = []
    unusable: list[UnusablePart] = []
    reasons: list[InputError] = []
    amap: AmbiguityMap | None = None
    for done, scanner in enumerate(chosen):
        part = step_of(progress, done, len(chosen))
        able, lacking = _layers_of(names, scanner, environment)
        try:
            made, seconds = _timed_map(
                environment, scanner, store, part, spacing=spacing, radius=radius,
                headings=headings, map_std=map_std, layers=able,
            )  # fmt: skip
            made = made.for_robot(reach)
            parts = made.judged
            parts.check_reached(made.spacing)
        except InputError as error:
            unusable.append(UnusablePart(name=scanner.name, reason=str(error)))
            reasons.append(error)
            continue
        amap = amap or made
        rows.append(
            ScannerRow(
                scanner=scanner,
                parts=parts,
                zone=made.floor("zone", "mean").values,
                shares=made.zone_shares("mean", parts.counted),
                best=made.zone_shares("best", parts.counted) if made.has_theta else None,
                worst=made.zone_shares("worst", parts.counted) if made.has_theta else None,
                headings=made.dataset.sizes.get("theta"),
                routes=route_figures(made, environment, scanner, driven, model, map_std)
                if driven
                else None,
                layers=_layer_means(made, parts, able),
                lacking=lacking,
                cost=costs.of(scanner.name) if costs is not None else Cost(),
                build_seconds=seconds,
            )
        )
        part(1.0)
    if amap is None:
        raise reasons[0]
    rows.sort(key=_sort_key)
    table = ScannerTable(
        environment=environment,
        reach=reach,
        rows=tuple(rows),
        unusable=tuple(unusable),
        routes=driven,
        model=model,
        sampled=routes is None,
        fronts=_fronts(rows),
        amap=amap,
        remarks=remarks,
    )
    return replace(table, remarks=(*remarks, *_remarks(table)))


def distinct(scanners: Iterable[RangeScanner | str | Path]) -> tuple[RangeScanner, ...]:
    """Load scanners by name, each once.

    Raises:
        InputError: there is none, one cannot be loaded, or two different ones have one name.
    """
    by_name: dict[str, RangeScanner] = {}
    for named in scanners:
        scanner = named if isinstance(named, RangeScanner) else RangeScanner.load(named)
        if by_name.setdefault(scanner.name, scanner) != scanner:
            raise InputError(
                f"scanner {scanner.name!r}: two different scanners have this name; give each its "
                "own `name` in its file."
            )
    if not by_name:
        raise InputError("scanners: none is given; name one or more, e.g. rplidar-a1.")
    return tuple(by_name[name] for name in sorted(by_name))


def _sort_key(row: ScannerRow) -> tuple[float, float, str]:
    """Return the sort key of a row: bad area, then expected error, then name."""
    return row.bad_area, 0.0 if row.routes is None else row.routes.mean_error, row.name


def _layers_of(
    names: tuple[str, ...], scanner: RangeScanner, environment: Environment
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the named layers that a scanner supports, and the reasons for the others."""
    able: list[str] = []
    lacking: dict[str, str] = {}
    for name in names:
        try:
            able += (layer.name for layer in chosen_layers(name, scanner, environment))
        except InputError as error:
            lacking[name] = str(error)
    return tuple(dict.fromkeys(able)), lacking


def _timed_map(
    environment: Environment,
    scanner: RangeScanner,
    store: bool | MapStore,
    progress: Progress,
    *,
    spacing: float,
    radius: float,
    headings: int | None,
    map_std: float | None,
    layers: tuple[str, ...],
) -> tuple[AmbiguityMap, float | None]:
    """Return the map and the seconds to build it; None seconds if it was opened from the store."""
    began: list[float] = []
    map_store = MapStore.of_user() if store is True else store or MapStore(None)

    def before() -> None:
        if map_store.before_build is not None:
            map_store.before_build()
        began.append(time.perf_counter())

    amap = build_map(
        environment, scanner, spacing, radius, headings, map_std,
        progress=within(progress, 0.0, 1.0 - _ROUTES_SHARE), layers=layers,
        store=replace(map_store, before_build=before),
    )  # fmt: skip
    return amap, time.perf_counter() - began[0] if began else None


def _layer_means(
    amap: AmbiguityMap, parts: JudgedFloor, names: Iterable[str]
) -> dict[str, LayerPart]:
    means = {}
    for name in names:
        values = np.asarray(amap.floor(name, "mean").values, dtype=np.float64)[parts.counted]
        finite = values[np.isfinite(values)]
        attrs = amap.dataset[name].attrs
        means[name] = LayerPart(
            title=str(attrs.get("long_name", name)),
            unit=str(attrs.get("units", "")),
            worse=str(attrs.get("worse", "")),
            mean=float(finite.mean()) if finite.size else None,
        )
    return means


def _fronts(rows: Sequence[ScannerRow]) -> tuple[Front, ...]:
    """Return the fronts of scanners that have floor that counts.

    A scanner without such floor has no bad floor either, and must not lead a front.
    """
    figures: tuple[tuple[str, str, str, Callable[[ScannerRow], float | None]], ...] = (
        ("price", "price", "", lambda row: row.cost.price),
        ("power", "power", "W", lambda row: row.cost.power),
        ("beams", "beams of a scan", "", lambda row: float(row.scanner.beams)),
        ("range", "range", "m", lambda row: row.scanner.max_range),
        ("error", "expected error on routes", "m",
         lambda row: None if row.routes is None else row.routes.mean_error),
    )  # fmt: skip
    fronts = []
    for key, title, unit, read in figures:
        values = [
            (row.name, row.bad_area, value)
            for row in rows
            if row.parts.counted.any() and (value := read(row)) is not None
        ]
        if values:
            fronts.append(Front.of(key, title, unit, values))
    return tuple(fronts)


def _remarks(table: ScannerTable) -> tuple[str, ...]:
    remarks = []
    areas = [row.counted_area for row in table.rows]
    if min(areas) < 0.995 * max(areas):
        remarks.append(
            f"The floor that counts differs, from {min(areas):,.1f} to {max(areas):,.1f} m²: what "
            "is explored, and where the sensors have room, depends on the scanner. Compare the bad "
            "area on the floor that counts for all."
        )
    nothing = [row.name for row in table.rows if not row.parts.counted.any()]
    if nothing:
        remarks.append(
            f"No floor is explored for {', '.join(nothing)}: half of the beams or more end in "
            "unknown space everywhere, so these are in no front."
        )
    return tuple(remarks)
