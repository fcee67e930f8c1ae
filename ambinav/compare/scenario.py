"""A scenario: what is compared, as a file says it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, InstanceOf, model_validator

from ambinav.drive.noise import OdometryNoise
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.people import People
from ambinav.drive.robot import Robot
from ambinav.errors import InputError
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.sensing.fields import nearest

Made = TypeVar("Made")
Point = tuple[float, float] | tuple[float, float, float]

SIMPLE_LOCALIZERS = ("perfect", "odometry")
ALL_PAIRS: Final = "all pairs"
"""What the rows over all pairs are called."""
KINDS = (
    *("shortest", "clearance", "ambiguity", "belief", "belief-roadmap", "reference"),
    *("planner", "file"),
)
"""Kinds of routes."""

HEARD: Mapping[str, tuple[str, ...]] = {
    "shortest": ("planner", "iterations", "seed"),
    "clearance": ("planner", "iterations", "seed", "clearance_weight", "comfort"),
    "ambiguity": ("planner", "iterations", "seed", "weight"),
    "belief": ("weight",),
    "belief-roadmap": ("iterations", "seed", "weight"),
    "reference": ("weight",),
    "planner": ("planner", "iterations", "seed", "weight"),
    "file": ("file", "pair"),
}
"""Which keys mean something to a kind, besides `kind` and `name`."""

NEEDED: Mapping[str, str] = {"planner": "planner", "file": "file"}
"""Keys that a kind cannot do without."""


class Part(BaseModel):
    """A mapping of a scenario file whose keys are all known."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _known(cls, plain: Any) -> Any:
        if isinstance(plain, cls):
            return plain
        if not isinstance(plain, Mapping):
            raise InputError(f"give a mapping with the keys {', '.join(cls.model_fields)}")
        check_keys(plain, list(cls.model_fields))
        return plain


def check_keys(plain: Mapping[str, Any], known: list[str]) -> None:
    """Refuse keys that are not known.

    Raises:
        InputError: there is one; the nearest known ones are offered.
    """
    for key in plain:
        if key not in known:
            raise InputError(f"the key {key!r} is unknown; {nearest(str(key), known)}")


def _making(kind: type[Made]) -> Callable[[Any], Made]:
    """What makes a dataclass of numbers from a mapping."""

    def make(plain: Any) -> Made:
        if isinstance(plain, kind):
            return plain
        names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
        if not isinstance(plain, Mapping):
            raise InputError(f"give a mapping with the keys {', '.join(names)}")
        check_keys(plain, names)
        for key, value in plain.items():
            if not isinstance(value, bool | int | float):
                raise InputError(f"{key} is {value!r}; give a number")
        return kind(**plain)

    return make


class MapPart(Part):
    """How the ambiguity map is built; see `ambinav map`."""

    spacing: float = Field(default=0.1, gt=0.0)
    radius: float = Field(default=0.5, gt=0.0)
    headings: int | None = Field(default=None, ge=1)
    map_std: float | None = Field(default=None, ge=0.0)
    layer: str = "level"


class PlanningPart(Part):
    """What all planned routes have in common.

    Attributes:
        planner: For the kinds clearance and ambiguity; see `ambinav plan`. What all others are
            compared with, the kind shortest, is found by the planner reference unless the route
            names another: samples may miss it.
        iterations: Of the planner; there is no limit of time, so that the route is always the same.
        seed: Of the planner.
        margin: Metres that routes keep off walls in addition to the robot's radius.
    """

    planner: str = "prmstar"
    iterations: int = Field(default=1000, ge=1)
    seed: int = Field(default=1, ge=1, lt=2**32)
    margin: float = Field(default=0.1, ge=0.0)


class PairPart(Part):
    """A start and a goal: x, y in metres and, if it matters, a heading in radians."""

    name: str = Field(min_length=1)
    start: Point
    goal: Point


