"""Everything about a navigation environment but the building: robot, sensing, task, reward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from ambinav.ambiguity.cost_layer import cost_layer
from ambinav.ambiguity.layers.registry import check_known
from ambinav.config import as_count, as_number, as_numbers, nearest
from ambinav.drive.localizer_spec import LOCALIZERS as ALL_LOCALIZERS
from ambinav.drive.metrics import ARRIVAL
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.people import People
from ambinav.drive.robot import Robot
from ambinav.errors import InputError
from ambinav.localization.parameters import MclParameters
from ambinav.localization.scanner_settings import settings_for
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav_envs.observations import OBSERVATIONS, ObservationPart
from ambinav_envs.rewards import REWARD_TERMS, TERMS, RewardTerm, weights_of
from ambinav_envs.simulation.layout import LOCALIZERS

Part = TypeVar("Part")

# Lowest value of each number, and whether it may be taken.
_ABOVE_ZERO = (
    "dt", "goal_radius", "success_radius", "gate", "window_spacing", "waypoint_distance", "gamma",
    "longest",
)  # fmt: skip
_AT_LEAST_ZERO = ("odometry_scale", "shortest", "ambiguity_weight")
_SWITCHES = ("discrete", "window", "waypoint", "end_when_lost")
# Counts from 1 on, and the greatest value of each.
_COUNTS: Final = {"max_steps": 10**9, "iterations": 1000, "window_cells": 256}
MOST_AMBIGUITY_WEIGHT: Final = 100.0
MOST_AROUND: Final = 1000
"""So many people, and so many boxes, may be around a robot; each robot of a batch has its own."""


def default_scanner() -> RangeScanner:
    """A laser that looks all around: 60 beams of 4 m."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.01)
    return RangeScanner.planar(sensor, 60, 2.0 * math.pi)


