"""All parameters of a navigation environment except the building."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Final

import numpy as np
from pydantic import BeforeValidator, InstanceOf, SkipValidation

from ambinav.ambiguity.cost_layer import cost_layer
from ambinav.config import (
    FaultError,
    NonNegative,
    Number,
    Positive,
    Share,
    Switch,
    check_fields,
    check_kind,
    fault,
    from_mapping,
    integer,
    nearest,
    number,
    of_mapping,
    require,
    row,
)
from ambinav.drive.localizer_spec import LOCALIZERS as ALL_LOCALIZERS
from ambinav.drive.metrics import ARRIVAL
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.people import People
from ambinav.drive.robot import Robot
from ambinav.layers.registry import check_known
from ambinav.localization.parameters import MclParameters
from ambinav.localization.scanner_settings import settings_for
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.difficulty import LEVELS
from ambinav_envs.observations import OBSERVATIONS, ObservationPart
from ambinav_envs.planar_scanner import as_scanner, default_scanner
from ambinav_envs.registration import TASKS
from ambinav_envs.rewards import REWARD_TERMS, TERMS, RewardTerm, weights_of
from ambinav_envs.simulation.belief import NUMBERS
from ambinav_envs.simulation.layout import DECLARATIONS, LOCALIZERS, MOTIONS

MOST_AMBIGUITY_WEIGHT: Final = 100.0
GLOBAL: Final = ("mcl", "perfect")
"""The localizers that need no first estimate."""
MOST_WALLS_STD: Final = 0.2
"""Metres. Walls that are off by more cross each other."""
MOST_SECONDS: Final = 1e6
"""Longest time to wait or to stand still; its number of steps is still exact."""
MOST_MAP_STD: Final = 100.0
"""Metres."""
MOST_LATE: Final = 1000
"""Steps by which an estimate may be late."""
MOST_AROUND: Final = 1000
"""Largest number of people, and of boxes, around a robot; each robot of a batch has its own."""


_Deviation = Annotated[float, number(above=0, most=1e6)]


def _people(value: object) -> People:
    """Convert a user's value to people: their number, or a mapping with more about them."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        value = {"count": int(value)}
    if not isinstance(value, People | Mapping):
        raise fault(value, "give a whole number, or its fields by name")
    people = from_mapping(People, value)
    if people.count > MOST_AROUND:
        raise FaultError(f"are {people.count}; give at most {MOST_AROUND}")
    return people


def _localizer(value: object) -> str:
    """Return the name of a localizer, checked to be compiled into the environments."""
    if value in LOCALIZERS:
        return str(value)
    if value in ALL_LOCALIZERS.names():
        raise FaultError(
            f"is {value!r}, which is not compiled into the environments; they have "
            f"{', '.join(LOCALIZERS)}"
        )
    raise fault(value, nearest(str(value), LOCALIZERS))


def _observations(value: object) -> tuple[str, ...]:
    """Return the names of parts of the observation that plug-ins provide, checked."""
    if not isinstance(value, list | tuple):
        raise fault(value, "give a list of names")
    for name in map(str, value):
        if OBSERVATIONS.get(name).function is None:
            raise InputError(f"{name!r} is one of ours, which need not be named; leave it out.")
    return tuple(map(str, value))


def _declare(value: object) -> tuple[str, ...]:
    """Return what a robot may declare, in the order of `DECLARATIONS`."""
    if not isinstance(value, list | tuple):
        raise fault(value, f"give a list of names, such as [{DECLARATIONS[0]}]")
    for name in value:
        if name not in DECLARATIONS:
            raise fault(name, nearest(str(name), DECLARATIONS))
    return tuple(name for name in DECLARATIONS if name in value)


def _task(value: object) -> str | None:
    """Return the name of a task, checked to be there."""
    if isinstance(value, str):
        TASKS.get(value)
    elif value is not None:
        raise fault(value, "give the name of a task")
    return value


