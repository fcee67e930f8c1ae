"""Beam layout of a planar laser that tilts while it scans: a fan at each of several pitches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ambinav.config import Count, Number, check_fields
from ambinav.runtime.array_types import Floats
from ambinav.sensing.mounting import (
    CENTRE,
    Elevations,
    Mount,
    Turn,
    beams_for_aperture,
    directed,
    fan_angles,
    thinned_fan,
)
from ambinav.sensing.space_layout import AtPoint, InSpace, kept_rows


@dataclass(frozen=True)
class Tilting(AtPoint, InSpace):
    """Planar laser on a tilting unit: one panorama is a fan at each pitch, from one point.

    The robot stands still meanwhile. The beams are numbered fan after fan. The axis of the tilt
    goes through the sensor, along its y axis: beams to the side stay level, whatever the pitch.

    Attributes:
        beams: Number of beams of a fan, spread evenly as those of `Planar` are.
        aperture: Angle from the first to the last beam, radians; 2 pi is the full circle.
        pitch: Pitch of the fans, radians, positive looks down (REP 103).
        mount: x, y in metres and yaw in radians in the robot frame.
        z: Metres above the floor.
    """

    beams: Count
    aperture: Turn
    pitch: Elevations
    mount: Mount = CENTRE
    z: Number = 0.0

    def __post_init__(self) -> None:
        """Check the fields; raises `InputError`."""
        check_fields(self)

    @property
    def vertical_aperture(self) -> float:
        """Angle from the lowest to the highest fan, radians."""
        return max(self.pitch) - min(self.pitch)

    def beams_in_space(self) -> tuple[Floats, Floats]:
        """Return x, y, azimuth of each beam, shape (B, 3), and z, elevation, (B, 2)."""
        angle, flat = fan_angles(self.beams, self.aperture), np.zeros(self.beams)
        fans = [directed(angle, flat, self.mount, self.z, pitch, 0.0) for pitch in self.pitch]
        across, up = zip(*fans, strict=True)
        return np.concatenate(across), np.concatenate(up)

    def with_aperture(self, aperture: float) -> Tilting:
        """Return fans of another aperture, radians; see `Planar.with_aperture`."""
        beams = beams_for_aperture(self.beams, self.aperture, aperture)
        return replace(self, beams=beams, aperture=aperture)

    def thinned(self, most: int) -> Tilting:
        """Return at most `most` beams in a subset of fans, the lowest and highest included.

        So many of them that their spacing is about that of the beams.
        """
        if self.beams * len(self.pitch) <= most:
            return self
        pitch = kept_rows(self.pitch, self.aperture, most)
        beams, aperture = thinned_fan(self.beams, self.aperture, most // len(pitch))
        return replace(self, beams=beams, aperture=aperture, pitch=pitch)
