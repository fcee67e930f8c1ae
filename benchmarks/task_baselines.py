"""Baselines without learning for the tasks of `study_tasks.py`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.frames import wrap_angles
from ambinav.runtime.array_types import Bools
from ambinav.runtime.kernels import kernel
from ambinav_envs.buildings.doors import closed_table
from ambinav_envs.buildings.tasks import CostToGo, spread_from
from ambinav_envs.commands import at_goal, by_filter
from ambinav_envs.evaluation import EpisodeDriver
from ambinav_envs.leaderboard.waypoint import SEES, WaypointFollower
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.load import load_policy
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.policies.policy import Policy
from ambinav_envs.simulation.layout import MOTIONS, RUNNING
from ambinav_envs.simulation.observe import ahead, polar
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.spaces import action_space, observation_space

Floats = NDArray[np.float64]
# Room beside the robot's disc that the histogram keeps, metres.
BESIDE = 0.06
# It stops where less is free ahead, and slows down from twice so much on, metres.
STOP = 0.12
# Metres that a direction is looked along.
LOOK = 1.2
# Radians a metre of what is not free costs, when directions are compared.
BLOCKED = 3.0
# A reading that ends so far off all mapped walls is of something that the map lacks, metres.
OFF_WALLS = 0.3
# From this deviation on a robot is unsure, metres.
UNSURE = 0.3
# Seconds after which `Helped` calls for help: later than any kidnapping.
CALL = 13.0
# Seconds for which `Informed` drives where there is room, when its estimate is wrong.
AWAY = 4.0


class Constant(Policy):
    """Always the same motion, and no declaration; None: a random action in every step."""

    def __init__(
        self, name: str, motion: tuple[float, float] | None, parameters: NavigationParameters
    ) -> None:
        super().__init__(name, {"discrete": False})
        self._motion, self._columns = motion, parameters.columns
        self._rng = np.random.default_rng(0)

    def prepare(self, observation_space: Any, action_space: Any) -> None:
        """Do nothing: it needs no preparation."""

    def act(self, observations: Observation, starts: Bools) -> Any:
        """Return the action."""
        if self._motion is None:
            return self._rng.uniform(-1.0, 1.0, (len(starts), self._columns))
        actions = np.full((len(starts), self._columns), -1.0)
        actions[:, :2] = self._motion
        return actions


class Histogram(Policy):
    """Drives towards a point of the observation in the nearest free direction of the scan.

    Args:
        parameters: Parameters of the environment.
        point: "waypoint" or "goal".
        wander: Drive where there is room while the estimate is unsure.
    """

    def __init__(
        self, parameters: NavigationParameters, point: str = "waypoint", wander: bool = False
    ) -> None:
        super().__init__("histogram", {"discrete": False})
        self._p, self._point, self._wander = parameters, point, wander
        scanner = parameters.scanner
        self._angle = np.asarray(scanner.mounts)[:, 2]
        self._far = scanner.sensors[0].max_range
        gap = np.abs(np.diff(np.sort(self._angle))).max()
        self._all_round = bool(np.ptp(self._angle) + gap > 2.0 * np.pi - 1e-6)
        self._radius = parameters.robot.radius + BESIDE

    def prepare(self, observation_space: Any, action_space: Any) -> None:
        """Do nothing: it needs no preparation."""

    def act(self, observations: Observation, starts: Bools) -> Any:
        """Turn towards the best direction; drive as far as it is free."""
        return self.towards(observations, observations[self._point])

    def towards(self, seen: Observation, point: NDArray[np.float32]) -> Floats:
        """Return actions towards points like `goal`, shape (N, 3)."""
        robot, turning = self._p.robot, self._p.robot.max_turn_rate
        distance, target = 10.0 * point[:, 0], np.arctan2(point[:, 2], point[:, 1])
        free = self._free(self._far * seen["scan"].astype(np.float64), self._angle)
        look = np.minimum(LOOK, distance)[:, np.newaxis]
        if self._wander:
            unsure = seen["uncertainty"][:, 0] > UNSURE
            target, look = np.where(unsure, 0.0, target), np.where(unsure[:, None], LOOK, look)
        off = np.abs(wrap_angles(self._angle - target[:, np.newaxis]))
        cost = off + BLOCKED * np.maximum(look - free, 0.0) / LOOK
        best = cost.argmin(axis=1)
        each = np.arange(len(best))
        # Straight to the point if nothing is in between.
        turn = np.where(off[each, best] < np.pi / len(self._angle), target, self._angle[best])
        if not self._all_round:
            beyond = np.abs(target) > np.abs(self._angle).max() + 0.1
            turn = np.where(beyond, target, turn)
        room = self._free(self._far * seen["scan"].astype(np.float64), np.zeros(1))[:, 0]
        speed = robot.max_speed * np.clip((room - STOP) / STOP, 0.0, 1.0)
        speed *= np.clip(1.6 * np.cos(turn) - 0.6, 0.0, 1.0)
        rate = np.clip(2.5 * turn, -turning, turning)
        want = np.stack([speed, rate], axis=1)
        return by_filter(want, seen, self._p)

    def _free(self, ranges: Floats, directions: Floats) -> Floats:
        """Return the metres that the disc can drive in each direction, shape (N, D)."""
        out = np.empty((len(ranges), len(directions)))
        _free(ranges, self._angle, directions, self._radius, self._far, out)
        return out


class Bold(Histogram):
    """The histogram that says it has arrived wherever its estimate is at the goal, sure or not."""

    def __init__(self, parameters: NavigationParameters) -> None:
        super().__init__(replace(parameters, goal_std=None))


class Helped(Bold):
    """Calls for help once, whatever it sees, and then trusts its estimate, sure or not."""

    def __init__(self, parameters: NavigationParameters) -> None:
        super().__init__(parameters)
        self._steps: NDArray[np.int64] | None = None

    def act(self, observations: Observation, starts: Bools) -> Any:
        """Drive, and call at `CALL` seconds for as long as a declaration takes."""
        p = self._p
        if self._steps is None:
            self._steps = np.zeros(len(starts), dtype=np.int64)
        self._steps = np.where(starts, 0, self._steps + 1)
        actions: Floats = super().act(observations, starts)
        if "lost" in p.declare:
            since = self._steps * p.dt - (0.0 if p.start_unknown else CALL)
            calls = (since >= 0.0) & (since < p.declare_seconds + p.dt)
            actions[calls, MOTIONS + p.declare.index("lost")] = 1.0
        return actions


class Informed:
    """A reactive baseline by the same estimate, with perfect knowledge of when that is right.

    It declares its arrival where it truly has arrived, and nowhere else; where only its estimate is
    at the goal it drives away and comes back. So it obeys the rules of the task but for one thing,
    and bounds what knowing its own error is worth to that baseline.
    """

    def __init__(self, parameters: NavigationParameters, name: str) -> None:
        self._p, self._away = parameters, Histogram(parameters)
        self._drive = load_policy(name, None)
        self._drive.configure(parameters)
        self._until = np.zeros(0)

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Note that nobody is on its way back."""
        self._drive.prepare(observation_space(self._p), action_space(self._p))
        self._until = np.zeros(simulation.count)

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Drive, and declare what is true."""
        p, state = self._p, simulation.state
        off = np.hypot(*(state["truth"][:, :2] - state["goal"]).T)
        believed = at_goal(observations, p)
        now = state["steps"] * p.dt
        self._until = np.where(believed & (off > p.success_radius), now + AWAY, self._until)
        ahead_of_it = np.tile(np.float32([1.0, 1.0, 0.0]), (len(off), 1))
        elsewhere = {**observations, "goal": ahead_of_it}
        away = (now < self._until)[:, None]
        actions = np.where(
            away, self._away.towards(elsewhere, ahead_of_it), self._drive.act(observations, starts)
        )
        if "arrived" in p.declare:
            arrived = believed & (off <= p.success_radius)
            actions[:, MOTIONS + p.declare.index("arrived")] = np.where(arrived, 1.0, -1.0)
        return actions


class Oracle:
    """The histogram along the route in the true world, by the true pose."""

    def __init__(self, parameters: NavigationParameters) -> None:
        self._drive = Histogram(parameters)
        self._ways: list[Any] = []

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Compute the route of each episode."""
        self._ways = [None] * simulation.count
        for i in rows:
            site, task = simulation.sites[i], simulation.tasks[i]
            assert site is not None and task is not None
            table = site.lattice.table
            if task.door is not None:
                table = closed_table(table, task.door, simulation.parameters.robot.radius)
            self._ways[i] = CostToGo.of(task.cost_to_go.costs, table).towards, site.lattice.frame

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Drive along the route."""
        points = np.zeros((simulation.count, 3), dtype=np.float32)
        for i, path in enumerate(self._ways):
            if path is not None:
                state = simulation.state[i]
                x, y, theta = state["truth"]
                wx, wy = ahead(x, y, state["goal"], SEES["waypoint_distance"], *path)
                polar(x, y, np.cos(theta), np.sin(theta), wx, wy, points, i)
        return self._drive.towards(observations, points)


class Replanner:
    """The histogram along the shortest path, replanned around unmapped obstacles.

    A reading that ends off all mapped walls counts once it was seen thrice in the same decimetre.
    """

    def __init__(self, parameters: NavigationParameters) -> None:
        self._drive = Histogram(parameters)
        self._angle = np.asarray(parameters.scanner.mounts)[:, 2]
        self._radius = parameters.robot.radius
        self._seen: list[dict[tuple[float, ...], int]] = []
        self._tables: list[Any] = []
        self._towards: list[Any] = []
        self._step = 0

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Begin with the paths of the map."""
        self._seen = [{} for _ in range(simulation.count)]
        self._tables, self._towards = [None] * simulation.count, [None] * simulation.count
        for i in rows:
            site, task = simulation.sites[i], simulation.tasks[i]
            assert site is not None and task is not None
            self._tables[i] = site.lattice.table
            self._towards[i] = task.cost_to_go.towards

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Read the scan, replan where that is needed, and drive."""
        points = np.zeros((simulation.count, 3), dtype=np.float32)
        self._step += 1
        for i, table in enumerate(self._tables):
            state = simulation.state[i]
            if table is None or state["outcome"] != RUNNING:
                continue
            if self._step % 3 == 0:
                self._look(i, simulation)
            frame = (table.low_x, table.low_y, 1.0 / table.spacing)
            x, y, theta = simulation.seen()[0][i]
            distance = SEES["waypoint_distance"]
            wx, wy = ahead(x, y, state["goal"], distance, self._towards[i], frame)
            polar(x, y, np.cos(theta), np.sin(theta), wx, wy, points, i)
        return self._drive.towards(observations, points)

    def _look(self, i: int, simulation: Simulation) -> None:
        site, (x, y, theta) = simulation.sites[i], simulation.seen()[0][i]
        assert site is not None
        reading = simulation.readings[i]
        good = np.isfinite(reading) & (reading < 2.5)
        angle = theta + self._angle[good]
        px, py = x + reading[good] * np.cos(angle), y + reading[good] * np.sin(angle)
        environment = site.building.environment
        off = np.asarray(environment.clearance(px, py, 1.0)) > OFF_WALLS
        fresh = []
        for cell in map(tuple, (10 * np.stack([px, py], axis=1)[off]).round().tolist()):
            self._seen[i][cell] = self._seen[i].get(cell, 0) + 1
            if self._seen[i][cell] == 3:
                fresh.append(cell)
        if fresh:
            for cx, cy in fresh:
                point = np.array([0.1 * cx, 0.1 * cy, 0.0, 0.0, 0.0, 0.0])
                self._tables[i] = closed_table(self._tables[i], point, self._radius)
            goal = simulation.state["goal"][i]
            costs = np.empty(site.lattice.room.shape, dtype=np.float32)
            spread_from(goal[0], goal[1], self._tables[i], costs)
            self._towards[i] = CostToGo.of(costs, self._tables[i]).towards


@dataclass(frozen=True)
class Baseline:
    """One row of a table.

    Attributes:
        text: Description for readers.
        make: Makes it of the environment's parameters.
        seeing: Arguments of the environment that it brings along.
        kind: "baseline"; "exploit", of which nothing is expected; "oracle".
    """

    text: str
    make: Callable[[NavigationParameters], EpisodeDriver | Policy]
    seeing: dict[str, Any] = field(default_factory=dict)
    kind: str = "baseline"


def _constant(name: str, action: tuple[float, float] | None) -> Baseline:
    return Baseline(name, lambda parameters: Constant(name, action, parameters), {}, "exploit")


_AWARE = {**SEES, "ambiguity_weight": 5.0}
BASELINES: dict[str, Baseline] = {
    "random": _constant("any action", None),
    "standing": _constant("stands", (-1.0, 0.0)),
    "spinning": _constant("turns on the spot", (-1.0, 1.0)),
    "circling": _constant("drives in circles", (0.5, 0.5)),
    "ramming": _constant("straight on at full speed", (1.0, 0.0)),
    "waypoint": Baseline("waypoints of the shortest path", WaypointFollower, SEES),
    "waypoint-5": Baseline("waypoints of the aware route", WaypointFollower, _AWARE),
    "histogram": Baseline("histogram, shortest path", Histogram, SEES),
    "histogram-5": Baseline("histogram, aware route", Histogram, _AWARE),
    "histogram-20": Baseline(
        "the same at a weight of 20", Histogram, {**SEES, "ambiguity_weight": 20.0}
    ),
    "histogram-100": Baseline(
        "the same at a weight of 100", Histogram, {**SEES, "ambiguity_weight": 100.0}
    ),
    "wander-5": Baseline(
        "at a weight of 5; wanders while unsure", lambda p: Histogram(p, wander=True), _AWARE
    ),
    "replanner": Baseline("histogram; plans again around what the map lacks", Replanner),
    "goal": Baseline("histogram, straight at the goal", lambda p: Histogram(p, "goal")),
    "bold-5": Baseline("histogram at a weight of 5; declares also while unsure", Bold, _AWARE),
    "bold-100": Baseline("the same at a weight of 100", Bold, {**SEES, "ambiguity_weight": 100.0}),
    "helped": Baseline("histogram; calls for help once, and is bold", Helped, SEES),
    "informed": Baseline(
        "VFH+, aware route; knows when its estimate is right",
        lambda p: Informed(p, "vfh-aware"),
        load_policy("vfh-aware", None).seeing,
        "oracle",
    ),
    "informed-paced": Baseline(
        "VFH+, paced; knows when its estimate is right",
        lambda p: Informed(p, "vfh-paced"),
        load_policy("vfh-paced", None).seeing,
        "oracle",
    ),
    "oracle": Baseline(
        "true pose, route in the true world", Oracle, {"localizer": "perfect"}, "oracle"
    ),
}
"""Baselines of the tables, by name; see `baseline` for any other."""


def baseline(name: str) -> Baseline:
    """Return one of `BASELINES`, or a policy by what `load_policy` takes.

    Raises:
        InputError: there is none.
    """
    if name in BASELINES:
        return BASELINES[name]
    policy = load_policy(name, None)
    return Baseline(f"policy {policy.name}", lambda parameters: policy, policy.seeing)


@kernel
def _free(ranges, angle, directions, radius, far, out):
    for d in range(directions.size):
        co, si = np.cos(angle - directions[d]), np.sin(angle - directions[d])
        for i in range(len(ranges)):
            least = far
            for b in range(angle.size):
                along, across = ranges[i, b] * co[b], ranges[i, b] * si[b]
                inside = radius * radius - across * across
                if inside > 0.0 and along > 0.0 and ranges[i, b] < far:
                    least = min(least, along - np.sqrt(inside))
            out[i, d] = max(least, 0.0)