@dataclass(frozen=True, kw_only=True)
class NavigationParameters:
    """Parameters of the navigation environments; metres, seconds, radians.

    Parts of their own (robot, odometry, people, mcl) may be given as mappings of their fields.

    Attributes:
        scanner: The scanner: a `RangeScanner`, the name of a preset, a YAML file, or
            fields of `planar_scanner.PlanarScanner` by name.
        robot: Its disc and its limits of motion.
        dt: Time step.
        min_speed: Lowest speed of an action, metres per second: 0, or below 0 to drive backwards.
        discrete: True: nine discrete actions, see `spaces.ACTIONS`, and one a declaration.
        declare: What an action may declare besides: "arrived", by which the robot ends its episode;
            "lost", by which it calls for help. Without "arrived" a robot stops where its estimate
            is at the goal.
        declare_seconds: Time for which it has to say so without a break, rounded to steps.
        help_seconds: Time that a robot stands which has called for help, until it is given an
            estimate of its pose with the deviations `start_std`.
        belief: True: an action gives besides the agent's own estimate of the pose with its
            covariance, in nine numbers, see `beliefs`; the reward's term `belief` is their score.
        max_steps: Steps after which an episode is truncated; at most 10^9.
        localizer: "ekf" (Kalman filter on the ranges), "mcl" (Monte Carlo localization; a step
            takes several times as long), "perfect" (the true pose), "odometry" (dead reckoning).
        iterations: Rounds of the Kalman filter's update, at most 1000; later ones keep the walls
            that the first one hit. With a single round the filter is overconfident.
        gate: See `ambinav.localization.ekf.ExtendedKalmanFilter`.
        map_std: Deviation of the walls' position assumed by the filter; None: that of the map.
        mcl: Parameters of the Monte Carlo localizer: `MclParameters`, which are used unchanged, or
            some by name, with defaults that suit the scanner (`MclParameters.for_scanner`); None:
            all defaults, with the odometry's alphas.
        odometry: Odometry noise as the localizer models it, without biases.
        odometry_scale: Factor of the true odometry noise.
        start_std: Deviations of x, y and heading of the first estimate, known to the localizer.
        goal_radius: Distance of the estimate to the goal at which the robot stops, where it does
            not declare that; what is shipped for driving declares by the same rule.
        success_radius: Largest true distance to the goal that counts as arrived.
        end_when_lost: True: an episode ends when the robot is lost.
        shortest: Smallest length of the shortest path from start to goal.
        longest: Largest length of that path.
        window: True: the observation contains a window of the ambiguity map.
        window_cells: Edge of the window, cells; at most 256.
        window_spacing: Edge of a cell.
        ambiguity_seen: True: the observation may use the ambiguity map, in the first half of the
            window and, with an `ambiguity_weight`, in the waypoint. False: that half is 0 in free
            cells and 1 in others, as known from the walls, and such a waypoint is refused. The
            reward does not change.
        ambiguity_weight: Weight of ambiguity in the route of the term `progress` and of the
            waypoint: a metre costs 1 + ambiguity_weight * layer metres, as in `AmbiguityService`
            and the planners. 0: the shortest path; at most 100. See `rewards.PRESETS`.
        waypoint: True: the observation contains a point ahead on that route.
        waypoint_distance: Distance to that point.
        reward: Name of a preset, or weights by term; see `rewards`.
        observations: Names of observation parts of plug-ins; ambinav's own parts have switches.
        gamma: Discount in the progress term. 1 counts plain metres. At the agent's own discount the
            terms of an episode sum to the length of the route at its start minus the discounted
            rest at its end: so the term only changes the value of an end, by its distance to the
            goal.
        layer: Layer of the ambiguity map for reward, exposure and window; None: the one that suits
            the scanner, see `cost_layer`.
        people: People who walk around: their number (at most 1000), or `People`. They turn away
            from the robot, and walk through boxes; in a corner they stop. Touching a person is not
            a collision.
        obstacles: Maximum number of unmapped boxes (at most 1000): boxes without room are left out.
            In a building in space they are `ambinav.drive.clutter.OBSTACLE_HEIGHT` high.
        obstacle_sizes: Smallest and largest edge of the boxes.
        start_unknown: True: the localizer starts without an estimate, anywhere in the building;
            only possible with "mcl" (and "perfect").
        start_aliases: Most aliased poses of the start, `buildings.aliases`, at which the localizer
            starts as well; 0: only at the robot's. Starts are then drawn among those that have one,
            and goals for which it matters, from `shortest` to `longest` away from all of them. Only
            possible with "mcl" (and "perfect").
        start_prior: Least and greatest prior probability of one of these poses, which is drawn; the
            others share the rest equally. Particles are shared out by it.
        hypotheses: How many clusters of particles the observation contains, at most 16; a localizer
            without particles has one hypothesis, its estimate.
        kidnapped: Share of the episodes in which the robot is carried elsewhere, to where there is
            a path to the goal; neither odometry nor the localizer knows it.
        kidnap_seconds: Earliest and latest time of that, seconds after the start.
        closed_door: Share of the episodes in which a door on the robot's route is closed although
            it is open in the map, and there is a path around it. `progress` follows the open path,
            the waypoint that of the map. Tasks are drawn until there is such a door.
        door_width: Largest width of a passage that counts as a door.
        detour: Smallest and largest length of the path around, relative to the map's shortest path.
        slip: Additional metres that the wheels turn for each metre driven on a slippery floor, a
            disc on the route that odometry does not know.
        slip_radius: Radius of that disc.
        goal_std: It stops there only if the deviation of its estimate is at most this along any
            axis; None: regardless of the deviation.
        walls_std: Deviation of the true walls from those of the map, see
            `ambinav.drive.ageing.with_aged_walls`; at most 0.2. A building has one such world: the
            robot drives, collides and scans there; localizer, waypoint, window and ambiguity use
            the map. Starts and goals are free and connected in both.
        furniture_std: Deviation in x and in y by which furniture of the map was moved, see
            `ambinav.drive.ageing.with_moved_furniture`; otherwise as `walls_std`.
        pose_latency: Age of the estimate used for the observation (`goal`, `waypoint`, `window`,
            `uncertainty`, `hypotheses`) and for the stop at the goal, rounded to steps, at most
            1000 of them. It is not propagated with odometry. Errors and lost robots are judged by
            the latest estimate. "perfect" has no delay.
        scan_time: Duration of a scan, at most 1: its beams are measured one after the other, each
            from the robot's pose at that time, and the last one now. The localizer treats all of
            them as measured now. The robot's motion during the scan is that of its last step.
        gain_std: Deviation, over the episodes, of the executed from the commanded motion, as a
            share of speed and of turn rate. Odometry measures the executed motion.
        actuation_std: The same, drawn in every step, in addition.
        difficulty: Degree to which the world deviates from map and models, 0 to 3: the values of
            `difficulty.LEVELS` for arguments that are not given.
        task: Name of the task whose functions draw and judge the episodes; None: those of all. As
            an argument of an environment it adds the task's arguments.

    Raises:
        InputError: a value is invalid; the message names the field and the remedy.
    """

    scanner: Annotated[InstanceOf[RangeScanner], BeforeValidator(as_scanner)] = field(
        default_factory=default_scanner
    )
    robot: Annotated[InstanceOf[Robot], of_mapping(Robot)] = field(default_factory=Robot)
    dt: Positive = 0.2
    min_speed: Number = 0.0
    discrete: Switch = False
    declare: Annotated[tuple[str, ...], BeforeValidator(_declare)] = ()
    declare_seconds: Annotated[float, number(above=0, most=MOST_SECONDS)] = 0.5
    help_seconds: Annotated[float, number(above=0, most=MOST_SECONDS)] = 15.0
    belief: Switch = False
    max_steps: Annotated[int, integer(most=10**9)] = 300
    localizer: Annotated[str, BeforeValidator(_localizer)] = "ekf"
    iterations: Annotated[int, integer(most=1000)] = 2
    gate: Positive = 3.0
    map_std: Annotated[float, number(least=0, most=MOST_MAP_STD)] | None = None
    mcl: Annotated[InstanceOf[MclParameters], of_mapping(MclParameters)] | None = None
    odometry: Annotated[InstanceOf[OdometryNoise], of_mapping(OdometryNoise)] = field(
        default_factory=OdometryNoise
    )
    odometry_scale: Annotated[float, number(least=0, most=100)] = 1.0
    start_std: Annotated[tuple[_Deviation, _Deviation, _Deviation], row(3, "give 3 numbers")] = (
        0.05, 0.05, 0.02,
    )  # fmt: skip
    goal_radius: Positive = 0.3
    success_radius: Positive = ARRIVAL
    end_when_lost: Switch = False
    shortest: NonNegative = 2.0
    longest: Positive = 15.0
    window: Switch = True
    window_cells: Annotated[int, integer(most=256)] = 16
    window_spacing: Positive = 0.4
    ambiguity_seen: Switch = True
    ambiguity_weight: Annotated[float, number(least=0, most=MOST_AMBIGUITY_WEIGHT)] = 0.0
    waypoint: Switch = True
    waypoint_distance: Positive = 1.5
    reward: Annotated[str | Mapping[str, float], SkipValidation] = "ambiguity"
    observations: Annotated[tuple[str, ...], BeforeValidator(_observations)] = ()
    gamma: Annotated[float, number(above=0, most=1)] = 1.0
    layer: str | None = None
    people: Annotated[InstanceOf[People], BeforeValidator(_people)] = field(
        default_factory=lambda: People(0)
    )
    obstacles: Annotated[int, integer(least=0, most=MOST_AROUND)] = 0
    obstacle_sizes: Annotated[tuple[Positive, Positive], row(2, "give 2 numbers")] = (0.3, 0.8)
    start_unknown: Switch = False
    start_aliases: Annotated[int, integer(least=0, most=8)] = 0
    start_prior: Annotated[tuple[Share, Share], row(2, "give 2 numbers")] = (0.5, 0.5)
    hypotheses: Annotated[int, integer(least=0, most=16)] = 0
    kidnapped: Share = 0.0
    kidnap_seconds: Annotated[tuple[NonNegative, Positive], row(2, "give 2 numbers")] = (3.0, 12.0)
    closed_door: Share = 0.0
    door_width: Positive = 1.6
    detour: Annotated[tuple[Positive, Positive], row(2, "give 2 numbers")] = (1.3, 4.0)
    slip: NonNegative = 0.0
    slip_radius: Positive = 2.0
    goal_std: Positive | None = None
    walls_std: Annotated[float, number(least=0, most=MOST_WALLS_STD)] = 0.0
    furniture_std: NonNegative = 0.0
    pose_latency: NonNegative = 0.0
    scan_time: Annotated[float, number(least=0, most=1)] = 0.0
    gain_std: Share = 0.0
    actuation_std: Share = 0.0
    difficulty: Annotated[int, integer(least=0, most=len(LEVELS) - 1)] = 0
    task: Annotated[str | None, BeforeValidator(_task)] = None

    def __new__(cls, **values: Any) -> NavigationParameters:
        """Record which fields are given: `difficulty` sets the others."""
        made = super().__new__(cls)
        if values:
            made._set("_given", frozenset(values))
        return made

    def __post_init__(self) -> None:
        """Check every field and convert it to its type."""
        mcl: object = self.mcl
        if isinstance(mcl, Mapping):
            self._set("mcl", None)
        check_fields(self)
        assigned = vars(self).pop("_given", ())
        for name, value in LEVELS[self.difficulty].items():
            if name not in assigned:
                self._set(name, value)
        if self.difficulty:
            check_fields(self)
        if isinstance(mcl, Mapping):
            # Values that depend on the scanner, which has its type only now.
            self._set("mcl", {**settings_for(self.scanner, mcl.get("laser_model_type")), **mcl})
            check_fields(self)
        low, high = self.obstacle_sizes
        require(self, "obstacle_sizes", low <= high, "the least and the greatest edge")
        low, high = self.kidnap_seconds
        require(self, "kidnap_seconds", low <= high, "the first and the last moment")
        end = self.max_steps * self.dt
        if self.kidnapped and low >= end:
            raise InputError(
                f"kidnap_seconds is ({low:g}, {high:g}) and an episode ends after {end:g} s, so "
                "that nobody is kidnapped; give earlier moments or more max_steps."
            )
        longest = MOST_LATE * self.dt
        require(self, "pose_latency", self.pose_latency <= longest, f"at most {longest:g} seconds")
        low, high = self.detour
        require(self, "detour", 1.0 < low <= high, "two numbers above 1, the second not less")
        if self.belief and self.discrete:
            raise InputError("belief is true and discrete too; a belief takes continuous actions.")
        for name in ("start_unknown", "start_aliases"):
            if getattr(self, name) and self.localizer not in GLOBAL:
                value = str(getattr(self, name)).lower()
                raise InputError(
                    f"{name} is {value} and localizer {self.localizer!r}, which needs a first "
                    f"estimate; give localizer={GLOBAL[0]!r}."
                )
        low, high = self.start_prior
        require(self, "start_prior", 0.0 < low <= high < 1.0, "two probabilities between 0 and 1")
        speed = self.robot.max_speed
        require(self, "min_speed", -speed <= self.min_speed <= 0.0, f"{-speed:g} to 0")
        require(
            self, "longest", self.longest > self.shortest, f"more than shortest, {self.shortest:g}"
        )
        radius = self.goal_radius
        bound_text = f"at least goal_radius, {radius:g}"
        require(self, "success_radius", self.success_radius >= radius, bound_text)
        if not self.ambiguity_seen and self.waypoint and self.ambiguity_weight > 0.0:
            raise InputError(
                f"ambiguity_seen is False and ambiguity_weight is {self.ambiguity_weight:g}, by "
                "which the waypoint would show the ambiguity map; give waypoint=False or "
                "ambiguity_weight=0."
            )
        if self.layer is not None:
            check_known(self.layer)
        if isinstance(self.reward, Mapping):
            self._set("reward", dict(self.reward))
        weights_of(self.reward)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> NavigationParameters:
        """Create the parameters from a mapping; missing fields get their defaults.

        Raises:
            InputError: a name is unknown (the nearest is offered), or a value makes no sense.
        """
        check_kind(values, Mapping, "values", "give a mapping of names to values")
        return from_mapping(cls, values)

    @property
    def columns(self) -> int:
        """Numbers of an action: speed, turn rate, one for each declaration, and the belief."""
        return MOTIONS + len(self.declare) + (NUMBERS if self.belief else 0)

    @property
    def weights(self) -> tuple[float, ...]:
        """Weight of each built-in term of the reward, in the order of `rewards.TERMS`."""
        weights = weights_of(self.reward)
        return tuple(weights[term] for term in TERMS)

    @property
    def plugged_terms(self) -> tuple[tuple[RewardTerm, float], ...]:
        """Reward terms of plug-ins, with their weights."""
        weights = weights_of(self.reward)
        return tuple(
            (REWARD_TERMS.get(term), weight)
            for term, weight in weights.items()
            if term not in TERMS
        )

    @property
    def plugged_parts(self) -> tuple[ObservationPart, ...]:
        """Observation parts of plug-ins."""
        return tuple(map(OBSERVATIONS.get, self.observations))

    @property
    def cost_layer(self) -> str:
        """The layer of the ambiguity map for reward, exposure and window."""
        return cost_layer(self.scanner) if self.layer is None else self.layer

    @property
    def late_steps(self) -> int:
        """Delay of the observed estimate, steps."""
        return 0 if self.localizer == "perfect" else round(self.pose_latency / self.dt)

    @property
    def true_odometry(self) -> OdometryNoise:
        """Noise model of the true odometry."""
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
