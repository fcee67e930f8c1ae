"""The complete study of `ambinav design place`: candidates, effects, placement, quality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.casting.mesh.mesh import Mesh
from ambinav.config import check_generator, check_kind
from ambinav.geometry.collision.reach import Reach, check_reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.routes.files import trace_route
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Stages, silent_stages
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.aged import AgedPart, gains_in_aged
from ambinav.studies.design.place.candidates import Candidate, PlaceRules
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.place.exact import CoveragePart, OptimumPart, covered_most, enumerated
from ambinav.studies.design.place.greedy import NOTHING, Placement, Trials, place, try_alone
from ambinav.studies.design.place.map_setting import MapSetting
from ambinav.studies.design.place.moves import Moves
from ambinav.studies.design.place.positions import Positions, check_zones
from ambinav.studies.design.place.submodularity import Violations, measured
from ambinav.studies.design.region import Places, Region

SMALL: Final = {2: 10, 3: 6}
"""Number of candidates of which all pairs and triples are tried."""


@dataclass(frozen=True, eq=False)
class Remedy:
    """Obstacles that reduce bad floor, and the quality of their placement.

    Attributes:
        environment: The building as it is.
        scanner: The scanner.
        amap: Its ambiguity map.
        parts: Masks of the floor that counts.
        regions: Regions where bad floor counts.
        rules: Kind of the obstacles and rules for their positions.
        reach: Floor that the robot reaches.
        trials: The candidates, each alone.
        placement: The placed obstacles.
        violations: Test of submodularity; None: not measured.
        optima: Optima of small cases beside greedy; none where not asked for.
        coverage: Choice of maximum coverage; None: not requested, or no solver is installed.
        aged: What the obstacles remove in aged buildings; None: not requested.
    """

    environment: Environment
    scanner: RangeScanner
    amap: AmbiguityMap
    parts: JudgedFloor
    regions: tuple[Region, ...]
    rules: PlaceRules
    reach: Reach
    trials: Trials
    placement: Placement
    violations: Violations | None = None
    optima: tuple[OptimumPart, ...] = ()
    coverage: CoveragePart | None = None
    aged: AgedPart | None = None

    def __repr__(self) -> str:
        """Return building and obstacles as text."""
        return f"<Remedy of {self.environment.name!r}: {len(self.chosen)} {self.rules.kind}s>"

    @property
    def unit(self) -> str:
        """Unit of bad floor: "m2", or "m" for routes."""
        return self.regions[0].unit

    @property
    def chosen(self) -> tuple[Candidate, ...]:
        """The placed obstacles in order."""
        return tuple(placed.candidate for placed in self.placement.placed)

    @cached_property
    def after(self) -> AmbiguityMap:
        """Map of the building with the obstacles."""
        return self.amap.update(self.edited())

    def edited(self, count: int | None = None) -> Environment:
        """Return the building with the first `count` obstacles; None: with all."""
        return self.environment.edited(
            add=[candidate.obstacle for candidate in self.chosen[:count]]
        )


def checked_rules(
    environment: Environment, scanner: RangeScanner, rules: PlaceRules, count: int, reach: Reach,
    *, aged: int = 0, keep_out: BaseGeometry | None = None,
) -> PlaceRules:  # fmt: skip
    """Check what is asked for before the long work; return the rules in this building.

    Args and errors as of `place_obstacles`, as far as they need no map.
    """
    rules = rules.suited(environment)
    if count < 1:
        raise InputError(
            f"--{rules.kind}s: {count} is not a valid number of {rules.kind}s; give 1 or more."
        )
    if rules.kind == "tag" and not len(scanner.intensity_beams):
        raise InputError(
            f"--tags: scanner {scanner.name!r} measures no intensities and cannot distinguish a "
            "tag from its wall; give a scanner with an intensity channel, or --posts or --panels."
        )
    if aged and isinstance(environment.space, Mesh):
        raise InputError(
            f"--aged: {environment.name} is a mesh, whose walls and furniture are not known; leave "
            "this out."
        )
    check_passage(rules, reach)
    check_zones(keep_out, environment)
    return rules


def place_obstacles(
    environment: Environment,
    scanner: RangeScanner,
    amap: AmbiguityMap,
    rules: PlaceRules,
    count: int,
    reach: Reach,
    regions: Sequence[Region] = (),
    rng: np.random.Generator | None = None,
    stages: Stages = silent_stages,
    *,
    examine: bool = True,
    aged: int = 0,
    keep_out: BaseGeometry | None = None,
) -> Remedy:
    """Place `count` obstacles where they help most.

    Args:
        environment: The building.
        scanner: The scanner.
        amap: The map that `build_map` makes of both.
        rules: Kind of the obstacles and rules for their positions.
        count: How many.
        reach: Floor that the robot reaches.
        regions: Regions where bad floor counts, all of one unit; empty: the whole map.
        rng: Draws samples and aged buildings; None: nothing is examined.
        stages: Begins a stage by its name; what it returns is called with the share done.
        examine: Whether to test gains for submodularity and to look for the optimum of small cases.
        aged: Number of aged buildings in which to compute what the obstacles remove.
        keep_out: Polygons that no obstacle may touch; None: there are none.

    Raises:
        InputError: a tag for a scanner without an intensity channel, a passage narrower than the
            robot, no bad floor in the regions, fewer places than obstacles, aged buildings
            without `rng` or of a mesh, or see `PlaceRules.suited` and `Positions`.
    """
    check_reach(reach)
    check_kind(rules, PlaceRules, "rules")
    if rng is not None:
        check_generator(rng)
    rules = checked_rules(environment, scanner, rules, count, reach, aged=aged, keep_out=keep_out)
    regions = tuple(regions) or (Region.of_map(),)
    if aged and rng is None:
        raise InputError(f"aged: {aged} buildings cannot be drawn without rng; give a generator.")
    if len({region.unit for region in regions}) > 1:
        raise InputError(
            "--polygon: areas of floor and metres of routes cannot be added; give one of the two."
        )
    parts = amap.for_robot(reach).judged
    reflectors = rules.reflective or environment.has_reflectors
    setting = MapSetting.of(amap, scanner, reflectors)
    lattice, _ = setting.lattice(environment)
    places = _counted_places(regions, lattice, setting, parts)
    effects = Effects(environment, setting, places)
    bad = np.column_stack(lattice.points)[places.point[effects.bad]]
    lines = [
        shapely.LineString(trace_route(region.route)[:, :2])
        for region in regions
        if region.route is not None
    ]
    if reach.start is not None:
        lines.append(shapely.LineString([reach.start, reach.start]))
    positions = Positions(
        environment, rules, bad, scanner.max_range, reach.floor, lines, keep_out, reach.radius
    )
    allowed, step = positions.spread()
    if len(allowed) < count:
        raise InputError(
            f"--{rules.kind}s: {count} are requested, but there are only {len(allowed)} places for "
            "them; request fewer, or give a smaller --min-passage or more --candidates."
        )
    trials = try_alone(effects, allowed, stages(f"{len(allowed)} candidates"))
    moves = Moves({rules.kind: (positions, step)}, rules.min_passage)
    placement = place(effects, trials, count, rules.min_passage, moves, stages("placing"), NOTHING)
    if placement.crowded:
        raise InputError(
            f"--{rules.kind}s: {count} are requested, but only {len(placement.placed)} of the "
            f"{len(allowed)} places can be used with {rules.min_passage:g} m between them; request "
            "fewer, give a smaller --min-passage, or more --candidates."
        )
    remedy = Remedy(environment, scanner, amap, parts, regions, rules, reach, trials, placement)
    if rng is None:
        return remedy
    # The aged buildings are the same with samples and without.
    for_samples, for_buildings = rng.spawn(2)
    if examine:
        remedy = _examine(remedy, effects, for_samples, stages)
    if aged and placement.placed:
        obstacles = tuple(candidate.obstacle for candidate in remedy.chosen)
        progress = stages(f"{aged} aged buildings")
        gains = gains_in_aged(effects, obstacles, aged, rules.min_passage, for_buildings, progress)
        remedy = replace(remedy, aged=gains)
    return remedy


def check_passage(rules: PlaceRules, reach: Reach) -> None:
    """Check that the robot fits through the passages that stay free.

    Raises:
        InputError: it does not.
    """
    if rules.min_passage < 2.0 * reach.radius:
        raise InputError(
            f"--min-passage: {rules.min_passage:g} m is less than the robot's width of "
            f"{2.0 * reach.radius:g} m, so it might be shut in; give more."
        )


def _examine(remedy: Remedy, effects: Effects, rng: np.random.Generator, stages: Stages) -> Remedy:
    """Return the study with a test of submodularity and comparisons with optima."""
    trials, passage = remedy.trials, remedy.rules.min_passage
    optima = [
        enumerated(effects, trials, trials.order[:most].tolist(), size, passage, stages(title))
        for (size, most), title in zip(SMALL.items(), ("pairs", "triples"), strict=True)
    ]
    coverage = None
    if find_spec("ortools") is not None and remedy.placement.placed:
        unmoved = place(effects, trials, len(remedy.placement.placed), passage).placed
        greedy = [trials.candidates.index(placed.candidate) for placed in unmoved]
        coverage = covered_most(effects, trials, len(greedy), passage, greedy)
    return replace(
        remedy,
        violations=measured(effects, trials, passage, rng, stages("samples of gains")),
        optima=tuple(optimum for optimum in optima if optimum is not None),
        coverage=coverage,
    )


def _counted_places(
    regions: Sequence[Region], lattice: Lattice, setting: MapSetting, parts: JudgedFloor
) -> Places:
    """Return the places that count: on routes all of them, otherwise explored and reached floor."""
    region_places = [region.places(lattice, setting.headings) for region in regions]
    joined = Places(
        np.concatenate([places.point for places in region_places]),
        np.concatenate([places.heading for places in region_places]),
        np.concatenate([places.weight for places in region_places]),
        sum(places.of for places in region_places),
    )
    if regions[0].unit == "m":
        return joined
    counted = joined.among(parts.counted[lattice.free][joined.point])
    if not len(counted):
        raise InputError(
            f"region {regions[0].title}: none of its floor is explored and reached by the robot; "
            "draw it elsewhere, or give --start or a smaller --robot-radius."
        )
    return counted