@dataclass(frozen=True, kw_only=True)
class NavigationParameters:
    """Parameters of the navigation environments; metres, seconds, radians.

    Parts of their own (robot, odometry, people, mcl) may be given as mappings of their fields.

    Attributes:
        scanner: What the robot sees with: a `RangeScanner`, the name of a preset, or a YAML file.
        robot: Its disc and how fast it moves.
        dt: Time step.
        min_speed: Lowest speed that an action can ask for, metres per second: 0, or below to
            drive backwards.
        discrete: Whether actions are one of nine, see `spaces.ACTIONS`.
        max_steps: Steps after which an episode is truncated; at most 10^9.
        localizer: "ekf" (Kalman filter on the ranges), "mcl" (Monte Carlo localization, some
            hundred times as slow), "perfect" (knows the truth), "odometry" (dead reckoning).
        iterations: Rounds of the Kalman filter's update, at most 1000; later ones stay on the
            walls that the first one met. One round alone is surer of itself than it may be.
        gate: See `ambinav.localization.ekf.ExtendedKalmanFilter`.
        map_std: Deviation of the walls' position that the filter assumes; None: as the map's.
        mcl: Parameters of the Monte Carlo localizer: `MclParameters`, which are taken as they are,
            or some by name, the others as suits the scanner (`MclParameters.for_scanner`); None:
            all so, with the odometry's alphas.
        odometry: How odometry errs, as the localizer models it (it knows nothing of biases).
        odometry_scale: How many times as much it truly errs.
        start_std: Deviations of x, y and heading of the first estimate, which the localizer
            knows.
        goal_radius: The robot stops when its estimate is this near to the goal.
        success_radius: It has arrived if it truly is this near then.
        end_when_lost: Whether to end an episode when the robot is lost.
        shortest: Least length of the shortest path from start to goal.
        longest: Greatest length of it.
        window: Whether the observation holds a window of the ambiguity map.
        window_cells: Its edge, cells; at most 256.
        window_spacing: Edge of a cell.
        ambiguity_weight: What ambiguity adds to a metre of the route that the term `progress` and
            the waypoint follow: it costs 1 + ambiguity_weight * layer metres, as in
            `AmbiguityService` and the planners. 0: the shortest path; at most 100. See
            `rewards.PRESETS`.
        waypoint: Whether the observation holds a point ahead on that route.
        waypoint_distance: How far ahead.
        reward: Name of a preset, or weights by term; see `rewards`.
        observations: Names of parts of the observation that plug-ins bring; ours have switches.
        gamma: Discount in the progress term. 1 counts plain metres. At the agent's own discount
            the terms of an episode add up to the length of the route at its start, less what is
            left at its end, discounted: so all that the term changes is what an end is worth, by
            how far from the goal it is.
        layer: Layer of the ambiguity map for reward, exposure and window; None: the one that suits
            the scanner, which `cost_layer` tells.
        people: Who walks about: how many (at most 1000), or `People`. They turn away from the
            robot, and walk through boxes; who is driven into a corner stands there, and to touch
            a person is no collision.
        obstacles: How many boxes stand about that the map does not have, at most (and at most
            1000): those that find no room are left out.
        obstacle_sizes: Their least and greatest edge.

    Raises:
        InputError: a value makes no sense; one sentence names the field and the remedy.
    """

    scanner: RangeScanner = field(default_factory=default_scanner)
    robot: Robot = field(default_factory=Robot)
    dt: float = 0.1
    min_speed: float = 0.0
    discrete: bool = False
    max_steps: int = 600
    localizer: str = "ekf"
    iterations: int = 2
    gate: float = 3.0
    map_std: float | None = None
    mcl: MclParameters | None = None
    odometry: OdometryNoise = field(default_factory=OdometryNoise)
    odometry_scale: float = 1.0
    start_std: tuple[float, float, float] = (0.05, 0.05, 0.02)
    goal_radius: float = 0.3
    success_radius: float = ARRIVAL
    end_when_lost: bool = False
    shortest: float = 2.0
    longest: float = 15.0
    window: bool = True
    window_cells: int = 16
    window_spacing: float = 0.4
    ambiguity_weight: float = 0.0
    waypoint: bool = False
    waypoint_distance: float = 1.5
    reward: str | Mapping[str, float] = "ambiguity"
    observations: tuple[str, ...] = ()
    gamma: float = 1.0
    layer: str | None = None
    people: People = field(default_factory=lambda: People(0))
    obstacles: int = 0
    obstacle_sizes: tuple[float, float] = (0.3, 0.8)

    def __post_init__(self) -> None:
        """Check every field and bring it to its type."""
        self._set("scanner", _scanner(self.scanner))
        self._set("robot", _part(self.robot, "robot", Robot))
        self._set("odometry", _part(self.odometry, "odometry", OdometryNoise))
        if self.mcl is not None:
            mcl: object = self.mcl
            if isinstance(mcl, Mapping):
                mcl = {**settings_for(self.scanner, mcl.get("laser_model_type")), **mcl}
            self._set("mcl", _part(mcl, "mcl", MclParameters))
        people: Any = self.people
        if isinstance(people, int | np.integer) and not isinstance(people, bool):
            people = {"count": int(people)}
        self._set("people", _part(people, "people", People))
        if self.people.count > MOST_AROUND:
            raise InputError(f"people are {self.people.count}; give at most {MOST_AROUND}.")
        for key, most in _COUNTS.items():
            self._set(key, as_count(getattr(self, key), key))
            self._require(key, getattr(self, key) <= most, f"at most {most}")
        for key in _SWITCHES:
            if not isinstance(getattr(self, key), bool | np.bool_):
                raise InputError(f"{key} is {getattr(self, key)!r}; give true or false.")
            self._set(key, bool(getattr(self, key)))
        for key in (*_ABOVE_ZERO, *_AT_LEAST_ZERO, "min_speed"):
            self._set(key, as_number(getattr(self, key), key))
        for key in _ABOVE_ZERO:
            self._require(key, getattr(self, key) > 0.0, "more than 0")
        for key in _AT_LEAST_ZERO:
            self._require(key, getattr(self, key) >= 0.0, "at least 0")
        if self.map_std is not None:
            self._set("map_std", as_number(self.map_std, "map_std"))
            self._require("map_std", self.map_std >= 0.0, "at least 0")
        obstacles: object = self.obstacles
        if isinstance(obstacles, bool) or not isinstance(obstacles, int | np.integer):
            raise InputError(f"obstacles is {obstacles!r}; give a whole number from 0 on.")
        self._set("obstacles", int(obstacles))
        self._require("obstacles", self.obstacles >= 0, "a whole number from 0 on")
        self._require("obstacles", self.obstacles <= MOST_AROUND, f"at most {MOST_AROUND}")
        self._set("start_std", _numbers(self.start_std, "start_std", 3))
        self._require("start_std", min(self.start_std) > 0.0, "three deviations above 0")
        self._set("obstacle_sizes", _numbers(self.obstacle_sizes, "obstacle_sizes", 2))
        low, high = self.obstacle_sizes
        self._require("obstacle_sizes", 0.0 < low <= high, "the least and the greatest edge")
        heavy = MOST_AMBIGUITY_WEIGHT
        self._require("ambiguity_weight", self.ambiguity_weight <= heavy, f"at most {heavy:g}")
        speed = self.robot.max_speed
        self._require("min_speed", -speed <= self.min_speed <= 0.0, f"{-speed:g} to 0")
        self._require("gamma", self.gamma <= 1.0, "at most 1")
        self._require(
            "longest", self.longest > self.shortest, f"more than shortest, {self.shortest:g}"
        )
        radius = self.goal_radius
        self._require("success_radius", self.success_radius >= radius, f"at least {radius:g}")
        if self.localizer not in LOCALIZERS:
            raise InputError(_why_not_localizer(str(self.localizer)))
        if not isinstance(self.layer, str | None):
            raise InputError(f"layer is {self.layer!r}; give a layer's name, such as level.")
        if self.layer is not None:
            check_known(self.layer)
        if isinstance(self.reward, Mapping):
            self._set("reward", dict(self.reward))
        weights_of(self.reward)
        observations: object = self.observations
        if not isinstance(observations, list | tuple):
            raise InputError(f"observations is {observations!r}; give a list of names.")
        self._set("observations", tuple(map(str, observations)))
        for name in self.observations:
            if OBSERVATIONS.get(name).function is None:
                raise InputError(
                    f"observations: {name!r} is one of ours, which need not be named; leave it out."
                )

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> NavigationParameters:
        """The parameters from a mapping; what it leaves out is as by default.

        Raises:
            InputError: a name is unknown (the nearest is offered), or a value makes no sense.
        """
        known = [item.name for item in fields(cls)]
        for name in values:
            if name not in known:
                raise InputError(f"the option {name!r} is unknown; {nearest(str(name), known)}.")
        return cls(**values)

    @property
    def weights(self) -> tuple[float, ...]:
        """Weight of each of our own terms of the reward, in the order of `rewards.TERMS`."""
        weights = weights_of(self.reward)
        return tuple(weights[term] for term in TERMS)

    @property
    def plugged_terms(self) -> tuple[tuple[RewardTerm, float], ...]:
        """Terms of the reward that plug-ins bring, with their weights."""
        weights = weights_of(self.reward)
        return tuple(
            (REWARD_TERMS.get(term), weight)
            for term, weight in weights.items()
            if term not in TERMS
        )

    @property
    def plugged_parts(self) -> tuple[ObservationPart, ...]:
        """Parts of the observation that plug-ins bring."""
        return tuple(map(OBSERVATIONS.get, self.observations))

    @property
    def cost_layer(self) -> str:
        """The layer of the ambiguity map for reward, exposure and window."""
        return cost_layer(self.scanner) if self.layer is None else self.layer

    @property
    def true_odometry(self) -> OdometryNoise:
        """How odometry truly errs."""
        return replace(self.odometry, scale=self.odometry.scale * self.odometry_scale)

    @property
    def particles(self) -> MclParameters:
        """Parameters of the Monte Carlo localizer."""
        if self.mcl is not None:
            return self.mcl
        modelled = self.odometry.modelled
        alphas = {f"alpha{k}": getattr(modelled, f"alpha{k}") for k in range(1, 5)}
        return MclParameters.for_scanner(self.scanner, **alphas)

    def _set(self, key: str, value: object) -> None:
        object.__setattr__(self, key, value)

    def _require(self, key: str, good: bool, what: str) -> None:
        if not good:
            raise InputError(f"{key} is {getattr(self, key)}; give {what}.")