class RoutePart(Part):
    """A route to compare; None stands for what `planning` or the planner has."""

    kind: Literal[*KINDS]  # type: ignore[valid-type]
    name: str = Field(min_length=1)
    weight: float = Field(default=5.0, ge=0.0)
    clearance_weight: float = Field(default=5.0, gt=0.0)
    comfort: float = Field(default=1.0, gt=0.0)
    planner: str | None = None
    iterations: int | None = Field(default=None, ge=1)
    seed: int | None = Field(default=None, ge=1, lt=2**32)
    file: str | None = None
    pair: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _named(cls, plain: Any) -> Any:
        """A kind alone stands for itself; what the kind does not listen to is refused."""
        if isinstance(plain, str):
            plain = {"kind": plain}
        if not isinstance(plain, Mapping):
            raise InputError("give the kind of a route, or a mapping with the key kind")
        check_keys(plain, list(cls.model_fields))
        kind = str(plain.get("kind"))
        if "kind" not in plain or kind not in KINDS:
            raise InputError(f"kind is {plain.get('kind')!r}; {nearest(kind, KINDS)}")
        for key in plain:
            if key not in ("kind", "name", *HEARD[kind]):
                raise InputError(f"{key} means nothing to a route of the kind {kind!r}; drop it")
        if kind in NEEDED and NEEDED[kind] not in plain:
            raise InputError(f"a route of the kind {kind!r} needs the key {NEEDED[kind]!r}; add it")
        return {"name": _default_name(kind, plain), **plain}


def _default_name(kind: str, plain: Mapping[str, Any]) -> str:
    if kind == "planner":
        return f"{plain['planner']} {plain.get('weight', 5.0)}"
    if kind == "file":
        return str(plain["file"])
    if kind in ("shortest", "clearance"):
        return kind
    return f"{kind} {plain['weight']}" if "weight" in plain else kind


class DrivePart(Part):
    """How often and how the routes are driven; see `ambinav.drive.drive`."""

    runs: int = Field(default=30, ge=1)
    seed: int = Field(default=1, ge=0)
    open_loop: bool = False
    rate: float = Field(default=10.0, gt=0.0)
    start_std: tuple[float, float, float] = (0.05, 0.05, 0.02)
    max_time: float | None = Field(default=None, gt=0.0)


class Scenario(Part):
    """All of a scenario file."""

    name: str = Field(min_length=1)
    environment: str
    scanner: str | dict[str, Any]
    map: MapPart = MapPart()
    robot: Annotated[InstanceOf[Robot], BeforeValidator(_making(Robot))] = Robot()
    follower: Annotated[
        InstanceOf[FollowerParameters], BeforeValidator(_making(FollowerParameters))
    ] = FollowerParameters()
    odometry: Annotated[InstanceOf[OdometryNoise], BeforeValidator(_making(OdometryNoise))] = (
        OdometryNoise()
    )
    people: Annotated[InstanceOf[People], BeforeValidator(_making(People))] = People(0)
    localizer: dict[str, Any] | str = Field(default_factory=dict)
    planning: PlanningPart = PlanningPart()
    pairs: tuple[PairPart, ...] = Field(min_length=1)
    routes: tuple[RoutePart, ...] = Field(min_length=1)
    drive: DrivePart = DrivePart()

    @model_validator(mode="after")
    def _fits(self) -> Scenario:
        """Check what no part knows by itself."""
        for name, parts in (("pairs", self.pairs), ("routes", self.routes)):
            names = [part.name for part in parts]
            for one in names:
                if names.count(one) > 1:
                    raise InputError(f"{name}: {one!r} is there twice; give each a name of its own")
        pairs = [pair.name for pair in self.pairs]
        if ALL_PAIRS in pairs:
            raise InputError(
                f"pairs: {ALL_PAIRS!r} is the name of the rows over all pairs; change it"
            )
        for route in self.routes:
            if route.kind != "file":
                continue
            if route.pair is None and len(pairs) > 1:
                raise InputError(f"routes: {route.name!r} does not say its pair; add the key pair")
            if route.pair is not None and route.pair not in pairs:
                raise InputError(
                    f"routes: {route.name!r} is for the pair {route.pair!r}, which is not there; "
                    f"{nearest(route.pair, pairs)}"
                )
        if isinstance(self.localizer, str) and self.localizer not in SIMPLE_LOCALIZERS:
            raise InputError(
                f"localizer is {self.localizer!r}; {nearest(self.localizer, SIMPLE_LOCALIZERS)}, "
                "or give a mapping of AMCL's parameters"
            )
        self.guide  # noqa: B018 - it checks the parameters
        return self

    @property
    def guide(self) -> MclParameters | str:
        """The localizer; alphas that the file leaves out are those of the simulated odometry."""
        if isinstance(self.localizer, str):
            return self.localizer
        noise = self.odometry
        told = {name: getattr(noise, name) * noise.scale**2 for name in ALPHAS if name != "alpha5"}
        return MclParameters.from_dict({**told, **self.localizer})

    @property
    def baseline(self) -> str:
        """Name of the route that the others are compared with: the first shortest, or the first."""
        for route in self.routes:
            if route.kind == "shortest":
                return route.name
        return self.routes[0].name
