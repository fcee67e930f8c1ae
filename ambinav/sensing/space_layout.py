"""Layouts of the beams of one sensor in space: in layers, or as the pixels of a camera."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ambinav.config import Count, Number, Switch, check_fields
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.mounting import (
    CENTRE,
    TURN,
    Angle,
    Elevation,
    Elevations,
    FieldOfView,
    Mount,
    Turn,
    beams_for_aperture,
    directed,
    fan_angles,
    thinned_fan,
)


class AtPoint:
    """Base class of layouts whose beams start at one point, `mount` and `z`."""

    mount: Mount
    z: float
    aperture: float

    def moved(self, dx: float, dy: float, dz: float = 0.0) -> Self:
        """Return the same layout, shifted along x, y and z, metres."""
        x, y, yaw = self.mount
        return replace(self, mount=(x + dx, y + dy, yaw), z=self.z + dz)  # type: ignore[type-var]

    @property
    def full_circle(self) -> bool:
        """True if the beams of a row go all around."""
        return self.aperture > TURN - 1e-9


class InSpace(ABC):
    """Base class of layouts whose beams look up and down."""

    @abstractmethod
    def beams_in_space(self) -> tuple[Floats, Floats]:
        """Return x, y, azimuth of each beam, shape (B, 3), and z, elevation, (B, 2)."""

    def mounts(self) -> Floats:
        """Return x, y, azimuth of each beam, shape (B, 3)."""
        return self.beams_in_space()[0]

    def upright(self) -> Floats:
        """Return z and elevation of each beam, shape (B, 2), metres and radians."""
        return self.beams_in_space()[1]

    def moments(self) -> Floats:
        """Return when each beam of a scan is taken, shape (B,): -1 is the scan's start, 0 its end.

        One after the other in equal steps, the last one at the end.
        """
        count = len(self.upright())
        return np.arange(1 - count, 1) / count


@dataclass(frozen=True)
class Layers(AtPoint, InSpace):
    """3D laser: columns of beams, spread evenly as the beams of `Planar` are.

    Every column has a beam at each elevation; the beams are numbered layer after layer. Where they
    are `staggered` a column has one beam, and the elevations follow each other from column to
    column, over and over: so many points of a pattern that fills the field of view.

    Attributes:
        columns: Number of columns.
        aperture: Angle from the first to the last column, radians; 2 pi is the full circle.
        elevation: Elevation of the layers in the sensor's frame, radians.
        staggered: Whether a column has a beam of one layer alone.
        mount: x, y in metres and yaw in radians in the robot frame.
        z: Metres above the floor.
        pitch: Radians about y, positive looks down (REP 103).
        roll: Radians about x, applied first.
    """

    columns: Count
    aperture: Turn
    elevation: Elevations
    staggered: Switch = False
    mount: Mount = CENTRE
    z: Number = 0.0
    pitch: Elevation = 0.0
    roll: Angle = 0.0

    def __post_init__(self) -> None:
        """Check the fields; raises `InputError`."""
        check_fields(self)
        if self.staggered and self.columns % len(self.elevation):
            raise InputError(
                f"columns is {self.columns} and there are {len(self.elevation)} elevations; give a "
                "multiple of them where layers are staggered."
            )

    @property
    def vertical_aperture(self) -> float:
        """Angle from the lowest to the highest layer, radians."""
        return max(self.elevation) - min(self.elevation)

    def beams_in_space(self) -> tuple[Floats, Floats]:
        """Return x, y, azimuth of each beam, shape (B, 3), and z, elevation, (B, 2)."""
        azimuth, elevation = fan_angles(self.columns, self.aperture), np.array(self.elevation)
        if self.staggered:
            elevation = np.tile(elevation, self.columns // len(elevation))
        else:
            count = len(elevation)
            azimuth, elevation = np.tile(azimuth, count), np.repeat(elevation, self.columns)
        return directed(azimuth, elevation, self.mount, self.z, self.pitch, self.roll)

    def moments(self) -> Floats:
        """Return the times of the beams; all beams of a column are taken at once."""
        columns = np.arange(1 - self.columns, 1) / self.columns
        return columns if self.staggered else np.tile(columns, len(self.elevation))

    def with_aperture(self, aperture: float) -> Layers:
        """Return layers of another aperture, radians; see `Planar.with_aperture`."""
        columns = beams_for_aperture(self.columns, self.aperture, aperture)
        if self.staggered:
            columns = max(round(columns / len(self.elevation)), 1) * len(self.elevation)
        return replace(self, columns=columns, aperture=aperture)

    def thinned(self, most: int) -> Layers:
        """Return at most `most` beams in a subset of layers, the lowest and highest included.

        So many of them that their spacing is about that of the columns.
        """
        total = self.columns if self.staggered else self.columns * len(self.elevation)
        if total <= most:
            return self
        elevation = kept_rows(self.elevation, self.aperture, most)
        rows = len(elevation)
        columns, aperture = thinned_fan(self.columns, self.aperture, most // rows)
        if self.staggered:
            columns, aperture = most // rows * rows, self.aperture
        return replace(self, columns=columns, aperture=aperture, elevation=elevation)


@dataclass(frozen=True)
class Camera(AtPoint, InSpace):
    """Depth camera: a grid of pixels of a pinhole, edge to edge, row by row from above.

    Attributes:
        columns: Number of pixels across.
        rows: Number of pixels up.
        horizontal: Field of view across, radians.
        vertical: Field of view up, radians.
        mount: x, y in metres and yaw in radians in the robot frame.
        z: Metres above the floor.
        pitch: Radians about y, positive looks down (REP 103).
        roll: Radians about x, applied first.
    """

    columns: Count
    rows: Count
    horizontal: FieldOfView
    vertical: FieldOfView
    mount: Mount = CENTRE
    z: Number = 0.0
    pitch: Elevation = 0.0
    roll: Angle = 0.0

    def __post_init__(self) -> None:
        """Check the fields; raises `InputError`."""
        check_fields(self)

    @property
    def full_circle(self) -> bool:
        """Always False: a pinhole camera cannot look all around."""
        return False

    @property
    def vertical_aperture(self) -> float:
        """Vertical field of view, radians."""
        return self.vertical if self.rows > 1 else 0.0

    def beams_in_space(self) -> tuple[Floats, Floats]:
        """Return x, y, azimuth of each beam, shape (B, 3), and z, elevation, (B, 2)."""
        across = _pixels(self.columns, self.horizontal)
        up = _pixels(self.rows, self.vertical)[::-1]
        u, v = np.tile(across, self.rows), np.repeat(up, self.columns)
        azimuth, elevation = np.arctan2(u, 1.0), np.arctan2(v, np.hypot(u, 1.0))
        return directed(azimuth, elevation, self.mount, self.z, self.pitch, self.roll)

    def moments(self) -> Floats:
        """Return the times of the beams: all 0, as the picture is taken at once, at the end."""
        return np.zeros(self.columns * self.rows)

    def thinned(self, most: int) -> Camera:
        """Return a camera of at most `most` pixels over the same field of view, evenly spread."""
        if self.columns * self.rows <= most:
            return self
        share = math.tan(self.vertical / 2) / max(math.tan(self.horizontal / 2), 1e-9)
        rows = max(min(round(math.sqrt(most * share)), self.rows, most), 1)
        columns = min(most // rows, self.columns)
        return replace(self, columns=columns, rows=rows)


def kept_rows(angle: tuple[float, ...], aperture: float, most: int) -> tuple[float, ...]:
    """Select rows of at most `most` beams, the lowest and the highest row among them.

    So many that the rows are about as far apart as the beams in them.

    Args:
        angle: Angle of each row, radians.
        aperture: Aperture of the beams of a row, radians.
        most: At least 1.

    Returns:
        Angles, in the order given.
    """
    share = (max(angle) - min(angle)) / max(aperture, 1e-9)
    rows = round(0.5 + math.sqrt(0.25 + most * share))
    rows = max(min(rows, len(angle), most), 1)
    chosen = np.argsort(angle, kind="stable")
    chosen = chosen[np.rint(np.linspace(0, len(chosen) - 1, rows)).astype(np.intp)]
    return tuple(angle[i] for i in sorted(chosen.tolist()))


def _pixels(count: int, aperture: float) -> Floats:
    """Return the positions of pixels in the plane at distance 1, ascending."""
    half = math.tan(aperture / 2) if count > 1 else 0.0
    return np.linspace(-half, half, count)