def _why_not_localizer(name: str) -> str:
    if name in ALL_LOCALIZERS.names():
        return (
            f"localizer is {name!r}, which is not compiled into the environments; they have "
            f"{', '.join(LOCALIZERS)}."
        )
    return f"localizer is {name!r}; {nearest(name, LOCALIZERS)}."


def _scanner(value: object) -> RangeScanner:
    """A scanner from what a user may give."""
    if isinstance(value, RangeScanner):
        return value
    if isinstance(value, Path) or (isinstance(value, str) and value.endswith((".yaml", ".yml"))):
        return RangeScanner.from_yaml(value)
    if isinstance(value, str):
        return RangeScanner.from_preset(value)
    raise InputError(
        f"scanner is of the type {type(value).__name__}; give a RangeScanner, the name of a "
        "preset or a YAML file."
    )


def _part(value: object, name: str, kind: type[Part]) -> Part:
    """A part of the parameters, made of a mapping where that is given; errors name the part."""
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        number = "a number, or " if kind is People else ""
        raise InputError(f"{name} is {value!r}; give {number}its fields by name.")
    known = list(kind.__dataclass_fields__)  # type: ignore[attr-defined]
    for key in value:
        if key not in known:
            raise InputError(f"{name}: {key!r} is unknown; {nearest(str(key), known)}.")
    try:
        return kind(**value)
    except TypeError as error:
        raise InputError(f"{name} is {dict(value)!r}; {error}.") from error
    except InputError as error:
        text = str(error)
        if text.startswith(f"{name}: "):
            raise
        raise InputError(f"{name}: {text}") from error


def _numbers(value: object, name: str, count: int) -> tuple[float, ...]:
    """So many finite numbers."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, list | tuple) or len(value) != count:
        raise InputError(f"{name} is {value!r}; give {count} numbers.")
    return as_numbers(value, name)
