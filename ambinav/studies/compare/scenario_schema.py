"""The parts of a scenario file and their checks."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, Field, PlainSerializer, model_validator

from ambinav.config import ConfigModel, Positive, as_degrees, nearest
from ambinav.geometry.motion.steering import KINDS, Steering
from ambinav.runtime.errors import InputError

Metres = Annotated[float, Field(gt=0.0)]


def _point(place: tuple[float, ...]) -> tuple[float, ...]:
    """Check a point (x, y, perhaps heading) and convert its heading from degrees to radians."""
    if len(place) not in (2, 3):
        raise InputError("give x and y in metres, and a heading in degrees if it matters")
    return (*place[:2], *map(math.radians, place[2:]))


def _written(place: tuple[float, ...]) -> list[float]:
    return [*place[:2], *map(as_degrees, place[2:])]


Point = Annotated[tuple[float, ...], AfterValidator(_point), PlainSerializer(_written)]
"""x and y in metres, perhaps a heading: degrees in files and reports, radians in the program."""


class MapPart(ConfigModel):
    """Parameters of the ambiguity map; see `ambinav map`."""

    spacing: float = Field(default=0.1, gt=0.0)
    radius: float = Field(default=0.5, gt=0.0)
    headings: int | None = Field(default=None, ge=1)
    map_std: float | None = Field(default=None, ge=0.0)
    layer: str | None = None

    @model_validator(mode="after")
    def _has_neighbours(self) -> MapPart:
        if self.radius < self.spacing:
            raise InputError(
                f"radius is {self.radius:g} m and spacing {self.spacing:g} m; give a radius of at "
                "least one spacing"
            )
        return self


class PlanningPart(ConfigModel):
    """Parameters common to all planned routes.

    Attributes:
        space: Motion model of the robot; see `Steering`.
        turning_radius: Turning radius of a car, metres; for dubins and reeds-shepp only.
        planner: Planner of the kinds clearance and ambiguity; auto: as `ambinav plan` chooses. What
            all others are compared with, the kind shortest, is found by the planner reference in
            the space r2, unless the route names another: samples may miss it.
        iterations: Iterations of planners that sample; None: 1000. There is no limit of time, so
            that the route is always the same.
        seed: Seed of the planner.
        margin: Metres that routes keep off walls in addition to the robot's radius.
    """

    space: str = "r2"
    turning_radius: float = Field(default=0.0, ge=0.0)
    planner: str = "auto"
    iterations: int | None = Field(default=None, ge=1)
    seed: int = Field(default=1, ge=0, lt=2**32 - 1)
    margin: float = Field(default=0.1, ge=0.0)

    @model_validator(mode="after")
    def _moves(self) -> PlanningPart:
        if self.space not in KINDS:
            raise InputError(f"space is {self.space!r}; {nearest(self.space, KINDS)}")
        if self.space in CURVED and not self.turning_radius:
            raise InputError(
                f"turning_radius is missing, which the space {self.space} needs; give metres "
                "above 0"
            )
        if self.space not in CURVED and self.turning_radius:
            raise InputError(
                f"turning_radius does not apply to the space {self.space}; remove it, or choose "
                f"{' or '.join(CURVED)}"
            )
        return self

    @property
    def steering(self) -> Steering:
        """Steering model of the robot."""
        return Steering(self.space, self.turning_radius)


CURVED = ("dubins", "reeds-shepp")
"""Spaces that need a turning radius."""


class PairPart(ConfigModel):
    """A start and a goal: x, y in metres and, if it matters, a heading.

    The heading is in radians; in a scenario file and in reports it is in degrees.
    """

    name: str = Field(min_length=1)
    start: Point
    goal: Point

    @model_validator(mode="after")
    def _apart(self) -> PairPart:
        if self.start[:2] == self.goal[:2]:
            raise InputError("start and goal are the same point; give two")
        return self


class ObstaclesPart(ConfigModel):
    """Boxes that exist in the building but not in the map; see `ambinav.drive.clutter`.

    Attributes:
        count: How many.
        sizes: Least and greatest edge, metres.
        seed: Seed of their places. A pair has the same boxes on all of its routes, in every run.
        margin: Metres between a box and the robot where it is on one of the pair's routes.
    """

    count: int = Field(default=0, ge=0)
    sizes: tuple[Metres, Metres] = (0.3, 0.8)
    seed: int = Field(default=1, ge=0)
    margin: float = Field(default=0.4, ge=0.0)

    @model_validator(mode="after")
    def _ordered(self) -> ObstaclesPart:
        if self.sizes[0] > self.sizes[1]:
            raise InputError(f"sizes is {list(self.sizes)}; give the smallest edge first")
        return self


class DrivePart(ConfigModel):
    """Parameters of the drives: their number and settings; see `drive_route`.

    Attributes:
        start_std: Deviations of x and y of the first estimate, metres.
        start_heading_std_deg: Deviation of its heading, degrees.
    """

    runs: int = Field(default=30, ge=1)
    seed: int = Field(default=1, ge=0)
    open_loop: bool = False
    rate: float = Field(default=10.0, gt=0.0)
    start_std: tuple[Positive, Positive] = (0.05, 0.05)
    start_heading_std_deg: float = Field(default=math.degrees(0.02), gt=0.0)
    max_time: float | None = Field(default=None, gt=0.0)

    @property
    def start_deviations(self) -> tuple[float, float, float]:
        """Standard deviations of the first estimate: x and y in metres, heading in radians."""
        return (*self.start_std, math.radians(self.start_heading_std_deg))


class ExportsPart(ConfigModel):
    """Drives to write for other programs.

    Attributes:
        runs: How many of each route, from the first on; or their numbers, counted from 1.
        routes: Names of the routes; None: all.
        formats: Names of formats (`export.registry.formats("drive")`); None: our own three.
    """

    runs: int | tuple[int, ...] = 0
    routes: tuple[str, ...] | None = None
    formats: tuple[str, ...] | None = None

    @property
    def numbers(self) -> tuple[int, ...]:
        """Indices of the runs to export, counted from 0."""
        if isinstance(self.runs, int):
            return tuple(range(self.runs))
        return tuple(sorted({number - 1 for number in self.runs}))
