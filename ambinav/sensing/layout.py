"""Layouts of the beams of one sensor on the robot: a planar fan, a ring, or mount by mount."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, TypeAlias

import numpy as np

from ambinav.config import Count, NonNegative, Number, check_fields, row
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.mounting import (
    CENTRE,
    LEVEL,
    TURN,
    Angle,
    Elevation,
    Mount,
    Turn,
    beams_for_aperture,
    directed,
    divisor,
    fan_angles,
    thinned_fan,
)
from ambinav.sensing.sensor import RangeSensor
from ambinav.sensing.space_layout import AtPoint, Camera, Layers
from ambinav.sensing.tilting_layout import Tilting


@dataclass(frozen=True)
class Planar(AtPoint):
    """Planar scanner: beams from one point, spread evenly.

    Over a full circle beam k of B looks to yaw - pi + 2 pi k / B; over less, the beams run from
    yaw - aperture / 2 to yaw + aperture / 2, both included. A single beam looks along yaw.

    Attributes:
        beams: Number of beams.
        aperture: Angle from the first to the last beam, radians; 2 pi is the full circle.
        mount: x, y in metres and yaw in radians in the robot frame.
        z: Metres above the floor.
        pitch: Radians about y, positive looks down (REP 103).
        roll: Radians about x, applied first.
    """

    beams: Count
    aperture: Turn
    mount: Mount = CENTRE
    z: Number = 0.0
    pitch: Elevation = 0.0
    roll: Angle = 0.0

    def __post_init__(self) -> None:
        """Check the fields; raises `InputError`."""
        check_fields(self)

    @property
    def level(self) -> bool:
        """True if it is mounted without pitch and roll."""
        return self.pitch == 0.0 and self.roll == 0.0

    @property
    def vertical_aperture(self) -> float:
        """Vertical aperture, always 0, as a fan has a single layer."""
        return 0.0

    def mounts(self) -> Floats:
        """Return x, y, yaw of each beam, shape (beams, 3)."""
        if not self.level:
            return self._tilted()[0]
        x, y, yaw = self.mount
        if self.full_circle and self.beams > 1:
            angle = yaw - math.pi + TURN * np.arange(self.beams) / self.beams
        else:
            half = self.aperture / 2 if self.beams > 1 else 0.0
            angle = yaw + np.linspace(-half, half, self.beams)
        return np.column_stack([np.full(self.beams, x), np.full(self.beams, y), angle])

    def upright(self) -> Floats:
        """Return z and elevation of each beam, shape (beams, 2), metres and radians."""
        return _at_height(self.beams, self.z) if self.level else self._tilted()[1]

    def _tilted(self) -> tuple[Floats, Floats]:
        angle = fan_angles(self.beams, self.aperture)
        flat = np.zeros(self.beams)
        return directed(angle, flat, self.mount, self.z, self.pitch, self.roll)

    def with_aperture(self, aperture: float) -> Planar:
        """Return a fan of another aperture with about the same angle between its beams.

        Args:
            aperture: Radians.

        Raises:
            InputError: it is out of its range, or this fan has a single direction.
        """
        beams = beams_for_aperture(self.beams, self.aperture, aperture)
        return replace(self, beams=beams, aperture=aperture)

    def thinned(self, most: int) -> Planar:
        """Return a fan of at most `most` evenly spaced beams, symmetric about the same axis.

        Over a full circle it keeps every s-th beam, s dividing their number; where no such
        subset has at least half of `most` beams, it spreads `most` new ones evenly. Over less
        it keeps the spacing of every s-th beam, each kept beam within half a step of a real one,
        and loses at most half a stride at either edge.
        """
        beams, aperture = thinned_fan(self.beams, self.aperture, most)
        return replace(self, beams=beams, aperture=aperture)


@dataclass(frozen=True)
class Ring:
    """Sensors evenly around the robot's centre, facing outward.

    Attributes:
        count: Number of sensors.
        radius: Distance of each from the centre, metres.
        start: Direction of the first, radians; the others follow counter-clockwise.
        z: Metres above the floor.
    """

    count: Count
    radius: NonNegative
    start: Angle = 0.0
    z: Number = 0.0

    def __post_init__(self) -> None:
        """Check the fields; raises `InputError`."""
        check_fields(self)

    def mounts(self) -> Floats:
        """Return x, y, yaw of each beam, shape (count, 3)."""
        angle = self.start + TURN * np.arange(self.count) / self.count
        return np.column_stack([self.radius * np.cos(angle), self.radius * np.sin(angle), angle])

    @property
    def vertical_aperture(self) -> float:
        """Vertical aperture, always 0, as a ring is level."""
        return 0.0

    def upright(self) -> Floats:
        """Return z and elevation of each beam, shape (count, 2), metres and radians."""
        return _at_height(self.count, self.z)

    def moved(self, dx: float, dy: float, dz: float = 0.0) -> Ring | Mounts:
        """Return the same sensors, shifted along x, y and z, metres."""
        if dx == 0.0 and dy == 0.0:
            return replace(self, z=self.z + dz)
        return Mounts.of(self.mounts(), self.upright()).moved(dx, dy, dz)

    def thinned(self, most: int) -> Ring:
        """Return a ring of at most `most` sensors: every s-th, or evenly spread new ones.

        New ones only where no divisor of `count` gives at least half of `most`.
        """
        if self.count <= most:
            return self
        return replace(self, count=divisor(self.count, most) or most)


Upright: TypeAlias = Annotated[tuple[Number, Elevation], row(2, "give z and elevation")]


@dataclass(frozen=True)
class Mounts:
    """Beams listed one by one.

    Attributes:
        each: x, y in metres and yaw in radians of each beam.
        raised: z in metres and elevation in radians of each; empty where all are 0.
    """

    each: tuple[Mount, ...]
    raised: tuple[Upright, ...] = ()

    def __post_init__(self) -> None:
        """Check the mounts; raises `InputError`."""
        check_fields(self)
        if not self.each:
            raise InputError("mounts is empty; list at least one [x, y, yaw].")
        if self.raised and len(self.raised) != len(self.each):
            raise InputError(
                f"mounts lists {len(self.each)} beams and {len(self.raised)} heights; give one of "
                "each a beam."
            )
        if not set(self.raised) - {LEVEL}:
            object.__setattr__(self, "raised", ())

    @classmethod
    def of(cls, mounts: Floats, upright: Floats) -> Mounts:
        """Collect the beams of other layouts: (n, 3) of `mounts` and (n, 2) of `upright`."""
        each = tuple((x, y, yaw) for x, y, yaw in mounts.tolist())
        if not len(each) or upright.any() or not np.isfinite(mounts).all():
            return cls(each, tuple((z, elevation) for z, elevation in upright.tolist()))
        # Only finite numbers are asked for, and pydantic takes long over a panorama's thousands.
        level = object.__new__(cls)
        object.__setattr__(level, "each", each)
        object.__setattr__(level, "raised", ())
        return level

    @property
    def vertical_aperture(self) -> float:
        """Angle from the lowest beam to the highest, radians."""
        return float(np.ptp(self.upright()[:, 1]))

    def mounts(self) -> Floats:
        """Return x, y, yaw of each beam, shape (n, 3)."""
        return np.array(self.each, dtype=np.float64)

    def upright(self) -> Floats:
        """Return z and elevation of each beam, shape (n, 2), metres and radians."""
        if not self.raised:
            return _at_height(len(self.each), 0.0)
        return np.array(self.raised, dtype=np.float64)

    def moved(self, dx: float, dy: float, dz: float = 0.0) -> Mounts:
        """Return the same beams, shifted along x, y and z, metres."""
        each = tuple((x + dx, y + dy, yaw) for x, y, yaw in self.each)
        return Mounts(each, tuple((z + dz, e) for z, e in self.upright().tolist()))

    def thinned(self, most: int) -> Mounts:
        """Return at most `most` of the beams, evenly chosen by yaw, in the order listed."""
        if len(self.each) <= most:
            return self
        yaw = self.mounts()[:, 2] % TURN
        order = np.argsort(yaw, kind="stable")
        # Cut the circle at its widest gap, so that the ends of a partial fan stay ends.
        gap = np.diff(yaw[order], append=yaw[order[0]] + TURN)
        order = np.roll(order, -1 - int(np.argmax(gap)))
        number = len(order)
        if float(gap.max()) <= 1.5 * TURN / number:
            count = divisor(number, most) or most
            chosen = np.arange(count) * number // count
        else:
            chosen = np.rint(np.linspace(0, number - 1, most)).astype(np.intp)
        kept_beams = np.sort(order[chosen])
        return Mounts.of(self.mounts()[kept_beams], self.upright()[kept_beams])


Layout: TypeAlias = Planar | Ring | Mounts | Layers | Camera | Tilting


@dataclass(frozen=True)
class Part:
    """Beams of one sensor in one layout."""

    sensor: RangeSensor
    layout: Layout


def _at_height(count: int, z: float) -> Floats:
    """Return z and elevation of `count` level beams, shape (count, 2)."""
    return np.tile((z, 0.0), (count, 1))


def with_channel(
    parts: tuple[Part, ...], intensity: Intensity | None, name: str
) -> tuple[Part, ...]:
    """Return a scanner's parts with an intensity channel on its lasers, or with none.

    Raises:
        InputError: there is no laser among them.
    """
    if all(part.sensor.aperture > 0.0 for part in parts):
        raise InputError(f"scanner {name!r} has no laser; an intensity channel needs one.")
    return tuple(
        part if part.sensor.aperture > 0.0
        else Part(replace(part.sensor, intensity=intensity), part.layout)
        for part in parts
    )  # fmt: skip
