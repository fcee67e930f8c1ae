"""Route: the poses that a planner found, and their cost on the map they were planned for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_array, check_kind
from ambinav.geometry.motion.steering import POSES, Steering
from ambinav.maps.zones import CORRIDOR, NOT_FREE, OPEN, ZONES
from ambinav.routes.clock import SpeedLimits, speed_profile
from ambinav.routes.progress import Progress, progress_along
from ambinav.runtime.array_types import Bytes, Floats
from ambinav.runtime.errors import InputError

BAD_ZONES = (ZONES[CORRIDOR], ZONES[OPEN])
"""Names of the zones in which a robot gets lost."""


@dataclass(frozen=True, eq=False)
class Route:
    """Poses from start to goal, N of them, and their figures.

    Make one with `ambinav.routes.evaluate.evaluate_route`, so that all routes are measured in the
    same way.

    Attributes:
        poses: float64, shape (N, 3): x, y in metres, heading in radians, map frame. `steering`
            defines the motion between two poses.
        steering: The kind of motion.
        planner: Name of the planner.
        seed: Seed of the planner's random numbers; None: not seeded.
        environment: Name of the environment.
        scanner: Name of the scanner.
        layer: Layer of the map in the cost.
        weight: Extra cost of a metre where the layer is 1, in metres.
        power: Exponent of the layer in the cost.
        clearance_weight: Extra cost of a metre along a wall, in metres.
        comfort: Distance from which walls add no cost, metres.
        length: Metres travelled; reverse counts as forwards.
        cost: Integral of the cost over the length, metres-equivalent.
        exposure: Integral of the layer over the length, metres.
        zone_metres: Metres travelled in each zone of the map, by name; with `unexplored_metres`
            they sum to `length`.
        unexplored_metres: Metres travelled where the map is unexplored, or outside of the
            building: these have no zone, and they end a stretch.
        longest_bad: The longest stretch in a row in `BAD_ZONES`, metres; it goes on where one of
            them borders on the other. Any piece of another zone ends a stretch, however short;
            what covers no distance, such as a turn on the spot, does not.
        longest_corridor: The same in corridor alone; an open zone ends it as any other does.
        longest_open: The same in open zones alone.
        turn: Sum of all turns, on the spot or on the path, radians.
        distance: Shape (N,): metres travelled up to each pose.
        spent: Shape (N,): cost up to each pose, metres-equivalent.
        levels: Shape (N,): the layer at each pose.
        zones: uint8, shape (N,): code of the zone at each pose; `NOT_FREE` where the map is
            unexplored.
        seconds: Time that the planner took.
        first_seconds: Time until the first route; None if not known.
        iterations: Iterations of the planner; None if it counts none.
        curve: (seconds, cost) of each improvement.
        covariances: Shape (N, 3, 3): predicted covariance of x, y, heading at each pose, or None.
        stamps: Shape (N,): seconds from the start at which a robot with `speed_limits` has each
            pose, after any turn on the spot; None if not known.
        speed_limits: Those that the stamps keep to; None if not known.
    """

    poses: Floats
    steering: Steering
    planner: str
    seed: int | None
    environment: str
    scanner: str
    layer: str
    weight: float
    power: float
    clearance_weight: float
    comfort: float
    length: float
    cost: float
    exposure: float
    zone_metres: dict[str, float]
    unexplored_metres: float
    longest_bad: float
    longest_corridor: float
    longest_open: float
    turn: float
    distance: Floats
    spent: Floats
    levels: Floats
    zones: Bytes
    seconds: float
    first_seconds: float | None
    iterations: int | None
    curve: tuple[tuple[float, float], ...]
    covariances: Floats | None
    stamps: Floats | None = None
    speed_limits: SpeedLimits | None = None

    @classmethod
    def through(
        cls, points: ArrayLike, steering: Steering | None = None, planner: str = "given"
    ) -> Route:
        """Make a route with unknown figures, all nan; `evaluate_route` measures them.

        Args:
            points: x, y in metres, or x, y and heading in radians, map frame, shape (N, 2 or 3).
                In "r2" the headings follow from the travel.
            steering: The kind of motion; None: straight, "r2".
            planner: Name of the planner.

        Raises:
            InputError: there are fewer than two points, of another shape, or not finite.
        """
        steering = steering or Steering()
        check_kind(steering, Steering, "steering")
        poses = as_array(points, "points", POSES)
        if poses.ndim == 2 and poses.shape[1] == 2:
            poses = np.column_stack([poses, np.zeros(len(poses))])
        poses = steering.oriented(poses)
        if len(poses) < 2:
            raise InputError(f"poses: a route needs two or more, and there are {len(poses)}.")
        unknown = np.full(len(poses), np.nan)
        return cls(
            poses=poses,
            steering=steering,
            planner=planner,
            seed=None,
            environment="",
            scanner="",
            layer="",
            weight=0.0,
            power=1.0,
            clearance_weight=0.0,
            comfort=0.0,
            length=np.nan,
            cost=np.nan,
            exposure=np.nan,
            zone_metres=dict.fromkeys(ZONES, np.nan),
            unexplored_metres=np.nan,
            longest_bad=np.nan,
            longest_corridor=np.nan,
            longest_open=np.nan,
            turn=np.nan,
            distance=unknown,
            spent=unknown,
            levels=unknown,
            zones=np.full(len(poses), NOT_FREE, dtype=np.uint8),
            seconds=0.0,
            first_seconds=None,
            iterations=None,
            curve=(),
            covariances=None,
        )

    def timed(
        self,
        limits: SpeedLimits | None = None,
        *,
        stops: Sequence[int] = (),
        bound: ArrayLike | None = None,
    ) -> Route:
        """Return the route with stamps; arguments and errors as of `speed_profile`."""
        limits = SpeedLimits() if limits is None else limits
        profile = speed_profile(self.poses, self.steering, limits, stops=stops, bound=bound)
        return replace(self, stamps=profile.stamps[profile.vertices], speed_limits=limits)

    def progress(self, x: float, y: float, *, after: float = 0.0) -> Progress:
        """Return where on the route a robot is: the point nearest to it, and what is left.

        Args:
            x: Position of the robot, map frame, metres.
            y: The same.
            after: Metres along the route that the robot has passed already; on routes that cross
                themselves, or come back, give the last `along`.

        Raises:
            InputError: a number is not finite.
        """
        return progress_along(self.poses, self.steering, x, y, after)

    @property
    def duration(self) -> float | None:
        """Seconds from start to goal; None if not known."""
        return None if self.stamps is None else float(self.stamps[-1])

    @property
    def start(self) -> tuple[float, float, float]:
        """First pose: x, y, heading."""
        x, y, theta = self.poses[0].tolist()
        return x, y, theta

    @property
    def goal(self) -> tuple[float, float, float]:
        """Last pose: x, y, heading."""
        x, y, theta = self.poses[-1].tolist()
        return x, y, theta

    @property
    def corridor_metres(self) -> float:
        """Metres travelled in corridor, where a scan does not fix the position along it."""
        return self.zone_metres[ZONES[CORRIDOR]]

    @property
    def open_metres(self) -> float:
        """Metres travelled in open zones, where a scan does not fix the position."""
        return self.zone_metres[ZONES[OPEN]]

    @property
    def bad_metres(self) -> float:
        """Metres travelled in `BAD_ZONES`: corridor and open."""
        return sum(self.zone_metres[name] for name in BAD_ZONES)

    def __repr__(self) -> str:
        """Return the planner and the main figures as text."""
        return (
            f"<Route of {self.planner!r}: {self.length:.2f} m, cost {self.cost:.2f}, "
            f"{self.corridor_metres:.2f} m in corridor, {self.open_metres:.2f} m in open zones, "
            f"{len(self.poses)} poses>"
        )
