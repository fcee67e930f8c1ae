"""Model of localization uncertainty for belief planners: initial deviation, and its cost."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ambinav.config import as_nonnegative, as_positive
from ambinav.runtime.errors import InputError


@dataclass(frozen=True)
class BeliefModel:
    """Initial uncertainty of the robot, and the cost of uncertainty.

    Attributes:
        start_std: Standard deviations of x, y (metres) and heading (radians) at the start, as
            `ambinav.drive.drive.drive_route` takes them.
        scan_distance: Metres of travel from one scan that tells something new to the next.
        weight: Extra metres that a metre at a deviation of `reference` is worth.
        reference: Metres.
        max_std: Largest deviation along the path, metres.
        max_goal_std: Largest deviation at the goal, metres.

    Raises:
        InputError: an attribute is out of its range.
    """

    start_std: tuple[float, float, float] = (0.1, 0.1, 0.05)
    scan_distance: float = 2.0
    weight: float = 5.0
    reference: float = 0.5
    max_std: float = math.inf
    max_goal_std: float = math.inf

    def __post_init__(self) -> None:
        start = self.start_std
        if len(start) != 3 or not all(math.isfinite(v) and v >= 0.0 for v in start):
            raise InputError(
                f"start_std is {start}; give the deviations of x, y and heading, at least 0."
            )
        object.__setattr__(self, "weight", as_nonnegative(self.weight, "weight"))
        for name in ("scan_distance", "reference"):
            value = as_positive(getattr(self, name), name, "metres")
            object.__setattr__(self, name, value)
        for name in ("max_std", "max_goal_std"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name} is {getattr(self, name)}; give metres above 0, or inf.")

    @property
    def std(self) -> float:
        """Initial deviation of an isotropic position: the larger one, metres."""
        return max(self.start_std[:2])
