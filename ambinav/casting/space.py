"""Rays in three dimensions, and the interface of their casters, which joins 2D and 3D.

Everything above the ray caster asks it for three things, whole scans at a time: how far each ray
goes, which surface it ends on, and at what angle; and for the normal and the kind of each surface.
In the plane that is `scan_rays` with `Environment.normals` and `Segments.kind`. In space it is
`SpaceCaster`: the same three arrays, with the same meaning of inf, nan and -1.

A ray keeps the azimuth that it has in the plane, and gains a height and an elevation. Not a unit
vector: a robot turns about its upright axis, so its heading is added to azimuths and to nothing
else, as in the plane. A scanner whose rays all have elevation 0 keeps the very numbers that the 2D
caster is given, so that no 2D result changes by a bit; and rays of a level scanner that share an
azimuth are recognised as such, and walk the building together.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_arrays
from ambinav.runtime.array_types import Bools, Bytes, Floats, Floats32, Ints32
from ambinav.runtime.errors import InputError

Scans = tuple[Floats32, Ints32, Floats32]
"""Distance, surface and incidence of R rays at N poses, each of shape (N, R); see `SpaceCaster`."""


class SpaceRays(NamedTuple):
    """Rays in the robot's frame: x forward, y left, z up from the floor.

    Attributes:
        origin: Where they start, float64, shape (R, 3), metres.
        azimuth: Where they look, float64, shape (R,), radians counter-clockwise from x.
        elevation: Radians above the horizon, in [-pi/2, pi/2], float64, shape (R,).
    """

    origin: Floats
    azimuth: Floats
    elevation: Floats

    @classmethod
    def layers(cls, elevation: Floats, azimuth: Floats, height: float) -> SpaceRays:
        """Make the rays of a spinning scanner above the robot's centre, layer after layer.

        Args:
            elevation: Elevation of the layers, shape (L,), radians.
            azimuth: Azimuth of the rays of each layer, shape (A,), radians.
            height: Metres above the floor.

        Returns:
            L * A rays.
        """
        count = len(elevation) * len(azimuth)
        origin = np.zeros((count, 3))
        origin[:, 2] = height
        return cls(origin, np.tile(azimuth, len(elevation)), np.repeat(elevation, len(azimuth)))

    def mounted(
        self, x: float, y: float, z: float, yaw: float, pitch: float, roll: float
    ) -> SpaceRays:
        """Return the rays of a sensor that is mounted at a pose on the robot.

        Args:
            x: Metres forward.
            y: Metres to the left.
            z: Metres up.
            yaw: Radians about z, applied last.
            pitch: Radians about y: positive looks down (REP 103).
            roll: Radians about x, applied first.

        Returns:
            The rays in the robot's frame. Without pitch and roll only `yaw` is added to azimuths.
        """
        cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
        cr, sr = math.cos(roll), math.sin(roll)
        tilt = np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])
        turn = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        origin = self.origin @ (turn @ tilt).T + (x, y, z)
        if pitch == 0.0 and roll == 0.0:
            return SpaceRays(origin, self.azimuth + yaw, self.elevation)
        u = self.direction @ tilt.T
        return SpaceRays(
            origin,
            np.arctan2(u[:, 1], u[:, 0]) + yaw,
            np.arctan2(u[:, 2], np.hypot(u[:, 0], u[:, 1])),
        )

    @property
    def direction(self) -> Floats:
        """Unit vectors, shape (R, 3)."""
        flat = np.cos(self.elevation)
        return np.stack(
            [flat * np.cos(self.azimuth), flat * np.sin(self.azimuth), np.sin(self.elevation)],
            axis=-1,
        )

    def at(self, x: Floats, y: Floats, theta: Floats) -> tuple[Floats, Floats]:
        """Return origins and unit directions in the map frame at N poses, shape (N, R, 3) each.

        Poses have the shape (N,), or (N, R): one for each ray.
        """
        x, y, theta = (part if part.ndim == 2 else part[:, None] for part in (x, y, theta))
        c, s = np.cos(theta), np.sin(theta)
        turned = [
            np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1]], axis=-1)
            for v in (self.origin, self.direction)
        ]
        origin, direction = np.empty((2, len(x), len(self.azimuth), 3))
        origin[..., :2] = turned[0] + np.stack([x, y], axis=-1)
        origin[..., 2] = self.origin[:, 2]
        direction[..., :2] = turned[1]
        direction[..., 2] = self.direction[:, 2]
        return origin, direction


class SpaceCaster(Protocol):
    """Building that rays in space are cast against: `Prisms`, or a `Mesh`."""

    @property
    def checksum(self) -> str:
        """Digest of everything that rays can meet; it identifies the building of stored results."""

    @property
    def surface_normal(self) -> Floats:
        """Unit normal of each of the S surfaces, (S, 3), map frame; its sign has no meaning."""

    @property
    def surface_kind(self) -> Bytes:
        """Kind of each surface: a kind of `ambinav.geometry.segments`, shape (S,)."""

    def cast_scans(
        self,
        x: Floats,
        y: Floats,
        theta: Floats,
        rays: SpaceRays,
        max_range: float,
        *,
        incidence: bool = True,
    ) -> Scans:
        """Cast the same rays from many poses of the robot.

        Args:
            x: Poses, shape (N,), metres, map frame.
            y: Poses, shape (N,), metres.
            theta: Headings, shape (N,), radians.
            rays: R rays; heights count from z = 0 of the building.
            max_range: How far to look, metres.
            incidence: Work out the angles of incidence too.

        Returns:
            distance: float32, shape (N, R), metres; inf where nothing is met within `max_range`,
                nan where the ray starts in what is known to be solid, or the pose is not finite.
            surface: int32, shape (N, R), index of the surface that was met, -1 for none.
            incidence: float32, shape (N, R), angle between ray and normal, radians in
                [0, pi/2]; nan where nothing is met. Shape (0, 0) if not asked for.
        """


def unit_rays(
    origin: ArrayLike, direction: ArrayLike, max_range: float
) -> tuple[tuple[int, ...], Floats, Floats, Bools]:
    """Prepare single rays from anywhere; see `Prisms.cast`.

    Returns:
        Shape of the answer; origins and unit directions, (N, 3); and which rays are finite and have
        a direction, (N,): the others are replaced by some ray.

    Raises:
        InputError: the range is not a positive number, or the shapes do not match.
    """
    if not max_range > 0.0:
        raise InputError(f"cast: max_range is {max_range}; give a positive number of metres.")
    shape, parts = as_arrays(origin=origin, direction=direction)
    if shape[-1:] != (3,):
        raise InputError(f"cast: origin and direction have the shape {shape}; give (..., 3).")
    o, u = (np.array(np.broadcast_to(part, shape)).reshape(-1, 3) for part in parts)
    length = np.linalg.norm(u, axis=1)
    fine = np.isfinite(o).all(axis=1) & np.isfinite(length) & (length > 0.0)
    u = np.where(fine[:, None], u / np.where(fine, length, 1.0)[:, None], (1.0, 0.0, 0.0))
    return shape[:-1], np.where(fine[:, None], o, 0.0), u, fine
