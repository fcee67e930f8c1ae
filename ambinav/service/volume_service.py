"""Cost of a metre in a volume of ambiguity, and its exact integral along straight motions."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_array, as_flat, as_nonnegative, check_kind
from ambinav.maps.ambiguity_volume import AmbiguityVolume
from ambinav.maps.lattice_values import value_at, values_at
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.service.field import check_cost
from ambinav.service.motion import integral_in_space


class VolumeService:
    """Cost computed from one layer of an ambiguity volume: c = 1 + weight * layer.

    As in `AmbiguityService`: at least 1, so that the length in space is a lower bound of a route's
    cost, infinite where the robot cannot be, and one field for states and motions. It is linear in
    x, y and z between the lattice's points; what is not free holds the value of the nearest free
    point of space.

    Args:
        volume: The volume.
        layer: One of its layers with values from 0 on; None: its `cost_layer`.
        weight: Extra cost of a metre where the layer is 1, in metres, at least 0.

    Attributes:
        volume: The volume.
        layer: The layer's name.
        weight: As given.
        density: The cost of a metre, float32, shape (rows, columns, K) for K heights.

    Raises:
        InputError: there is no such layer, it is high where a robot is well localized, it holds
            values below 0 or infinite ones, or the weight is below 0.
    """

    def __init__(
        self, volume: AmbiguityVolume, layer: str | None = None, weight: float = 5.0
    ) -> None:
        from scipy.ndimage import distance_transform_edt

        check_kind(volume, AmbiguityVolume, "volume")
        self.weight = as_nonnegative(weight, "weight")
        self.volume = volume
        self.layer = volume.check_layer(volume.cost_layer if layer is None else layer)
        has_value = volume.free & ~np.isnan(volume.dataset[self.layer].values)
        nearest = distance_transform_edt(
            ~has_value, (volume.step, volume.spacing, volume.spacing),
            return_distances=False, return_indices=True,
        )  # fmt: skip
        layer_values = volume.dataset[self.layer].values[tuple(nearest)]
        check_cost(self.layer, volume.dataset[self.layer].attrs, layer_values)
        with np.errstate(over="ignore"):
            density = (1.0 + self.weight * layer_values.astype(np.float64)).astype(np.float32)
        if not np.isfinite(density).all():
            raise InputError(
                f"weight {self.weight:g} makes costs of layer {self.layer!r} that are not finite; "
                "give a smaller one."
            )
        self.density = np.ascontiguousarray(density.transpose(1, 2, 0))
        self._free = np.ascontiguousarray(volume.free.transpose(1, 2, 0))
        x, y, z = (float(volume.dataset[name].values[0]) for name in ("x", "y", "z"))
        self._origin = x, y, z
        self._scales = (1.0 / volume.spacing, 1.0 / volume.step)

    def __repr__(self) -> str:
        """Return layer, weight and volume as text."""
        return f"VolumeService(layer={self.layer!r}, weight={self.weight:g}, {self.volume!r})"

    def cost(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Floats | float:
        """Compute the cost per metre; arrays broadcast, plain numbers give a plain number.

        Returns:
            At least 1 in free space, inf elsewhere.

        Raises:
            InputError: a height lies outside of the volume.
        """
        shape, at = as_flat(x=x, y=y, z=z)
        self.volume.check_height(at[2])
        out = np.empty(len(at[0]))
        # The kernel's third axis is an angle: one turn for all heights.
        turn = (at[2] - self._origin[2]) * self._scales[1] * (2.0 * math.pi / self._free.shape[2])
        values_at(
            0, len(out), at[0], at[1], np.maximum(turn, 0.0), self.density, self._free,
            *self._origin[:2], self._scales[0], math.inf, out,
        )  # fmt: skip
        return out.reshape(shape) if shape else float(out[0])

    def near(self, x: float, y: float, z: float) -> float:
        """Return the cost per metre at one point; where it is not free, of the nearest free one."""
        inverse, inverse_z = self._scales
        left, low, bottom = self._origin
        u, v, w = (x - left) * inverse, (y - low) * inverse, (z - bottom) * inverse_z
        return float(value_at(u, v, min(max(w, 0.0), self._free.shape[2] - 1.0), self.density))

    def _check_inside(self, points: Floats) -> None:
        """Check that points, shape (N, 3), lie over the volume's cells.

        Raises:
            InputError: one does not.
        """
        half = 0.5 * self.volume.spacing
        x, y = (self.volume.dataset[axis].values for axis in ("x", "y"))
        low, high = np.array([x[0], y[0]]) - half, np.array([x[-1], y[-1]]) + half
        outside = ((points[:, :2] < low) | (points[:, :2] > high)).any(axis=1)
        if outside.any():
            px, py, _ = points[outside][0]
            raise InputError(
                f"({px:g}, {py:g}) lies outside of {self.volume.source}, which covers x from "
                f"{low[0]:g} to {high[0]:g} m and y from {low[1]:g} to {high[1]:g} m; give points "
                "within it."
            )

    @property
    def kernel_arrays(self) -> tuple[Floats32, float, float, float, float, float]:
        """Arguments of `ambinav.service.motion.integral_in_space` behind the two ends."""
        return self.density, *self._origin, *self._scales

    def route_cost(self, points: ArrayLike) -> float:
        """Integrate the cost along straight motions between points, in equivalent metres.

        Args:
            points: x, y, z, shape (N, 3), metres.

        Raises:
            InputError: they are not of that shape or not finite, or leave the volume.
        """
        route = as_array(points, "points", "x, y, z in metres, shape (N, 3)")
        if route.ndim != 2 or route.shape[1] != 3 or not np.isfinite(route).all():
            raise InputError("points are not rows of three finite numbers; give x, y, z in metres.")
        self.volume.check_height(route[:, 2])
        self._check_inside(route)
        arrays = self.kernel_arrays
        return float(sum(integral_in_space(*a, *b, *arrays) for a, b in itertools.pairwise(route)))
