"""Options of `ambinav plan`, in groups: search, cost, limits, belief, results.

Each group is a record with a `check` that refuses what cannot be used, before any map is opened,
and makes what planning takes. Those of the robot are in `robot_options`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli.checks import check_picture, check_replaced, check_suffix, conflict
from ambinav.cli.limits import above_zero, at_least, not_negative
from ambinav.cli.options import completing
from ambinav.cli.running import check_file, check_writable
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from ambinav.drive.noise import OdometryNoise
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.service.service import AmbiguityService

AUTO = "auto"
BELIEF = "is for the planners belief and belief-roadmap"
COMPLETE = "which is not random and searches to the end"


_complete_planner = completing(
    "ambinav_planners.registry", lambda registry: (AUTO, *registry.PLANNERS.names())
)


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Options on the planner and its time limit.

    Attributes:
        planner (NAME): Planner; see --list-planners. auto: reference for a disc in r2,
            informed-rrtstar in r3, prmstar otherwise and with --iterations.
        time (S): Time for planning, seconds; reference and belief take what they need.
        iterations (N): Largest number of iterations; --time ends them too, so give --time inf for
            a route that is the same each time. [default: no limit]
        seed (N): Seed of random numbers, of the planner and of drives, 0 or more. [default:
            different each time]
    """

    PANEL: ClassVar[str] = "Planner"

    planner: Annotated[str, typer.Option("--planner", "-p", autocompletion=_complete_planner)] = (
        AUTO
    )
    time: Annotated[float, typer.Option("--time", "-t")] = 1.0
    iterations: Annotated[int | None, at_least(1)] = None
    seed: Annotated[int | None, at_least(0)] = None
    improve: Annotated[
        bool, typer.Option(help="Shorten and smooth the route; its cost never rises.")
    ] = True

    @property
    def has_belief(self) -> bool:
        """True if the selected planner predicts the robot's uncertainty."""
        return self.planner.startswith("belief")

    def check(self) -> None:
        """Refuse an invalid time.

        Raises:
            InputError: the time is not above zero, or inf without a number of iterations.
        """
        if not (self.time == math.inf and self.iterations is not None):
            above_zero("1", "seconds").check(self.time, "--time")

    def budget(self, drives: bool) -> list[str]:
        """Return the given options that limit the planner's search.

        Args:
            drives: Whether the route is driven, which the seed is for too.
        """
        options = {
            "--time": self.time != SearchOptions.time,
            "--iterations": self.iterations is not None,
            "--seed": self.seed is not None and not drives,
        }
        return [option for option, is_given in options.items() if is_given]

    def check_budget(self, drives: bool) -> None:
        """Refuse limits that have no effect on the named planner.

        `auto` may choose a random planner or a deterministic one: its limits are for the former.

        Args:
            drives: See `budget`.

        Raises:
            InputError: there is no such planner, or an option has no effect on it.
        """
        limits = self.budget(drives)
        if not limits or self.planner == AUTO:
            return
        from ambinav_planners.registry import planner

        uses_budget = planner(self.planner).uses_budget
        reason = f"has no effect on the planner {self.planner}, {COMPLETE}"
        conflict(limits[0], not uses_budget, reason)

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of `RoutePlanner.plan`, `plan_mission`, `pareto` and `route_within`."""
        return {
            "planner_name": self.planner,
            "seconds": self.time,
            "iterations": self.iterations,
            "seed": self.seed,
            "improved": self.improve,
        }


@dataclass(frozen=True, kw_only=True)
class CostOptions:
    """Options on the cost per metre.

    Attributes:
        weight: Extra cost of a metre at level 1, in metres.
        layer (NAME): Layer from which the cost is computed. [default: as suits the map's scanner:
            position if its sensors differ, otherwise level]
        clearance_weight: Extra cost of a metre along a wall, in metres.
        comfort (M): Distance from which walls add no cost, metres.
        prefer (FILE): Polygons outside of which a metre costs more: .geojson or .wkt, in the map's
            frame. [default: none]
        outside_weight: Extra cost of a metre outside of --prefer, in metres. [default: 1.0]
    """

    PANEL: ClassVar[str] = "Cost"

    weight: Annotated[float, not_negative("5", "a number"), typer.Option("--weight", "-w")] = 5.0
    layer: str | None = None
    clearance_weight: Annotated[float, not_negative("1", "a number")] = 0.0
    comfort: Annotated[float, above_zero("0.5")] = 0.5
    prefer: Path | None = None
    outside_weight: Annotated[float | None, not_negative("1", "a number")] = None

    def check(self, search: SearchOptions) -> None:
        """Refuse options that have no effect together.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        if search.has_belief:
            reason = "is not part of the cost of the belief planners"
            conflict("--clearance-weight", self.clearance_weight != 0.0, reason)
            conflict("--prefer", self.prefer is not None, reason)
        if self.prefer is None:
            conflict("--outside-weight", self.outside_weight is not None, "is for --prefer")
        if self.clearance_weight == 0.0:
            is_given = self.comfort != CostOptions.comfort
            conflict("--comfort", is_given, "is for --clearance-weight")

    @property
    def adds_metres(self) -> bool:
        """True if the cost is more than the length even at a weight of 0."""
        return self.clearance_weight > 0.0 or self.prefer is not None

    @property
    def of_length(self) -> CostOptions:
        """The cost that is the length alone."""
        return replace(self, weight=0.0, clearance_weight=0.0, prefer=None, outside_weight=None)

    def service(self, amap: AmbiguityMap) -> AmbiguityService:
        """Return the cost service of a map.

        Raises:
            InputError: the file of polygons cannot be used.
        """
        from ambinav.service.service import AmbiguityService

        return AmbiguityService(
            amap,
            self.layer,
            self.weight,
            clearance_weight=self.clearance_weight,
            comfort=self.comfort,
            preferred=_polygons(self.prefer),
            outside_weight=1.0 if self.outside_weight is None else self.outside_weight,
        )


