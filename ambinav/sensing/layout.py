"""How the beams of one sensor lie on the robot: a planar fan, a ring, or mount by mount."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ambinav.config import as_count, as_degrees, as_number, as_numbers
from ambinav.errors import InputError
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.sensor import RangeSensor

Mount: TypeAlias = tuple[float, float, float]
TURN = 2.0 * math.pi
CENTRE: Mount = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Planar:
    """A planar scanner: beams from one point, spread evenly.

    Over a full circle beam k of B looks to yaw - pi + 2 pi k / B; over less, the beams run from
    yaw - aperture / 2 to yaw + aperture / 2, both included. A single beam looks along yaw.

    Attributes:
        beams: Number of beams.
        aperture: Angle from the first to the last beam, radians; 2 pi is the full circle.
        mount: x, y in metres and yaw in radians in the robot frame.
    """

    beams: int
    aperture: float
    mount: Mount = CENTRE

    def __post_init__(self) -> None:
        """Check the fields; raises `InputError`."""
        object.__setattr__(self, "beams", as_count(self.beams, "beams"))
        object.__setattr__(self, "aperture", as_number(self.aperture, "aperture"))
        object.__setattr__(self, "mount", _mount(self.mount))
        if not 0 <= self.aperture <= TURN + 1e-9:
            raise InputError(
                f"aperture is {math.degrees(self.aperture):g} degrees; give 0 to 360 (in Python "
                "0 to 2 pi radians)."
            )

    def moved(self, dx: float, dy: float) -> Planar:
        """Return the same fan so many metres further along x and y."""
        x, y, yaw = self.mount
        return Planar(self.beams, self.aperture, (x + dx, y + dy, yaw))

    @property
    def full_circle(self) -> bool:
        """Whether the beams go all around."""
        return self.aperture > TURN - 1e-9

    def mounts(self) -> NDArray[np.float64]:
        """Return x, y, yaw of each beam, shape (beams, 3)."""
        x, y, yaw = self.mount
        if self.full_circle and self.beams > 1:
            angle = yaw - math.pi + TURN * np.arange(self.beams) / self.beams
        else:
            half = self.aperture / 2 if self.beams > 1 else 0.0
            angle = yaw + np.linspace(-half, half, self.beams)
        return np.column_stack([np.full(self.beams, x), np.full(self.beams, y), angle])

    def with_aperture(self, aperture: float) -> Planar:
        """Return a fan of another aperture with about the same angle between its beams.

        Args:
            aperture: Radians.

        Raises:
            InputError: it is out of its range, or this fan has a single direction.
        """
        gaps = self.beams if self.full_circle else self.beams - 1
        if gaps < 1 or not self.aperture > 0.0:
            raise InputError("a single beam leaves no angle between beams to keep; give two.")
        count = round(aperture * gaps / self.aperture)
        around = aperture > TURN - 1e-9
        return Planar(max(count if around else count + 1, 1), aperture, self.mount)

    def thinned(self, most: int) -> Planar:
        """Return a fan of at most `most` evenly spaced beams, symmetric about the same axis.

        Over a full circle it keeps every s-th beam, s dividing their number; where no such
        subset has at least half of `most` beams, it spreads `most` new ones evenly. Over less
        it keeps the spacing of every s-th beam, each kept beam within half a step of a real one,
        and loses at most half a stride at either edge.
        """
        if self.beams <= most:
            return self
        if self.full_circle:
            return Planar(_divisor(self.beams, most) or most, self.aperture, self.mount)
        if most == 1:
            return Planar(1, 0.0, self.mount)
        gaps, step = self.beams - 1, self.aperture / (self.beams - 1)
        for kept in range(most - 1, 0, -1):
            stride = gaps // kept
            spare = gaps - kept * stride
            if spare <= stride:
                break
        return Planar(kept + 1, kept * stride * step, self.mount)

    def to_plain(self) -> dict[str, object]:
        """Return the YAML form."""
        return {
            "planar": {
                "beams": self.beams,
                "aperture_deg": as_degrees(self.aperture),
                "mount": _plain_mount(self.mount),
            }
        }


@dataclass(frozen=True)
class Ring:
    """Sensors evenly around the robot's centre, facing outward.

    Attributes:
        count: Number of sensors.
        radius: Distance of each from the centre, metres.
        start: Direction of the first, radians; the others follow counter-clockwise.
    """

    count: int
    radius: float
    start: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields; raises `InputError`."""
        object.__setattr__(self, "count", as_count(self.count, "count"))
        object.__setattr__(self, "radius", as_number(self.radius, "radius"))
        object.__setattr__(self, "start", as_number(self.start, "start"))
        if self.radius < 0:
            raise InputError(f"radius is {self.radius}; give at least 0 metres.")

    def mounts(self) -> NDArray[np.float64]:
        """Return x, y, yaw of each beam, shape (count, 3)."""
        angle = self.start + TURN * np.arange(self.count) / self.count
        return np.column_stack([self.radius * np.cos(angle), self.radius * np.sin(angle), angle])

    def moved(self, dx: float, dy: float) -> Ring | Mounts:
        """Return the same sensors so many metres further along x and y."""
        if dx == 0.0 and dy == 0.0:
            return self
        return Mounts(tuple((x + dx, y + dy, yaw) for x, y, yaw in self.mounts().tolist()))

    def thinned(self, most: int) -> Ring:
        """Return a ring of at most `most` sensors: every s-th, or evenly spread new ones.

        New ones only where no divisor of `count` gives at least half of `most`.
        """
        if self.count <= most:
            return self
        return Ring(_divisor(self.count, most) or most, self.radius, self.start)

    def to_plain(self) -> dict[str, object]:
        """Return the YAML form."""
        return {
            "ring": {
                "count": self.count,
                "radius": self.radius,
                "start_deg": as_degrees(self.start),
            }
        }


