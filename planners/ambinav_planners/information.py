"""What one scan tells about the pose, read from an ambiguity map.

The ambiguity tensor is the second moment of the poses near by whose scan looks the same, seen
from a robot that only knew to be somewhere in the free neighbourhood. As Gaussians that is a
prior (the free neighbourhood, with radius r0 along an axis) and a posterior (ambiguity radius r),
and information adds up (Thrun, Burgard & Fox 2005, Probabilistic Robotics, section 3.5):

    1 / r^2 = 1 / r0^2 + I,    r0 = r / ratio    =>    I = (1 - ratio^2) / r^2

with the map's `major_radius` and `major` for r and ratio along the weak direction, `minor_radius`
and `minor` across it, `heading_radius` and `heading` for the heading. Where the ratio is 1 the
scan tells nothing, I = 0. That is our own model. Two consequences to know of:

- Indistinguishability compares two noisy scans. In the limit of small offsets I is therefore half
  of the Fisher information that one scan holds against a map without error (docs/model.md).
- A cell of the map stands for the poses in it, with a deviation of half the spacing. No scan is
  taken to be finer than that, so I is at most 1 / finest^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.kernels import kernel
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.service.field import Field, value_at
from ambinav.threads import run_rows

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Information:
    """Information of one scan over a map, linear between cells, continued into what is not free.

    Attributes:
        xx: float32, shape (rows, columns, headings), headings 1 if it does not matter, 1/m^2.
        xy: Likewise.
        yy: Likewise.
        turn: About the heading, 1/rad^2; 0 where the map does not say.
        weak: The least over all directions in the plane, 1/m^2.
        origin: x and y of the first cell's centre, metres.
        spacing: Metres.
    """

    xx: NDArray[np.float32]
    xy: NDArray[np.float32]
    yy: NDArray[np.float32]
    turn: NDArray[np.float32]
    weak: NDArray[np.float32]
    origin: tuple[float, float]
    spacing: float

    @classmethod
    def of(
        cls, amap: AmbiguityMap, *, finest: float | None = None, finest_heading: float = 0.01
    ) -> Information:
        """Take it from a map.

        Args:
            amap: The map. Its heading is told only by maps of scanners that look all around;
                else no scan tells the heading by itself.
            finest: The best that a scan fixes a position, metres; None for half the spacing.
            finest_heading: The best that a scan fixes the heading, radians.

        Raises:
            InputError: `finest` or `finest_heading` is not above 0.
        """
        finest = amap.spacing / 2 if finest is None else finest
        for name, value in (("finest", finest), ("finest_heading", finest_heading)):
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} is {value}; give a number above 0.")
        # A field continues what is free into what is not.
        whole = Field.of(amap, "major_radius")

        def read(layer: str) -> Floats:
            return Field.of(amap, layer).values.astype(np.float64)

        along = _told(read("major"), whole.values.astype(np.float64), finest)
        across = _told(read("minor"), read("minor_radius"), finest)
        c, s = np.cos(read("direction")), np.sin(read("direction"))
        turn = np.zeros_like(along)
        if "heading_radius" in amap.layers:
            turn += _told(read("heading"), read("heading_radius"), finest_heading)
        layers = (
            c * c * along + s * s * across,
            c * s * (along - across),
            s * s * along + c * c * across,
            turn,
            np.minimum(along, across),
        )
        xx, xy, yy, turned, weak = (np.ascontiguousarray(v, dtype=np.float32) for v in layers)
        return cls(xx, xy, yy, turned, weak, whole.origin, whole.spacing)

    @property
    def lattice(self) -> tuple[float, float, float]:
        """What kernels take after the layers: x and y of the first cell, cells per metre."""
        return *self.origin, 1.0 / self.spacing

    def at(self, poses: Floats) -> Floats:
        """Information matrices at poses of shape (N, 3), shape (N, 3, 3): x, y, theta."""
        out = np.zeros((len(poses), 3, 3))
        run_rows(
            _at, len(poses), poses, self.xx, self.xy, self.yy, self.turn, *self.lattice, out,
            least=256,
        )  # fmt: skip
        return out


def _told(ratio: Floats, radius: Floats, finest: float) -> Floats:
    """Information along an axis, between 0 and that of the finest scan."""
    told = (1.0 - np.minimum(ratio, 1.0) ** 2) / np.maximum(radius, 1e-9) ** 2
    return np.asarray(np.minimum(told, 1.0 / finest**2))


@kernel
def information_at(x, y, theta, xx, xy, yy, turn, left, low, inverse):
    """The four entries of the information matrix at a pose that are not zero."""
    u, v = (x - left) * inverse, (y - low) * inverse
    w = theta * xx.shape[2] / (2.0 * math.pi)
    return (
        value_at(u, v, w, xx), value_at(u, v, w, xy), value_at(u, v, w, yy), value_at(u, v, w, turn)
    )  # fmt: skip


@kernel
def _at(begin, end, poses, xx, xy, yy, turn, left, low, inverse, out):
    for i in range(begin, end):
        x, y, theta = poses[i]
        a, b, c, d = information_at(x, y, theta, xx, xy, yy, turn, left, low, inverse)
        out[i, 0, 0], out[i, 0, 1], out[i, 1, 0], out[i, 1, 1], out[i, 2, 2] = a, b, b, c, d