@dataclass(frozen=True, kw_only=True)
class LimitOptions:
    """Options that exclude floor from all routes.

    Attributes:
        avoid_open: Exclude the open zone from the route.
        keep_out (FILE): Polygons that the robot's centre keeps out of: .geojson or .wkt, in the
            map's frame. [default: none]
        one_way (FILE): Lanes that are driven in one direction only: .geojson, Polygons with
            direction (degrees) or LineStrings with width (metres). [default: none]
        max_bad_metres (M): Longest stretch allowed above --bad-level, metres. [default: no limit]
        bad_level: Level above which floor is bad, for --max-bad-metres.
    """

    PANEL: ClassVar[str] = "Limits"

    avoid_open: bool = False
    keep_out: Path | None = None
    one_way: Path | None = None
    max_bad_metres: Annotated[float | None, above_zero("5")] = None
    bad_level: Annotated[float, not_negative("0.5", "a level")] = 0.5

    def check(self, search: SearchOptions) -> None:
        """Refuse a level without the limit that it is for, and iterations on lanes.

        Raises:
            InputError: they are given.
        """
        level_alone = self.bad_level != 0.5 and self.max_bad_metres is None
        conflict("--bad-level", level_alone, "is for --max-bad-metres")
        conflict(
            "--iterations",
            search.iterations is not None and self.one_way is not None,
            f"has no effect on --one-way: lanes are for the planner reference, {COMPLETE}",
        )

    def arguments(self, amap: AmbiguityMap) -> dict[str, Any]:
        """Return the arguments of `RoutePlanner` about excluded floor of a map.

        Raises:
            InputError: a file of polygons or lanes cannot be used, or lies beside the map.
        """
        from ambinav_planners import OneWayLanes
        from ambinav_planners.problem import check_on_map

        keep_out = _polygons(self.keep_out)
        one_way = None if self.one_way is None else OneWayLanes.read(self.one_way)
        if keep_out is not None:
            check_on_map(amap, [keep_out], f"--keep-out: {self.keep_out}")
        if one_way is not None:
            check_on_map(amap, one_way.polygons, f"--one-way: {self.one_way}")
        return {
            "avoid_open": self.avoid_open,
            "keep_out": keep_out,
            "one_way": one_way,
            "max_bad_metres": self.max_bad_metres,
            "bad_level": self.bad_level,
        }


