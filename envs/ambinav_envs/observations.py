"""The parts of the observation: each a row of float32, with its size and its bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from ambinav.plugins import Registry
from ambinav.runtime.array_types import Floats32
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.robot_states import Seen

CLUSTER: Final = 4
"""Numbers of a hypothesis in the observation."""

Bound = float | tuple[float, ...]


class SizeParameters(Protocol):
    """Parameters on which the size of a part may depend: a subset of `NavigationParameters`."""

    @property
    def scanner(self) -> RangeScanner:
        """The robot's scanner."""

    @property
    def window(self) -> bool:
        """True if there is a window of the ambiguity map."""

    @property
    def window_cells(self) -> int:
        """Side of the window, cells."""

    @property
    def waypoint(self) -> bool:
        """True if there is a waypoint."""

    @property
    def hypotheses(self) -> int:
        """Number of hypotheses of the localizer."""


@dataclass(frozen=True, kw_only=True)
class ObservationPart:
    """An entry of the registry.

    Attributes:
        name: Its key in the observation.
        unit: Unit of its values: "m", "1", or what each of them has.
        meaning: What the values are, in their order.
        size: How many values a robot gets with these parameters; 0: the part is off.
        low: Least value, one for all or one for each.
        high: Greatest value, likewise.
        function: The values of n robots at once, shape (n, size); see `robot_states.Seen`. None:
            it is one of ours, compiled into the step (`simulation.observe`).
    """

    name: str
    unit: str
    meaning: str
    size: Callable[[SizeParameters], int]
    low: Bound
    high: Bound
    function: Callable[[Seen], NDArray[np.generic]] | None = None

    def bounds(self, parameters: SizeParameters) -> tuple[Floats32, Floats32]:
        """Return least and greatest values, float32, shape (size,)."""
        shape = (self.size(parameters),)
        low, high = (
            np.broadcast_to(np.asarray(b, np.float32), shape).copy() for b in (self.low, self.high)
        )
        return low, high


# Highest values: 100 m for distances in units of 10 m, 2 m and 2 rad for deviations.
_POLAR: Final[dict[str, Any]] = {
    "unit": "10 m, 1, 1",
    "low": (0.0, -1.0, -1.0),
    "high": (10.0, 1.0, 1.0),
}

SCAN = ObservationPart(
    name="scan",
    unit="1",
    meaning="reading / maximum range; 0 too near, 1 no echo",
    size=lambda parameters: parameters.scanner.beams,
    low=0.0,
    high=1.0,
)
GOAL = ObservationPart(
    name="goal",
    meaning="distance in 10 m, cosine and sine of the bearing, from the estimated pose",
    size=lambda parameters: 3,
    **_POLAR,
)
VELOCITY = ObservationPart(
    name="velocity",
    unit="1",
    meaning="speed and turn rate of the wheels, as odometry measures them, in units of the highest",
    size=lambda parameters: 2,
    low=-1.0,
    high=1.0,
)
UNCERTAINTY = ObservationPart(
    name="uncertainty",
    unit="m, m, 1, 1, rad",
    meaning="deviation along the localizer's weak axis and across it, cosine and sine of the "
    "double angle of that axis in the robot's frame, deviation of the heading",
    size=lambda parameters: 5,
    low=(0.0, 0.0, -1.0, -1.0, 0.0),
    high=(2.0, 2.0, 1.0, 1.0, 2.0),
)
WINDOW = ObservationPart(
    name="window",
    unit="1",
    meaning="K x K cells around the estimated pose, rows from ahead to behind, each from left to "
    "right: ambiguity (1 where not free), then what is free (1) and what is not (0)",
    size=lambda parameters: 2 * parameters.window_cells**2 if parameters.window else 0,
    low=0.0,
    high=1.0,
)
WAYPOINT = ObservationPart(
    name="waypoint",
    meaning="as goal: a point ahead on the route (`ambiguity_weight`), from the estimate",
    size=lambda parameters: 3 if parameters.waypoint else 0,
    **_POLAR,
)
REMAINING = ObservationPart(
    name="remaining",
    unit="1",
    meaning="share of the episode's steps that is left",
    size=lambda parameters: 1,
    low=0.0,
    high=1.0,
)
HYPOTHESES = ObservationPart(
    name="hypotheses",
    unit="1, 10 m, 1, 1",
    meaning="for each of the heaviest clusters of particles, heaviest first: its share of the "
    "weight, and the goal as in `goal`, from its mean pose; zeros where there are no more",
    size=lambda parameters: CLUSTER * parameters.hypotheses,
    low=-1.0,
    high=10.0,
)

OBSERVATIONS: Final = Registry(
    "part of the observation",
    ObservationPart,
    "ambinav.observations",
    {
        "scan": "ambinav_envs.observations:SCAN",
        "goal": "ambinav_envs.observations:GOAL",
        "velocity": "ambinav_envs.observations:VELOCITY",
        "uncertainty": "ambinav_envs.observations:UNCERTAINTY",
        "window": "ambinav_envs.observations:WINDOW",
        "waypoint": "ambinav_envs.observations:WAYPOINT",
        "remaining": "ambinav_envs.observations:REMAINING",
        "hypotheses": "ambinav_envs.observations:HYPOTHESES",
    },
)
"""The parts of the observation: ours, which the step computes, and those of plug-ins."""
