"""Models of the JSON answers: metres, radians, the map's frame."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field
from pydantic_core import to_json
from starlette.responses import Response

Reason = Literal["outside", "wall", "unknown"]
Motion = Literal["r2", "se2", "dubins", "reeds-shepp"]


class Layer(BaseModel):
    """A layer of a map."""

    name: str = Field(description="Name of the layer in requests")
    long_name: str = Field(description="Meaning of the layer")
    units: str = Field(description="Unit: m, rad, 1 ...")
    worse: Literal["high", "low"] | None = Field(
        description="The end of the scale that means bad localization"
    )
    kind: Literal["amount", "share", "axis", "angle", "zone", "flag"] = Field(
        description="share: from 0 to 1; axis: an angle of period pi; zone: a class; flag: 0 or 1"
    )
    has_theta: bool = Field(description="True if it depends on the heading")


class MapInfo(BaseModel):
    """Summary of a map."""

    id: str = Field(description="Id of the map in addresses")
    digest: str = Field(description="Digest of the map's content; `ETag` and `If-Match` have it")
    name: str = Field(description="Name for display")
    environment: str = Field(description="The building")
    scanner: str = Field(description="The scanner that the map is for")
    bounds: tuple[float, float, float, float] = Field(
        description="x0, y0, x1, y1: outer edges of the lattice, metres"
    )
    in_space: bool = Field(description="Whether the building, and obstacles in it, have heights")
    spacing: float = Field(description="Distance between cell centres, metres")
    shape: tuple[int, int] = Field(description="Rows (along y) and columns (along x)")
    headings: int | None = Field(
        description="Number of headings; null: the map does not depend on the heading"
    )
    radius: float | None = Field(
        description="Radius around a pose within which scans are compared, metres"
    )
    cost_layer: str = Field(description="Layer of costs if a request names none")
    layers: list[Layer]
    max_zoom: int = Field(description="Zoom of the tiles with one pixel per cell")


class MapList(BaseModel):
    """The maps that are served."""

    maps: list[MapInfo]


class Parameter(BaseModel):
    """A parameter with which the map was computed."""

    value: float | int | str | None
    unit: str = Field(description="m, rad, 1 or nothing")
    text: str = Field(description="Meaning of the parameter, in a sentence")


class Zone(BaseModel):
    """Share and area of the floor in a zone."""

    zone: str
    code: int = Field(description="Value in the layer `zone`")
    colour: str
    meaning: str
    area_m2: float = Field(description="Square metres of judged floor")
    share: float = Field(description="Share of the judged floor, 0 to 1")


class Figures(BaseModel):
    """Areas of the floor, square metres."""

    free_area_m2: float
    judged_area_m2: float = Field(
        description="Explored and reachable floor, to which all figures refer"
    )
    unexplored_area_m2: float = Field(
        description="Reachable, but half of the beams or more end in unknown space"
    )
    too_close_area_m2: float = Field(description="Too close to walls for this robot")
    not_reachable_area_m2: float = Field(description="The robot would fit, but cannot get there")
    outside_area_m2: float = Field(
        description="Outside of the building, or at the border of the map"
    )
    robot_radius_m: float = Field(description="Radius of the robot for which the floor is judged")
    mean_level: float | None = Field(description="Mean ambiguity level of judged floor, 0 to 1")


class Choice(BaseModel):
    """A name that requests may give."""

    name: str
    title: str = Field(description="Meaning of the name, in a few words")


class ForecastChoices(BaseModel):
    """Robots that routes can be forecast for."""

    odometries: list[Choice] = Field(description="The best first")
    odometry: str = Field(description="Odometry if a request names none")
    localizers: list[Choice] = Field(description="Calibrated classes that can use the scanner")
    localizer: str = Field(description="Class of localizer if a request names none")


class MapDetail(MapInfo):
    """All details of a map."""

    attrs: dict[str, Parameter] = Field(description="Parameters of the computation")
    zones: list[Zone]
    figures: Figures
    forecast: ForecastChoices = Field(description="Robots that routes can be forecast for")


class Nearest(BaseModel):
    """The nearest point of the lattice."""

    x: float
    y: float
    theta: float | None = Field(
        description="Radians; null if the map does not depend on the heading"
    )


class PoseValues(BaseModel):
    """All values of the map at a pose."""

    x: float
    y: float
    theta: float | None
    values: dict[str, float | None] = Field(description="Value of each layer; null: no value there")
    cost: float | None = Field(
        description="Cost of a metre there, at least 1; null: no robot can be there"
    )
    zone: str | None = Field(description="null where the floor is not judged")
    judged: str | None = Field(
        description='"judged", or why the floor is not counted: "unexplored", "too close to '
        'walls", "not reachable", "outside of the building"; null: it is not free'
    )
    nearest: Nearest | None = Field(description="null: the pose is outside")
    reason: Reason | None = Field(description="Reason if there is no value")


class Scan(BaseModel):
    """The expected scan at a pose, beam by beam."""

    x: list[float] = Field(description="End points of the beams, metres")
    y: list[float]
    hit: list[bool] = Field(description="True if the beam returns an echo")
    origin_x: list[float] = Field(description="Start points of the beams, metres")
    origin_y: list[float] = Field(description="Start points of the beams, metres")
    sentence: str = Field(description="Description of the scan in a sentence")


class Strict(BaseModel):
    """A body in which every field must be known and have the declared type."""

    model_config = ConfigDict(extra="forbid", strict=True)


class _FirstOnly(FailFast):
    """Validator that reports only the first error of a list; it also accepts `| None`."""

    __hash__ = object.__hash__


FIRST_ONLY = _FirstOnly()

Column = Annotated[list[float], FIRST_ONLY]
"""Numbers of a request. Of a million wrong ones only the first is reported, to save memory."""


class Poses(Strict):
    """Poses, in columns of equal length."""

    x: Column = Field(description="Metres")
    y: Column = Field(description="Metres")
    theta: Column | None = Field(
        None, description="Radians; needed where the layer depends on the heading"
    )
    layer: str | None = Field(None, description="Layer; null: the map's own choice")


class CostPoses(Poses):
    """Poses whose cost is requested."""

    weight: float = Field(5.0, ge=0.0, description="Extra metres that a metre at layer 1 is worth")


class Steps(Strict):
    """Motions from one pose to another, in columns of equal length."""

    x0: Column = Field(description="Start, metres")
    y0: Column = Field(description="Start, metres")
    x1: Column = Field(description="End, metres")
    y1: Column = Field(description="End, metres")
    theta0: Column | None = Field(None, description="Heading at the start, radians")
    theta1: Column | None = Field(None, description="Heading at the end, radians")
    layer: str | None = Field(None, description="Layer; null: the map's own choice")
    steering: Motion = Field("se2", description="Motion model of the robot; se2: straight")
    turning_radius: float = Field(0.0, ge=0.0, description="Turning radius of a car, metres")


class Costs(BaseModel):
    """Costs of poses."""

    cost: list[float | None] = Field(
        description="Cost of a metre, at least 1; null: no robot can be there"
    )
    reason: list[Reason | None] = Field(description="Reason if there is no value")


class OneCost(BaseModel):
    """Cost of a pose."""

    cost: float | None = Field(
        description="Cost of a metre, at least 1; null: no robot can be there"
    )
    reason: Reason | None = Field(description="Reason if there is no value")


class Levels(BaseModel):
    """Values of a layer at poses."""

    level: list[float | None] = Field(description="Value in the layer's unit; null: no value there")
    reason: list[Reason | None] = Field(description="Reason if there is no value")


class Rewards(BaseModel):
    """Rewards of motions."""

    reward: list[float | None] = Field(
        description="Minus the layer integrated over the motion's metres, at most 0"
    )


class LegendEntry(BaseModel):
    """Meaning of a colour."""

    value: float
    colour: str
    label: str


class LayerScale(BaseModel):
    """Rendering of a layer."""

    name: str
    units: str
    min: float = Field(description="Value of the first colour")
    max: float = Field(description="Value of the last colour")
    levels: int = Field(description="Number of zoom levels; the largest zoom is one less")
    tile: int = Field(description="Pixels along the side of a tile")
    legend: list[LegendEntry]


class Place(BaseModel):
    """A connected region in which a robot may get lost."""

    number: int = Field(description="Rank, from 1 for the worst")
    x: float
    y: float
    theta: float | None = Field(
        description="Worst heading, radians; null: no heading is worse than the others"
    )
    zone: str
    level: float = Field(description="Mean ambiguity level, 0 to 1")
    area_m2: float
    length: float = Field(description="Length of the smallest rectangle around it, metres")
    width: float
    reason: str = Field(description="Reason of the bad localization, in a sentence")
    weak_direction: float | None = Field(
        description="Direction in which motion is not observable, radians from 0 to pi"
    )
    bounds: tuple[float, float, float, float]


class Glyph(BaseModel):
    """The weak direction at a point."""

    x: float
    y: float
    direction: float = Field(description="Radians from 0 to pi")
    major: float = Field(description="Relative ambiguity radius along it, 0 to 1")
    minor: float = Field(description="Relative ambiguity radius across it, 0 to 1")


class Health(BaseModel):
    """Status: the server is running."""

    status: Literal["ok"]
    version: str
    maps: int


class Readiness(BaseModel):
    """Status: the server answers at once."""

    status: Literal["ready"]
    seconds: float = Field(description="Time from the start of the server until it was ready")


XY = Annotated[list[float], Field(min_length=2, max_length=3)]


def as_json(value: Any, status: int = 200, **headers: str) -> Response:
    """Return an answer in JSON; non-finite numbers become null."""
    body = to_json(value, inf_nan_mode="null")
    return Response(body, status, headers, media_type="application/json")
