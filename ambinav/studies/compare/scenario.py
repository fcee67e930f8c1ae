"""A scenario: the configuration of a comparison."""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import Field, InstanceOf, model_validator

from ambinav.config import Positive, nearest, of_mapping
from ambinav.drive.localizer_spec import ChosenLocalizer, chosen_localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.people import People
from ambinav.drive.robot import Robot
from ambinav.export.registry import EXPORTERS
from ambinav.runtime.errors import InputError
from ambinav.sensing.building_file import BuildingPart
from ambinav.studies.compare.route_part import RoutePart
from ambinav.studies.compare.scenario_schema import (
    DrivePart,
    ExportsPart,
    MapPart,
    ObstaclesPart,
    PairPart,
    PlanningPart,
)

ALL_PAIRS: Final = "all pairs"
"""Name of the rows over all pairs."""


class Scenario(BuildingPart):
    """Contents of a scenario file; docs/compare.md describes every key."""

    name: str = Field(min_length=1)
    environment: str
    scanner: str | dict[str, Any]
    scanner_height: Positive | None = None
    map: MapPart = MapPart()
    robot: Annotated[InstanceOf[Robot], of_mapping(Robot)] = Robot()
    follower: Annotated[InstanceOf[FollowerParameters], of_mapping(FollowerParameters)] = (
        FollowerParameters()
    )
    odometry: Annotated[InstanceOf[OdometryNoise], of_mapping(OdometryNoise)] = OdometryNoise()
    people: Annotated[InstanceOf[People], of_mapping(People)] = People(0)
    obstacles: ObstaclesPart = ObstaclesPart()
    localizer: dict[str, Any] | str = Field(default_factory=dict)
    modules: tuple[str, ...] = ()
    planning: PlanningPart = PlanningPart()
    pairs: tuple[PairPart, ...] = Field(min_length=1)
    routes: tuple[RoutePart, ...] = Field(min_length=1)
    drive: DrivePart = DrivePart()
    exports: ExportsPart = ExportsPart()

    @model_validator(mode="after")
    def _check_parts(self) -> Scenario:
        """Check conditions that involve several parts of the scenario."""
        for name, parts in (("pairs", self.pairs), ("routes", self.routes)):
            names = [part.name for part in parts]
            for part_name in names:
                if names.count(part_name) > 1:
                    raise InputError(
                        f"{name}: {part_name!r} is given twice; give each a name of its own"
                    )
        self._check_pairs()
        try:
            self.chosen_localizer  # noqa: B018 - it checks the parameters
        except InputError as error:
            raise InputError(f"localizer: {str(error).removeprefix('localizer: ')}") from error
        self._check_exports()
        return self

    def _check_pairs(self) -> None:
        pairs = [pair.name for pair in self.pairs]
        if ALL_PAIRS in pairs:
            raise InputError(
                f"pairs: {ALL_PAIRS!r} is the name of the rows over all pairs; change it"
            )
        if self.planning.space != "r2":
            for i, pair in enumerate(self.pairs):
                for end in ("start", "goal"):
                    if len(getattr(pair, end)) == 2:
                        raise InputError(
                            f"pairs[{i}].{end} has no heading, which matters in the space "
                            f"{self.planning.space}; give x, y and degrees"
                        )
        for route in self.routes:
            if route.kind == "file" and route.pair is None and len(pairs) > 1:
                raise InputError(f"routes: {route.name!r} has no pair; add the key pair")
            if route.pair is not None and route.pair not in pairs:
                raise InputError(
                    f"routes: {route.name!r} is for the pair {route.pair!r}, which is not there; "
                    f"{nearest(route.pair, pairs)}"
                )
        for name in pairs:
            if all(route.pair not in (None, name) for route in self.routes):
                raise InputError(f"pairs: {name!r} has no route; add one, or drop the pair")

    def _check_exports(self) -> None:
        runs = self.exports.runs
        if isinstance(runs, int) and runs < 0:
            raise InputError(f"exports: runs is {runs}; give how many of each route, 0 or more")
        for number in self.exports.numbers:
            if not 0 <= number < self.drive.runs:
                raise InputError(
                    f"exports: there is no run {number + 1}; runs are counted from 1 to "
                    f"{self.drive.runs}"
                )
        prefix = "drive-"
        kinds = [name for name in EXPORTERS.names() if name.startswith(prefix)]
        formats = [kind.removeprefix(prefix) for kind in kinds]
        for name in self.exports.formats or ():
            if name not in formats:
                raise InputError(f"exports: there is no format {name!r}; {nearest(name, formats)}")
        names = [route.name for route in self.routes]
        for name in self.exports.routes or ():
            if name not in names:
                raise InputError(f"exports: there is no route {name!r}; {nearest(name, names)}")

    @property
    def chosen_localizer(self) -> ChosenLocalizer:
        """The localizer; missing alphas are those of the simulated odometry."""
        return chosen_localizer(self.localizer, self.odometry, self.robot, self.drive.rate)

    @property
    def baseline(self) -> str:
        """Name of the baseline route: the first of kind shortest, otherwise the first route."""
        for route in self.routes:
            if route.kind == "shortest":
                return route.name
        return self.routes[0].name