@dataclass(frozen=True, kw_only=True)
class BeliefOptions:
    """Options of the belief planners on the robot's uncertainty.

    Attributes:
        max_std (M): Largest standard deviation allowed for the position, metres. [default: no
            limit]
        start_std (M): Standard deviation of x and of y at the start, metres. [default: 0.1]
        odometry_scale: Scale of the odometry errors; 1: AMCL's default alphas. As `odometry: scale`
            of a comparison. [default: 0.25, or what --odometry says]
    """

    PANEL: ClassVar[str] = "Belief planners"

    max_std: Annotated[float | None, above_zero("0.5")] = None
    start_std: Annotated[float | None, not_negative("0.1", "a number")] = None
    odometry_scale: Annotated[float | None, not_negative("0.25", "a number")] = None

    def check(self, search: SearchOptions, odometry: str | None) -> None:
        """Refuse options for other planners, and a second odometry.

        Args:
            search: The planner.
            odometry: Name of the odometry of forecasts; None: it is not given.

        Raises:
            InputError: a value or a combination of options cannot be used, or the start alone
                breaks the limit.
        """
        conflict(
            "--odometry-scale", self.odometry_scale is not None and odometry is not None,
            "is an odometry, and --odometry another",
        )  # fmt: skip
        for option, value in (
            ("--max-std", self.max_std),
            ("--start-std", self.start_std),
            ("--odometry-scale", self.odometry_scale),
        ):
            conflict(option, value is not None and not search.has_belief, BELIEF)
        conflict(
            "--no-improve",
            search.has_belief and not search.improve,
            "has no effect on the belief planners, whose routes are never improved",
        )
        if self.max_std is not None:
            start = self.arguments(None)["belief"].std
            if start > self.max_std:
                raise InputError(
                    f"--max-std: {self.max_std:g} m is less than the deviation at the start, "
                    f"{start:g} m; give more, or a smaller --start-std."
                )

    def arguments(self, odometry: str | None) -> dict[str, Any]:
        """Return the arguments of `RoutePlanner` about the belief; see `check`."""
        from ambinav.drive.odometries import odometry_of
        from ambinav_planners.belief.model import BeliefModel

        model = BeliefModel(max_std=math.inf if self.max_std is None else self.max_std)
        if self.start_std is not None:
            std = (self.start_std, self.start_std, model.start_std[2])
            model = replace(model, start_std=std)
        noise = self._noise()
        if noise is None and odometry is not None:
            noise = odometry_of(odometry)
        return {"belief": model, "odometry": noise}

    def of_forecast(self, search: SearchOptions) -> dict[str, Any]:
        """Return what a forecast of the planner's route takes, as arguments of `Forecaster`."""
        if not search.has_belief:
            return {}
        start = self.arguments(None)["belief"].start_std
        arguments = {"odometry": self._noise(), "start_std": start}
        return {name: value for name, value in arguments.items() if value is not None}

    def odometry_text(self, default_name: str) -> str:
        """Return what to call the odometry, unless it is a named one."""
        scale = self.odometry_scale
        return default_name if scale is None else f"{scale:g} times amcl-default"

    def _noise(self) -> OdometryNoise | None:
        from ambinav.drive.noise import OdometryNoise

        return None if self.odometry_scale is None else OdometryNoise(scale=self.odometry_scale)


@dataclass(frozen=True, kw_only=True)
class ResultOptions:
    """Options on the planned routes and the output files.

    Attributes:
        shortest: Also plan the shortest route, and show both.
        picture (FILE): Draw the route on the floor map: .png, .pdf or .svg. [default: none]
        pareto: Plan routes for many weights; writes a table, routes and pictures.
        weights (LIST): Weights for --pareto. [default: 0 0.5 1 2 3 5 8 12 20]
        certify: Prove how far at most the route is from the cheapest one; takes some seconds, in r3
            more.
    """

    PANEL: ClassVar[str] = "Results"

    shortest: bool = False
    picture: Path | None = None
    pareto: bool = False
    weights: str | None = None
    certify: bool = False

    def check(self, cost: CostOptions, output: Path) -> None:
        """Refuse files that cannot be written, and options that contradict each other.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        if self.pareto:
            reason = "is for a single route, and --pareto plans for --weights"
            conflict("--shortest", self.shortest, "is the first route of --pareto")
            conflict("--certify", self.certify, "is for a single weight")
            conflict("--weight", cost.weight != CostOptions.weight, reason)
            conflict("--picture", self.picture is not None, "is what --pareto draws by itself")
            check_writable(output)
        else:
            conflict("--weights", self.weights is not None, "is for --pareto")
            from ambinav.export.registry import formats

            check_suffix(output, "--output", tuple(f".{name}" for name in formats("route")))
            check_file(output)
            check_replaced(output)
        check_picture(self.picture)


def _polygons(path: Path | None) -> BaseGeometry | None:
    """Return the area of a file's polygons; None: no file."""
    from ambinav.buildings.drawn_items import load_region

    return None if path is None else load_region(path)
