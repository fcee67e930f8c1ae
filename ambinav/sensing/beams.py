"""Beams of a scanner, all of its parts together."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats, Indices
from ambinav.sensing.layout import Part
from ambinav.sensing.rays import RayTable, make_rays
from ambinav.sensing.sensor import RangeSensor
from ambinav.sensing.symmetry import rotation_order

Scalar = TypeVar("Scalar", bound=np.generic)

# A scanner that is the same again after a turn of at most 30 degrees looks all around.
ALL_AROUND_ORDER = 12


class Beams:
    """Properties of beams that follow from the parts they are made of.

    Attributes:
        parts: The beams, grouped by sensor and layout, in order.
    """

    parts: tuple[Part, ...]

    @cached_property
    def sensors(self) -> tuple[RangeSensor, ...]:
        """Distinct sensors, in the order of their first beam."""
        return tuple(dict.fromkeys(part.sensor for part in self.parts))

    @cached_property
    def mounts(self) -> Floats:
        """Position x, y (metres) and yaw (radians) of each beam in the robot frame, (B, 3)."""
        return _fixed(np.concatenate([part.layout.mounts() for part in self.parts]))

    @cached_property
    def upright(self) -> Floats:
        """Height z (metres above the floor) and elevation (radians) of each beam's axis, (B, 2)."""
        return _fixed(np.concatenate([part.layout.upright() for part in self.parts]))

    def axes(self, beams: NDArray[np.integer]) -> Floats:
        """Return beams from above: x, y (metres), and x, y of their unit vectors, robot frame.

        Args:
            beams: Their indices, shape (U,).

        Returns:
            Shape (U, 4).
        """
        x, y, yaw = self.mounts[beams].T
        level_part = np.cos(self.upright[beams, 1])
        return np.column_stack([x, y, np.cos(yaw) * level_part, np.sin(yaw) * level_part])

    @cached_property
    def level(self) -> bool:
        """True if all beams are horizontal; if not, they need a building in space."""
        return not self.upright[:, 1].any()

    @property
    def vertical_aperture(self) -> float:
        """Largest angle from the lowest to the highest layer of a part, radians."""
        return max(part.layout.vertical_aperture for part in self.parts)

    @cached_property
    def sensor_of_beam(self) -> Indices:
        """Index into `sensors` of each beam, shape (B,)."""
        counts = [len(part.layout.mounts()) for part in self.parts]
        index = [self.sensors.index(part.sensor) for part in self.parts]
        return _fixed(np.repeat(np.array(index, dtype=np.intp), counts))

    @property
    def beams(self) -> int:
        """Number of beams B."""
        return len(self.mounts)

    @cached_property
    def max_range(self) -> float:
        """Farthest range of any sensor, metres."""
        return max(sensor.max_range for sensor in self.sensors)

    @cached_property
    def intensity_beams(self) -> Indices:
        """Indices of the beams whose sensor reads intensities, ascending, shape (K,)."""
        return _fixed(np.flatnonzero([self.sensors[i].intensity for i in self.sensor_of_beam]))

    @property
    def kind(self) -> str:
        """Kind of scanner: "laser" (no sensor has a cone), "sonar" (all have) or "mixed"."""
        cones = {sensor.aperture > 0 for sensor in self.sensors}
        return "mixed" if len(cones) == 2 else "sonar" if cones == {True} else "laser"

    @cached_property
    def rotation_order(self) -> int:
        """Largest n such that a turn of the robot by 2 pi / n gives the same beams again."""
        return rotation_order(self.mounts, self.upright, self.sensor_of_beam)

    @property
    def turns_in_place(self) -> bool:
        """True if a turn on the spot by at most 30 degrees gives the same beams again."""
        return self.rotation_order >= ALL_AROUND_ORDER

    def rays(self, in_space: bool = False) -> RayTable:
        """Return the rays to cast: one for a laser beam, several for a cone.

        Args:
            in_space: Whether the building has three dimensions: a cone is a level fan otherwise.
        """
        return self._space_rays if in_space else self._rays

    @cached_property
    def _rays(self) -> RayTable:
        return self._made_rays(in_space=False)

    @cached_property
    def _space_rays(self) -> RayTable:
        cones = any(sensor.aperture > 0.0 for sensor in self.sensors)
        return self._made_rays(in_space=True) if cones else self._rays

    def _made_rays(self, in_space: bool) -> RayTable:
        def of_beam(values: Iterable[float]) -> Floats:
            return np.array(list(values))[self.sensor_of_beam]

        limits = (math.inf if s.max_incidence is None else s.max_incidence for s in self.sensors)
        return make_rays(
            self.mounts,
            of_beam(s.aperture for s in self.sensors),
            of_beam(s.max_range for s in self.sensors),
            of_beam(limits),
            self.upright,
            in_space,
        )


def _fixed(array: NDArray[Scalar]) -> NDArray[Scalar]:
    array.flags.writeable = False
    return array
