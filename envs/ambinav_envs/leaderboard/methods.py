"""The methods that are compared: followers of planned routes, and policies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from ambinav.config import as_number
from ambinav.drive.course import Course
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.parameters import FollowerParameters
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Bools
from ambinav.runtime.errors import InputError
from ambinav_envs.commands import by_filter
from ambinav_envs.evaluation import EpisodeDriver
from ambinav_envs.leaderboard.follow import Followers
from ambinav_envs.leaderboard.routes import PlannerChoice, Routes
from ambinav_envs.leaderboard.waypoint import AHEAD, SEES, WEIGHTS, WaypointFollower, follower_name
from ambinav_envs.parameters import MOST_AMBIGUITY_WEIGHT, NavigationParameters
from ambinav_envs.policies import load_policy
from ambinav_envs.policies.load import checksum_of
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.policies.policy import CallablePolicy, Policy
from ambinav_envs.policies.reactive.policy import REACTIVE, ReactivePolicy
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.twins import TRUE_POSE as BY_TRUTH

SHORTEST: Final = "shortest"
"""Name of the method that the others are compared with."""
TRUE_POSE: Final = f"{SHORTEST}, true pose"
"""The same one in the twin without localization error."""

PLANNERS: Final = {
    SHORTEST: PlannerChoice("reference", 0.0),
    "reference 5": PlannerChoice("reference"),
    "prmstar 5": PlannerChoice("prmstar"),
    "belief 5": PlannerChoice("belief"),
}
"""The planners of a leaderboard for which nobody names others."""
STEERS: Final = {"discrete": False}
"""Environment arguments of methods that steer by speed and turn rate."""


@dataclass(frozen=True, eq=False)
class Method:
    """A method that takes part in the comparison.

    Attributes:
        name: In tables.
        kind: "planner" or "policy".
        text: Description for readers.
        identity: Plain values that its episodes depend on.
        seeing: Arguments of the environment that it brings along, see `Policy.seeing`; all others
            are the same for everybody.
        make: Makes what drives, of the parameters that the environment has.
        shipped: Whether it takes part without being asked for, if it fits.
    """

    name: str
    kind: str
    text: str
    identity: dict[str, Any]
    seeing: dict[str, Any] = field(default_factory=dict)
    make: Callable[[NavigationParameters], EpisodeDriver | Policy] = WaypointFollower
    shipped: bool = False


class RouteFollower:
    """Plans a route for each episode and follows it by the estimated pose.

    Args:
        choice: The planner.
        layer: Layer of the ambiguity map that it reads.
        odometry: See `Routes`.
        start_std: See `Routes`.

    Attributes:
        routes: All that it has planned; they may be kept and given to another one.
    """

    def __init__(
        self,
        choice: PlannerChoice,
        layer: str = "level",
        odometry: OdometryNoise | None = None,
        start_std: tuple[float, float, float] | None = None,
    ) -> None:
        self.routes = Routes(choice, layer, odometry, start_std)
        self._followers: Followers | None = None

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Plan from the true start to the goal of each episode; without a route a robot stands."""
        parameters = simulation.parameters
        buildings = [site.building for i in rows if (site := simulation.sites[i]) is not None]
        tasks = [task for i in rows if (task := simulation.tasks[i]) is not None]
        courses: list[Course | None] = [None] * simulation.count
        for i, poses in zip(rows, self.routes.plan(buildings, tasks), strict=True):
            courses[i] = None if poses is None else Course.of(poses, Steering())
        # The environment ends an episode before the follower would stop.
        near = min(FollowerParameters.xy_goal_tolerance, 0.8 * parameters.goal_radius)
        follow = replace(
            FollowerParameters(),
            desired_linear_vel=parameters.robot.max_speed,
            xy_goal_tolerance=near,
        )
        self._followers = Followers(courses, parameters.robot, follow, parameters.dt)

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Return the follower's actions."""
        if self._followers is None:
            raise RuntimeError("begin was not called")
        state, parameters = simulation.state, simulation.parameters
        want = self._followers.steer(simulation.seen()[0], state["speeds"])
        return by_filter(want, observations, parameters)


def planner_method(name: str, choice: PlannerChoice) -> Method:
    """Return a method that follows a planner's routes by speed and turn rate."""
    text = f"planner {choice.planner}, weight {choice.weight:g}, followed by pure pursuit"
    return Method(
        name, "planner", text, {"route": asdict(choice)}, dict(STEERS),
        lambda parameters: RouteFollower(
            choice, parameters.cost_layer, parameters.odometry, parameters.start_std
        ),
    )  # fmt: skip


