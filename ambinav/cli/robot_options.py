"""Options of `ambinav plan` on the robot: its outline, how it moves, its headings at the ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from ambinav.cli.checks import conflict, points_of
from ambinav.cli.limits import above_zero, not_negative
from ambinav.runtime.errors import InputError

Pose = tuple[float, float, float]

CURVES = ("dubins", "reeds-shepp")
FLIGHT = "r3"
SPACES = ("r2", "se2", *CURVES, FLIGHT)


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """Options on the robot's outline and motion.

    Attributes:
        robot_radius (M): Radius of a round robot, metres; in r3 of a sphere around it. [default:
            0.2, in r3 that of the volume]
        half_height (M): Half the height of an upright cylinder around a flying robot, metres; for
            r3. [default: a sphere]
        footprint (POINTS): Corners of the outline in the robot's frame, metres: "0.3,0.2 -0.3,0.2
            ...". [default: a disc]
        space (NAME): State space: r2, se2, dubins or reeds-shepp; r3 for a robot that flies through
            a volume.
        turning_radius (M): Turning radius for dubins and reeds-shepp, metres.
        start_heading (DEG): Heading at the start, degrees counter-clockwise from the map's x axis;
            not for r2. [default: 0]
        goal_heading (DEG): Heading at the goal, as --start-heading. [default: 0]
    """

    PANEL: ClassVar[str] = "Robot"

    robot_radius: Annotated[float | None, not_negative("0.2")] = None
    half_height: Annotated[float | None, above_zero("0.2")] = None
    footprint: str | None = None
    space: str = "r2"
    turning_radius: float = 0.0
    start_heading: float | None = None
    goal_heading: float | None = None

    def check(self) -> None:
        """Refuse options that do not fit the space or the outline.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        if self.space not in SPACES:
            raise InputError(f"--space is {self.space!r}; choose from {', '.join(SPACES)}.")
        if self.space in CURVES:
            above_zero("0.5").check(self.turning_radius, "--turning-radius")
        else:
            reason = "is for the spaces dubins and reeds-shepp"
            conflict("--turning-radius", self.turning_radius != 0.0, reason)
        for option, heading in (
            ("--start-heading", self.start_heading),
            ("--goal-heading", self.goal_heading),
        ):
            if heading is not None and not math.isfinite(heading):
                raise InputError(
                    f"{option}: {heading} is not a valid heading; give degrees, e.g. 90."
                )
            reason = "is for spaces other than r2, where the robot faces along its path"
            conflict(option, heading is not None and self.space == "r2", reason)
        conflict("--half-height", self.half_height is not None, "is for --space r3")
        if self.footprint is not None:
            reason = "is for a disc, and --footprint gives another outline"
            conflict("--robot-radius", self.robot_radius is not None, reason)

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `RoutePlanner` about the robot.

        Raises:
            InputError: the footprint is none.
        """
        from ambinav.geometry.footprint import Footprint
        from ambinav_planners.planning import DEFAULT_RADIUS

        if self.footprint is not None:
            outline = Footprint.polygon(
                points_of(self.footprint, "--footprint", '"0.3,0.2 -0.3,0.2 -0.3,-0.2 0.3,-0.2"')
            )
        else:
            outline = Footprint.disc(
                DEFAULT_RADIUS if self.robot_radius is None else self.robot_radius
            )
        return {"footprint": outline, "space": self.space, "turning_radius": self.turning_radius}

    def ends(self, start: Sequence[float], goal: Sequence[float]) -> tuple[Pose, Pose]:
        """Return start and goal, x and y, with their headings in radians."""
        first, last = self.start_heading or 0.0, self.goal_heading or 0.0
        return (start[0], start[1], math.radians(first)), (goal[0], goal[1], math.radians(last))