@dataclass(frozen=True)
class Mounts:
    """Beams listed one by one.

    Attributes:
        each: x, y in metres and yaw in radians of each beam.
    """

    each: tuple[Mount, ...]

    def __post_init__(self) -> None:
        """Check the mounts; raises `InputError`."""
        object.__setattr__(self, "each", tuple(_mount(mount) for mount in self.each))
        if not self.each:
            raise InputError("mounts is empty; list at least one [x, y, yaw].")

    def mounts(self) -> NDArray[np.float64]:
        """Return x, y, yaw of each beam, shape (n, 3)."""
        return np.array(self.each, dtype=np.float64)

    def moved(self, dx: float, dy: float) -> Mounts:
        """Return the same beams so many metres further along x and y."""
        return Mounts(tuple((x + dx, y + dy, yaw) for x, y, yaw in self.each))

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
            kept = _divisor(number, most) or most
            chosen = np.arange(kept) * number // kept
        else:
            chosen = np.rint(np.linspace(0, number - 1, most)).astype(np.intp)
        return Mounts(tuple(self.each[i] for i in sorted(order[chosen].tolist())))

    def to_plain(self) -> dict[str, object]:
        """Return the YAML form."""
        return {"mounts": [_plain_mount(mount) for mount in self.each]}


Layout: TypeAlias = Planar | Ring | Mounts


@dataclass(frozen=True)
class Part:
    """Beams of one sensor in one layout."""

    sensor: RangeSensor
    layout: Layout


def _mount(value: object) -> Mount:
    numbers = as_numbers(value, "mount")
    if len(numbers) != 3:
        raise InputError(f"mount is {value!r}; give x, y and yaw.")
    return numbers[0], numbers[1], numbers[2]


def _plain_mount(mount: Mount) -> list[float]:
    return [mount[0], mount[1], as_degrees(mount[2])]


def _divisor(number: int, most: int) -> int | None:
    """Return the largest divisor of a number that is at most `most` and at least its half."""
    sizes = range(most, (most - 1) // 2, -1)
    return next((size for size in sizes if number % size == 0), None)


def with_channel(
    parts: tuple[Part, ...], intensity: Intensity | None, name: str
) -> tuple[Part, ...]:
    """The parts of a scanner, its lasers with an intensity channel, or with none.

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