def follower_method(ambiguity_weight: float) -> Method:
    """Return a method that drives from waypoint to waypoint.

    Raises:
        InputError: the weight is none of those that an environment takes.
    """
    ambiguity_weight = as_number(ambiguity_weight, "ambiguity_weight")
    if not 0.0 <= ambiguity_weight <= MOST_AMBIGUITY_WEIGHT:
        raise InputError(
            f"ambiguity_weight is {ambiguity_weight:g}; give 0 to {MOST_AMBIGUITY_WEIGHT:g}."
        )
    path = f"cheapest path at weight {ambiguity_weight:g}" if ambiguity_weight else "shortest path"
    name = follower_name(ambiguity_weight)
    return Method(
        name, "policy", f"drives at the point {AHEAD:g} m ahead on the {path}", {"name": name},
        {**SEES, **STEERS, "ambiguity_weight": ambiguity_weight},
    )  # fmt: skip


def true_pose_method() -> Method:
    """Return the follower of shortest routes in the twin without localization error."""
    blind = planner_method(SHORTEST, PLANNERS[SHORTEST])
    text = f"{blind.text}, by the true pose"
    return replace(blind, name=TRUE_POSE, text=text, seeing={**blind.seeing, **BY_TRUTH})


def planner_methods(names: Sequence[str]) -> list[Method]:
    """Return the planners named NAME or NAME:WEIGHT; shortest paths are always included.

    Args:
        names: None of them: `PLANNERS`.

    Raises:
        InputError: a planner is unknown, or a weight is no number from 0 on.
    """
    if not names:
        return [planner_method(name, choice) for name, choice in PLANNERS.items()]
    methods = [planner_method(SHORTEST, PLANNERS[SHORTEST])]
    for name_and_weight in names:
        if name_and_weight == SHORTEST:
            raise InputError(
                f"--planner: the method {SHORTEST!r}, routes of {PLANNERS[SHORTEST].planner} at "
                "weight 0, always takes part; leave it out."
            )
        name, colon, number = name_and_weight.partition(":")
        try:
            weight = float(number) if colon else 5.0
        except ValueError:
            weight = -1.0
        if not 0.0 <= weight < float("inf"):
            raise InputError(
                f"--planner: the weight in {name_and_weight!r} is none; give e.g. prmstar:5."
            )
        choice = PlannerChoice(name, weight)
        Routes(choice)
        methods.append(planner_method(f"{name} {weight:g}", choice))
    return methods


def policy_method(
    source: str, folder: Path | None = None, *, shipped: bool = False, trust: bool = False
) -> Method:
    """Return the method of a policy named by a user.

    Raises:
        InputError: see `load_policy`.
    """
    policy = load_policy(source, folder, trust=trust)
    if isinstance(policy, ReactivePolicy):
        identity = {"reactive": policy.checksum}
        text = policy.baseline.title
    elif isinstance(policy, CallablePolicy):
        identity = {"callable": source, "code": checksum_of(source, policy, folder)}
        text = f"policy {source}, code that was trusted (--trust)"
    else:
        identity = {"file": checksum_of(source, policy, folder)}
        text = f"policy {policy.name}.zip"
    return Method(
        policy.name, "policy", text, identity, policy.seeing, lambda parameters: policy, shipped
    )


def all_methods(
    planners: Sequence[str], policies: Sequence[str], *, trust: bool = False, shipped: bool = True
) -> list[Method]:
    """Return all methods in the order of the table.

    Args:
        planners: See `planner_methods`.
        policies: Values that `load_policy` takes, besides the baselines.
        trust: Run policies that are code, see `load_policy`.
        shipped: Whether the reactive baselines take part.

    Raises:
        InputError: one is unknown, or two have the same name.
    """
    methods = [
        *(follower_method(weight) for weight in WEIGHTS),
        *planner_methods(planners),
        true_pose_method(),
        *(
            policy_method(name, shipped=True)
            for name in REACTIVE
            if shipped and name not in policies
        ),
        *(policy_method(name, trust=trust) for name in dict.fromkeys(policies)),
    ]  # fmt: skip
    names = [method.name for method in methods]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two methods are called {name!r}; rename a policy's file.")
    return methods
