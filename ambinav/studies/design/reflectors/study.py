"""The complete study of `ambinav design reflectors`: judge a layout, and complete it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import NoneType
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.casting.scans import plane_only
from ambinav.config import check_kind
from ambinav.geometry.collision.reach import Reach, check_reach
from ambinav.geometry.environment import Environment
from ambinav.layers.context import LayerContext
from ambinav.layers.reflectors.positioning import Positioning, Site
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules, why_no_reflectors
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.array_types import Bools, Bytes
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Stages, silent_stages
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.candidates import Candidate, PlaceRules
from ambinav.studies.design.place.positions import Positions, check_zones
from ambinav.studies.design.place.study import check_passage
from ambinav.studies.design.reflectors.search import Search

COARSE: Final = 0.3
"""Places are searched for by the floor at points so far apart at most, metres."""
MOST_VIEWS: Final = 2e9
"""Views of candidates, one byte each, that are held in memory at most."""


@dataclass(frozen=True)
class Coverage:
    """Floor on which a robot can navigate by reflectors, square metres.

    Attributes:
        floor: All floor that counts.
        enough: Where enough reflectors are in view.
        unique: Where no other pose is aliased with these.
        good: Where they fix the position precisely enough, too.
        std: Median standard deviation of the position where enough are in view, metres; nan: no
            such floor.
    """

    floor: float
    enough: float
    unique: float
    good: float
    std: float

    @classmethod
    def of(cls, positioning: Positioning, counted: Bools, area: float) -> Coverage:
        """Sum up over the points that count, shape (P,), of a lattice with cells of this area."""
        enough = counted & positioning.enough
        stds = positioning.std.max(axis=1)[enough]
        return cls(
            float(counted.sum() * area),
            float(enough.sum() * area),
            float((enough & positioning.unique).sum() * area),
            float((counted & positioning.good).sum() * area),
            float(np.median(stds)) if len(stds) else float("nan"),
        )


@dataclass(frozen=True, eq=False)
class ReflectorStep:
    """A reflector that is put up.

    Attributes:
        candidate: The reflector.
        after: Coverage with it and those before it.
    """

    candidate: Candidate
    after: Coverage


@dataclass(frozen=True, eq=False)
class ReflectorLayout:
    """A layout of reflectors, and what a robot can do with it.

    Attributes:
        environment: The building as it is.
        scanner: The scanner.
        amap: A map of both: its cells are the places.
        parts: Masks of the floor that counts.
        rules: What the robot needs.
        positions: Kind of the new reflectors and rules for their positions; None: none is asked
            for.
        reach: Floor that the robot reaches.
        present: Number of reflectors that the building has.
        tried: Number of candidates.
        steps: New reflectors in order.
        before: Coverage by the present reflectors.
        after: Coverage of the changed building, computed anew.
        maps: Where it can navigate, why not elsewhere, before and after: see `states`.
    """

    environment: Environment
    scanner: RangeScanner
    amap: AmbiguityMap
    parts: JudgedFloor
    rules: ReflectorRules
    positions: PlaceRules | None
    reach: Reach
    present: int
    tried: int
    steps: tuple[ReflectorStep, ...]
    before: Coverage
    after: Coverage
    maps: tuple[Bytes, Bytes]

    @property
    def chosen(self) -> tuple[Candidate, ...]:
        """The new reflectors in order."""
        return tuple(step.candidate for step in self.steps)

    def edited(self) -> Environment:
        """Return the building with the new reflectors."""
        return self.environment.edited(add=[candidate.obstacle for candidate in self.chosen])


GOOD, IMPRECISE, ALIASED, FEW = range(4)
STATES = ("navigates", "imprecise", "aliased", "too few in view")
"""States of floor, in the order of their numbers."""


def states(positioning: Positioning, free: Bools) -> Bytes:
    """Return the state of each cell, uint8, shape (ny, nx); `NOT_FREE` where none is free."""
    picture = np.full(free.shape, NOT_FREE, dtype=np.uint8)
    state = np.where(positioning.precise, GOOD, IMPRECISE)
    state = np.where(positioning.unique, state, ALIASED)
    picture[free] = np.where(positioning.enough, state, FEW)
    return picture


def check_reflectors(
    environment: Environment, scanner: RangeScanner, reach: Reach, positions: PlaceRules | None,
    keep_out: BaseGeometry | None,
) -> None:  # fmt: skip
    """Check what is asked for before the long work.

    Args and errors as of `plan_reflectors`, as far as they need no map.
    """
    plane_only(environment, "navigation by reflectors")
    reason = why_no_reflectors(scanner)
    if reason is not None:
        raise InputError(f"scanner {scanner.name!r} recognises no reflectors: {reason}")
    if positions is not None:
        check_passage(positions.suited(environment), reach)
    check_zones(keep_out, environment)


def plan_reflectors(
    environment: Environment,
    scanner: RangeScanner,
    amap: AmbiguityMap,
    reach: Reach,
    rules: ReflectorRules | None = None,
    positions: PlaceRules | None = None,
    count: int = 0,
    *,
    keep_out: BaseGeometry | None = None,
    stages: Stages = silent_stages,
) -> ReflectorLayout:
    """Judge the reflectors of a building, and place more so that a robot navigates by them.

    Args:
        environment: The building.
        scanner: The scanner; its intensities distinguish reflectors from walls.
        amap: A map of both: its cells are the places.
        reach: Floor that the robot reaches.
        rules: What the robot needs; None: the defaults.
        positions: Kind of the new reflectors and rules for their positions; None: none is placed.
            They reflect in any case.
        count: How many are placed at most.
        keep_out: Polygons that none of them may touch; None: there are none.
        stages: Begins a stage by its name; what it returns is called with the share done.

    Raises:
        InputError: a building in space, a scanner without intensities, a passage narrower than the
            robot, no floor that counts, too many places for the memory, or see `Positions`.
    """
    check_reach(reach)
    check_kind(rules, (ReflectorRules, NoneType), "rules")
    if count < 0:
        raise InputError(f"count: {count} is negative; give 0 or more.")
    check_reflectors(environment, scanner, reach, positions, keep_out)
    rules = rules or ReflectorRules()
    context = LayerContext.of(amap, environment, scanner)
    site = Site.of(context, rules)
    parts = amap.for_robot(reach).judged
    counted = parts.counted[context.free]
    if not counted.any():
        raise InputError(
            f"{environment.name}: none of the floor is explored and reached by the robot; give "
            "--start or a smaller --robot-radius."
        )
    present = Targets.of(environment)
    first = site.positioning(present, site.views(present))
    before = Coverage.of(first, counted, amap.cell_area)
    layout = ReflectorLayout(
        environment, scanner, amap, parts, rules, positions, reach, len(present), 0, (), before,
        before, (states(first, context.free),) * 2,
    )  # fmt: skip
    wanting = counted & ~first.good
    if positions is None or not count or not wanting.any():
        return layout
    # What is placed here reflects, whatever else the same rules are used for.
    positions = replace(positions, reflective=True)
    candidates = _candidates(site, positions, wanting, reach, keep_out)
    coarse, coarse_poses = site.coarser(COARSE)
    _check_memory(coarse, len(candidates))
    # Reflectors on walls narrow nothing; nearer than this two could not be distinguished.
    separation = 4.0 * rules.tolerance if positions.kind == "tag" else positions.min_passage
    search = Search(coarse, counted[coarse_poses], present, candidates, separation)
    order = search.place(count, stages(f"{len(candidates)} places"))
    chosen = tuple(candidates[k] for k in order)
    # New reflectors hide each other and what is behind them: only the changed building shows it.
    outlines = [candidate.obstacle.outline for candidate in chosen]
    targets = present.and_of(Targets.of_outlines(outlines))
    edited = environment.edited(add=[candidate.obstacle for candidate in chosen])
    changed = replace(site, environment=edited)
    seen = changed.views(targets)
    steps, last = [], first
    for number, candidate in enumerate(chosen, start=len(present) + 1):
        last = changed.positioning(targets.among(np.arange(number)), seen[:, :, :number])
        steps.append(ReflectorStep(candidate, Coverage.of(last, counted, amap.cell_area)))
    return replace(
        layout,
        tried=len(candidates),
        steps=tuple(steps),
        after=steps[-1].after if steps else before,
        maps=(layout.maps[0], states(last, context.free)),
    )


def _candidates(
    site: Site, positions: PlaceRules, wanting: Bools, reach: Reach, keep_out: BaseGeometry | None
) -> tuple[Candidate, ...]:
    """Return places within range of floor where the robot cannot navigate yet."""
    points = np.column_stack(site.lattice.points)[wanting]
    far = site.rules.max_range or site.scanner.max_range
    stops = [] if reach.start is None else [shapely.LineString([reach.start, reach.start])]
    allowed = Positions(
        site.environment, positions, points, far, reach.floor, stops, keep_out, reach.radius
    )
    return allowed.spread_evenly(positions.most)[0]


def _check_memory(site: Site, candidates: int) -> None:
    size = float(site.possible.size) * candidates
    if size > MOST_VIEWS:
        raise InputError(
            f"--candidates: the views of {candidates} places from {site.possible.size:,} poses "
            f"take {size / 1e9:.0f} GB; give fewer."
        )
