"""Policies that drive step by step, in the world of a scenario."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ambinav.drive.drive import PATIENCE, SPARE, Controller, drive_route
from ambinav.drive.world import OUTCOMES
from ambinav.geometry.motion.steering import Steering
from ambinav.plugins import load_callable, load_module
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import ENVIRONMENTS, need
from ambinav.service.service import AmbiguityService

if TYPE_CHECKING:
    from ambinav.drive.robot import Robot
    from ambinav.geometry.environment import Environment
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.sensing.scanner import RangeScanner
    from ambinav.studies.compare.route_part import RoutePart
    from ambinav.studies.compare.scenario_file import ScenarioBundle
    from ambinav.studies.compare.scenario_schema import PairPart

STEP = 0.1
"""Metres between the waypoints of the route that a policy drives."""


class PolicyController(Controller, Protocol):
    """A policy that steers the robots of a drive."""

    @property
    def distance(self) -> float:
        """Length of the shortest path from start to goal, metres."""


@dataclass(frozen=True)
class Driver:
    """A driving policy as plain values.

    Attributes:
        source: Name of the policy in the scenario.
        folder: Folder to which file names are relative.
        start: x, y of its pair, and any heading.
        goal: x and y.
        checksum: See `ambinav_envs.policies.load.checksum_of`.
        differs: Differences of scanner and robot from those of the training, in words; empty
            if they do not.
        trust: Whether it may be code.
    """

    source: str
    folder: str
    start: tuple[float, float, float]
    goal: tuple[float, float]
    checksum: str
    differs: str = ""
    trust: bool = False


def is_controller(source: str, folder: Path, trust: bool = False) -> bool:
    """Return whether a scenario's policy drives step by step; otherwise it makes a route.

    Those that drive are policy files, reactive baselines, and callables that take two arguments, an
    observation and an action space. One that makes routes takes four.

    Raises:
        InputError: there is no such callable, or it is not trusted.
    """
    if source.endswith(".zip"):
        return True
    if ":" not in source and not source.endswith(".py"):
        return True
    if not trust:
        raise InputError(
            f"policy {source!r} is code that would run with your rights; if you trust it, add "
            "--trust (trust=True in Python)"
        )
    function = load_callable(source, folder)
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return False
    return not _takes(signature, 4) and _takes(signature, 2)


def _takes(signature: inspect.Signature, count: int) -> bool:
    try:
        signature.bind(*[None] * count)
    except TypeError:
        return False
    return True


def driver_of(loaded: ScenarioBundle, pair: PairPart, part: RoutePart) -> Driver:
    """Return the policy of a route; loading it checks that it can be loaded.

    Raises:
        InputError: see `ambinav_envs.policies.load_policy`; it was trained with another scanner or
            robot, and that is not forced; or Gymnasium is missing.
    """
    source, folder = str(part.policy), Path(loaded.folder)
    scenario = loaded.scenario
    checksum, differs = _import_policies().examine(
        source, folder, loaded.scanner, scenario.robot, scenario.drive.rate, loaded.force,
        loaded.trust,
    )  # fmt: skip
    (x, y), (goal_x, goal_y) = pair.start[:2], pair.goal[:2]
    goal = (goal_x, goal_y)
    return Driver(source, str(folder), (x, y, 0.0), goal, checksum, differs, loaded.trust)


def controller_of(
    driver: Driver,
    environment: Environment,
    scanner: RangeScanner,
    robot: Robot,
    rate: float,
    runs: int,
) -> PolicyController:
    """Create the controller of a drive (`ambinav_envs.policies.driving.PolicyController`)."""
    made: PolicyController = _import_policies().PolicyController(
        driver.source,
        Path(driver.folder),
        driver.start,
        driver.goal,
        environment,
        scanner,
        robot,
        rate,
        runs,
        driver.trust,
    )
    return made


def driven_route(loaded: ScenarioBundle, amap: AmbiguityMap, driver: Driver) -> Route:
    """Return the path that a policy drives with known pose and without unmapped obstacles.

    Raises:
        InputError: it does not get to the goal, or see `controller_of`.
    """
    scenario = loaded.scenario
    how, robot = scenario.drive, scenario.robot
    controller = controller_of(driver, loaded.environment, loaded.scanner, robot, how.rate, runs=1)
    service = AmbiguityService(amap, scenario.map.layer)
    straight = np.array([driver.start, (*driver.goal, 0.0)])
    drives = drive_route(
        loaded.environment,
        loaded.scanner,
        robot,
        evaluate_route(service, straight, Steering(), planner="straight"),
        "perfect",
        np.random.default_rng(how.seed),
        1,
        follower=scenario.follower,
        rate=how.rate,
        max_time=how.max_time or PATIENCE * controller.distance / robot.max_speed + 2.0 * SPARE,
        controller=controller,
    )
    driven = drives.truth[0, : drives.samples[0]]
    if not drives.reached[0]:
        x, y = driven[-1, :2].tolist()
        raise InputError(
            f"policy {driver.source} does not reach the goal even with the true pose "
            f"({OUTCOMES[drives.outcome[0]]} at ({x:.2f}, {y:.2f}) m); choose another policy or "
            "pair"
        )
    spaced = [driven[0]]
    for pose in driven:
        if np.hypot(*(pose - spaced[-1])[:2]) >= STEP:
            spaced.append(pose)
    poses = np.array([*spaced, (*driver.goal, 0.0)])
    return evaluate_route(service, poses, Steering(), planner=f"policy {driver.source}")


def _import_policies() -> ModuleType:
    """Import the environments' module of driving policies by its name."""
    need("a policy that drives", ENVIRONMENTS)
    return load_module("ambinav_envs.policies.driving", Path())
