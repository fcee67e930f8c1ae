"""Reactive baselines as policies: `vfh`, `dwa`, and the same on the ambiguity-aware route."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ambinav.drive.robot import Robot
from ambinav.geometry.frames import wrap_angles
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import code_digest, digest_of
from ambinav_envs.commands import by_filter
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.policies.policy import Policy
from ambinav_envs.policies.reactive.dwa import Dwa
from ambinav_envs.policies.reactive.echoes import ScanPoints, nearest_by_direction
from ambinav_envs.policies.reactive.memory import EchoFilter, EchoMemory
from ambinav_envs.policies.reactive.pace import Pace
from ambinav_envs.policies.reactive.parameters import DwaParameters, VfhParameters
from ambinav_envs.policies.reactive.situation import Situation
from ambinav_envs.policies.reactive.vfh import Vfh
from ambinav_envs.policies.shapes import described, misfit

AWARE: Final = 5.0
"""`ambiguity_weight` of the aware route."""
AHEAD: Final = 1.0
"""Metres that the waypoint is ahead on the route; farther on it lies behind more corners."""
KEPT: Final = 0.5
"""Time between the scans that are remembered, seconds."""
MOST_POINTS: Final = 120
"""Number of directions; of a scan with more points the nearest in each direction is kept."""
SIZES: Final = {"goal": 3, "velocity": 2, "waypoint": 3}
"""Parts of the observation that are read besides the scan."""


class Steering(Protocol):
    """The algorithm that computes speeds: `Vfh` or `Dwa`."""

    def command(self, now: Situation) -> Floats:
        """Return the commanded speed (m/s) and turn rate (rad/s) of each robot, shape (N, 2)."""


@dataclass(frozen=True)
class Baseline:
    """A reactive baseline.

    Attributes:
        title: Description for readers.
        parameters: `VfhParameters` or `DwaParameters`.
        make: Makes what steers, of a robot and the time step in seconds.
        ambiguity_weight: Ambiguity weight of the route that its waypoint is on.
        paced: Whether it drives as slowly as its time permits, see `Pace`.
    """

    title: str
    parameters: VfhParameters | DwaParameters
    make: Callable[[Robot, float], Steering]
    ambiguity_weight: float
    paced: bool = False


def _baselines() -> dict[str, Baseline]:
    baselines: dict[str, Baseline] = {}
    vfh, dwa = VfhParameters(), DwaParameters()
    for suffix, weight in (("", 0.0), ("-aware", AWARE)):
        path = f"cheapest path at weight {weight:g}" if weight else "shortest path"
        baselines[f"vfh{suffix}"] = Baseline(
            f"VFH+ towards the waypoint on the {path}",
            vfh, lambda robot, dt: Vfh(vfh, robot, dt), weight,
        )  # fmt: skip
        baselines[f"dwa{suffix}"] = Baseline(
            f"dynamic window approach towards the waypoint on the {path}",
            dwa, lambda robot, dt: Dwa(dwa, robot, dt), weight,
        )  # fmt: skip
    baselines["vfh-paced"] = replace(
        baselines["vfh-aware"],
        title=f"{baselines['vfh-aware'].title}, as slowly as its time permits",
        paced=True,
    )
    return baselines


REACTIVE: Final = _baselines()
"""The reactive baselines by name."""


class ReactivePolicy(Policy):
    """Computes actions from scan, waypoint and speeds by a fixed rule.

    Any scanner, robot and time step will do: `configure` takes them in. Until then they are those
    of the environment by default.

    Args:
        name: One of `REACTIVE`.
    """

    def __init__(self, name: str) -> None:
        self.baseline = REACTIVE[name]
        seen = {"waypoint": True, "window": False, "discrete": False, "waypoint_distance": AHEAD}
        super().__init__(name, {**seen, "ambiguity_weight": self.baseline.ambiguity_weight})
        self.configure(NavigationParameters())

    @property
    def checksum(self) -> str:
        """Checksum of its parameters and of the code, which identifies its results."""
        return digest_of({"name": self.name, **asdict(self.baseline.parameters)}, code_digest())

    def configure(self, parameters: NavigationParameters) -> None:
        """See `Policy`."""
        self._robot, self._dt = parameters.robot, parameters.dt
        self._parameters = parameters
        self._scan_points = ScanPoints(parameters.scanner)
        self._begin()

    def _begin(self) -> None:
        """Clear the memory of all robots."""
        seconds = self.baseline.parameters.memory
        self._filter = EchoFilter()
        self._memory = EchoMemory(self._scan_points, seconds, self._dt, KEPT)
        self._steering = self.baseline.make(self._robot, self._dt)
        self._pace = Pace(self._parameters)

    def state(self) -> tuple[Any, ...]:
        """Return the memory of all robots, for pickling; `restore` takes it."""
        return self._filter, self._memory, self._steering

    def restore(self, state: tuple[Any, ...]) -> None:
        """Continue from a state of the same environment."""
        self._filter, self._memory, self._steering = state

    def prepare(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
    ) -> None:
        """See `Policy`."""
        sizes = {"scan": self._scan_points.beams, **SIZES}
        why = misfit({"parts": {name: {"size": n} for name, n in sizes.items()}}, observation_space)
        if why is not None:
            raise InputError(f"policy {self.name!r} does not fit the environment: {why}.")
        columns = self._parameters.columns
        if described(action_space).get("size") != columns:
            raise InputError(
                f"policy {self.name!r} gives {columns} numbers: speed, turn rate and what it "
                "declares; make the environment with discrete=false, and configure the policy with "
                "its parameters."
            )
        self._begin()

    def act(self, observations: Observation, starts: Bools) -> Floats:
        """See `Policy`."""
        if not self.baseline.paced:
            return self.steer(observations, starts)
        self._pace.step(starts)
        return self.steer(observations, starts, limit=self._pace.share(observations["goal"]))

    def steer(
        self,
        observations: Observation,
        starts: Bools,
        swing: Floats | None = None,
        limit: Floats | None = None,
    ) -> Floats:
        """Return the action of each robot, shape (N, columns), with corrected target and speed.

        Args:
            observations: See `Policy.act`.
            starts: The same.
            swing: By how much the waypoint's bearing is turned, shape (N,), radians; None: not.
            limit: See `Situation`.
        """
        robot = self._robot
        velocity = _finite(observations["velocity"])
        speed, rate = velocity[:, 0] * robot.max_speed, velocity[:, 1] * robot.max_turn_rate
        # The speeds of a step apply since the previous step.
        turned = np.where(starts, 0.0, rate * self._dt)
        moved = np.where(starts, 0.0, speed * self._dt)
        x, y = self._scan_points.points(observations["scan"])
        x, y = nearest_by_direction(x, y, MOST_POINTS)
        x, y = self._filter.confirmed(x, y, turned, moved, starts)
        x, y = self._memory.recall(x, y, turned, moved, starts)
        distance, cosine, sine = _finite(observations["waypoint"]).T
        bearing = np.arctan2(sine, cosine)
        if swing is not None:
            turned_to = bearing + swing
            bearing = np.where(np.abs(turned_to) > math.pi, wrap_angles(turned_to), turned_to)
        now = Situation(x, y, 10.0 * distance, bearing, speed, rate, turned, starts, limit)
        want = self._steering.command(now)
        return np.clip(by_filter(want, observations, self._parameters), -1.0, 1.0)


def _finite(part: NDArray[Any]) -> Floats:
    return np.nan_to_num(part.astype(np.float64), nan=0.0, posinf=1.0, neginf=-1.0)
