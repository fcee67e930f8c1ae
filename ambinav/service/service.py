"""Ambiguity service for planners and environments: cost per metre, motion cost, reward."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from types import NoneType
from typing import overload

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from ambinav.config import as_arrays, as_nonnegative, as_positive, check_kind
from ambinav.geometry.motion.steering import FACING, POSES, Steering, checked_poses
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.scalars import Scalar
from ambinav.service.field import Field, check_cost, nearest_possible
from ambinav.service.motion import motion_integrals

Pose = tuple[ArrayLike, ArrayLike, ArrayLike | None]
"""x, y and theta: arrays broadcast; None: no heading."""


class AmbiguityService:
    """Cost and reward computed from one layer of an ambiguity map.

    The cost of a metre is

        c = 1 + weight * layer^power + clearance_weight * max(0, 1 - clearance / comfort)
              + outside_weight outside of the preferred polygons,

    so a route's cost is in equivalent metres and its length is a lower bound of it. The cost is
    given on the map's lattice and linear in between. Costs of states and integrals over motions
    come from the same field, so all callers get the same numbers.

    Args:
        amap: The map.
        layer: A layer with values from 0 on, such as `level`, `major` or `ambiguity`; None: the
            map's `cost_layer`.
        weight: Extra cost of a metre where the layer is 1, in metres, at least 0.
        power: Exponent of the layer, above 0; above 1 bad places count more and good ones less.
        clearance_weight: Extra cost of a metre along a wall, in metres, at least 0.
        comfort: Distance from which walls add no cost, metres, above 0.
        preferred: Polygons in the map frame, metres; None: no floor is preferred. A cell counts as
            inside by its centre.
        outside_weight: Extra cost of a metre outside of them, in metres, at least 0.

    Attributes:
        map: The map.
        layer: The layer's name.
        weight: As given; so are power, clearance_weight, comfort, preferred and outside_weight.
        ambiguity: The layer as a field.
        graded: layer^power, which is multiplied by the weight.
        plain: The cost of a metre without it, float32, shape (rows, columns, headings); None if
            that is 1 everywhere.
        density: The cost of a metre.

    Raises:
        InputError: the map has no such layer, the layer holds negative values, or a number is
            out of its range.
    """

    def __init__(
        self,
        amap: AmbiguityMap,
        layer: str | None = None,
        weight: float = 5.0,
        *,
        power: float = 1.0,
        clearance_weight: float = 0.0,
        comfort: float = 0.5,
        preferred: BaseGeometry | None = None,
        outside_weight: float = 1.0,
    ) -> None:
        weight = as_nonnegative(weight, "weight")
        outside_weight = as_nonnegative(outside_weight, "outside_weight")
        clearance_weight = as_nonnegative(clearance_weight, "clearance_weight")
        power, comfort = as_positive(power, "power"), as_positive(comfort, "comfort", "metres")
        check_kind(amap, AmbiguityMap, "amap")
        if layer is None:
            layer = amap.cost_layer
        amap.floor(layer)
        if schema.is_axis(layer) or schema.is_nearest(layer):
            raise InputError(f"layer {layer!r} is not an amount; a cost needs one, such as level.")
        self.map = amap
        self.layer = layer
        self.weight = weight
        self.power = power
        self.clearance_weight = clearance_weight
        self.comfort = comfort
        self.preferred = preferred
        self.outside_weight = outside_weight
        self.ambiguity = Field.of(amap, layer)
        check_cost(layer, amap.dataset[layer].attrs, self.ambiguity.values)
        with np.errstate(over="ignore"):  # said below
            graded = self.ambiguity.values ** np.float32(power)
        self.graded = replace(self.ambiguity, values=graded)
        one, plain = np.float32(1.0), None
        if clearance_weight > 0.0:
            clearance = Field.of(amap, "clearance").values
            near = np.maximum(np.float32(0.0), 1.0 - clearance / np.float32(comfort))
            plain = one + np.float32(clearance_weight) * near
        if preferred is not None:
            outside = _outside(amap, preferred)[:, :, np.newaxis]
            plain = (one if plain is None else plain) + np.float32(outside_weight) * outside
        self.plain: Floats32 | None = plain
        self.density = self._weighed()

    def __repr__(self) -> str:
        """Return layer, weight and map as text."""
        return f"AmbiguityService(layer={self.layer!r}, weight={self.weight:g}, map={self.map!r})"

    @overload
    def cost(self, x: Scalar, y: Scalar, theta: Scalar | None = None) -> float: ...

    @overload
    def cost(self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None = None) -> Floats: ...

    def cost(self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None = None) -> Floats | float:
        """Compute the cost per metre at poses.

        Args:
            x: Metres, map frame; arrays broadcast against y and theta.
            y: Metres.
            theta: Radians; needed if the layer depends on the heading.

        Returns:
            At least 1 in free space, inf elsewhere and where the robot cannot be at that heading; a
            float if all arguments are.

        Raises:
            InputError: the layer depends on the heading and theta is missing.
        """
        return self._cost(x, y, theta)

    def gradient(self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None = None) -> Floats:
        """Compute `cost`'s derivative by x, y, shape (..., 2), per metre; nan where not free."""
        shape, poses = self._poses(x, y, theta)
        return self.density.slope(*poses).reshape(*shape, 2)

    @overload
    def motion_cost(
        self,
        x0: Scalar,
        y0: Scalar,
        x1: Scalar,
        y1: Scalar,
        theta0: Scalar | None = None,
        theta1: Scalar | None = None,
        steering: Steering | None = None,
    ) -> float: ...

    @overload
    def motion_cost(
        self,
        x0: ArrayLike,
        y0: ArrayLike,
        x1: ArrayLike,
        y1: ArrayLike,
        theta0: ArrayLike | None = None,
        theta1: ArrayLike | None = None,
        steering: Steering | None = None,
    ) -> Floats: ...

    def motion_cost(
        self,
        x0: ArrayLike,
        y0: ArrayLike,
        x1: ArrayLike,
        y1: ArrayLike,
        theta0: ArrayLike | None = None,
        theta1: ArrayLike | None = None,
        steering: Steering | None = None,
    ) -> Floats | float:
        """Compute the cost of motions in equivalent metres: at least their length.

        Walls are ignored: use a collision check to decide whether a motion is possible.
        Where a pose is not possible the cost is that of the nearest one that is.

        Args:
            x0: Start, metres; all arguments broadcast.
            y0: Start, metres.
            x1: End, metres.
            y1: End, metres.
            theta0: Heading at the start, radians; needed for curves, and for straight lines if
                the layer depends on the heading. In r2 it is always the direction of travel.
            theta1: Heading at the end.
            steering: Motion model of the robot; None: straight, as in se2.

        Raises:
            InputError: a heading is missing, or something is not finite.
        """
        return self._integrate(self.density, (x0, y0, theta0), (x1, y1, theta1), steering)

    @overload
    def reward(
        self,
        x0: Scalar,
        y0: Scalar,
        x1: Scalar,
        y1: Scalar,
        theta0: Scalar | None = None,
        theta1: Scalar | None = None,
        steering: Steering | None = None,
    ) -> float: ...

    @overload
    def reward(
        self,
        x0: ArrayLike,
        y0: ArrayLike,
        x1: ArrayLike,
        y1: ArrayLike,
        theta0: ArrayLike | None = None,
        theta1: ArrayLike | None = None,
        steering: Steering | None = None,
    ) -> Floats: ...

    def reward(
        self,
        x0: ArrayLike,
        y0: ArrayLike,
        x1: ArrayLike,
        y1: ArrayLike,
        theta0: ArrayLike | None = None,
        theta1: ArrayLike | None = None,
        steering: Steering | None = None,
    ) -> Floats | float:
        """Compute minus the layer's integral over the step, at most 0; see `motion_cost`."""
        return self._reward((x0, y0, theta0), (x1, y1, theta1), steering)

    def route_cost(self, poses: ArrayLike, steering: Steering | None = None) -> float:
        """Compute the cost of a route in equivalent metres: the sum over its motions.

        Args:
            poses: x, y, theta, shape (N, 3), metres and radians.
            steering: Motion model of the robot; None: straight, as in se2.

        Raises:
            InputError: the poses are not of that shape, or not finite.
        """
        return _along(self.density, poses, steering)

    def route_exposure(self, poses: ArrayLike, steering: Steering | None = None) -> float:
        """Integrate the layer along a route, layer times metres; see `route_cost`."""
        return _along(self.ambiguity, poses, steering)

    @property
    def has_headings(self) -> bool:
        """True if the cost depends on the heading."""
        return bool(self.density.values.shape[2] > 1)

    def with_weight(self, weight: float) -> AmbiguityService:
        """Return the same service with another weight.

        Raises:
            InputError: the weight is not a number of at least 0.
        """
        if weight == self.weight:
            return self
        other = copy(self)
        other.weight = as_nonnegative(weight, "weight")
        other.density = other._weighed()
        return other

    def _weighed(self) -> Field:
        """Return the field of the cost per metre at the service's weight."""
        with np.errstate(over="ignore", invalid="ignore"):  # said below
            density = np.float32(self.weight) * self.graded.values
            density += np.float32(1.0) if self.plain is None else self.plain
        if not np.isfinite(density).all():
            raise InputError(
                f"weight {self.weight:g} and power {self.power:g} make costs of layer "
                f"{self.layer!r} that are not finite; give smaller ones."
            )
        return replace(self.ambiguity, values=density)

    def motion_costs(self, a: Floats, b: Floats, steering: Steering) -> Floats:
        """Compute the cost of each motion from poses a to b, (N, 3) each; shape (N,).

        Raises:
            InputError: the poses are not of that shape, or not equally many.
        """
        return _motions(self.density, a, b, steering)

    def motion_exposures(self, a: Floats, b: Floats, steering: Steering) -> Floats:
        """Compute the exposure that `motion_costs` weights: layer^power times metres, (N,)."""
        return _motions(self.graded, a, b, steering)

    def _cost(self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None) -> Floats | float:
        shape, (x, y, theta) = self._poses(x, y, theta)
        value = self.density.at(x, y, theta, math.inf)
        return value.reshape(shape) if shape else float(value[0])

    def _reward(self, start: Pose, end: Pose, steering: Steering | None) -> Floats | float:
        return 0.0 - self._integrate(self.ambiguity, start, end, steering)

    def _integrate(
        self, field: Field, start: Pose, end: Pose, steering: Steering | None
    ) -> Floats | float:
        (x0, y0, theta0), (x1, y1, theta1) = start, end
        check_kind(steering, (Steering, NoneType), "steering")
        if steering is not None and steering.turns and (theta0 is None or theta1 is None):
            raise InputError(f"{steering.space} needs headings; give theta0 and theta1.")
        if steering is None or steering.kind != FACING:
            self._need_heading(theta0)
            self._need_heading(theta1)
        coordinates = {"x0": x0, "y0": y0, "theta0": theta0, "x1": x1, "y1": y1, "theta1": theta1}
        shape, ends = _flat(**coordinates)
        for name, values in zip(coordinates, ends, strict=True):
            if not np.isfinite(values).all():
                raise InputError(f"{name} is not finite; give metres and radians.")
        xa, ya, ta, xb, yb, tb = ends
        total = field.integral(xa, ya, ta, xb, yb, tb, steering)
        return total.reshape(shape) if shape else float(total[0])

    def _poses(
        self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None
    ) -> tuple[tuple[int, ...], list[Floats]]:
        self._need_heading(theta)
        if theta is not None:
            return _flat(x=x, y=y, theta=theta)
        # Without headings, pass x in place of zeros: kernels only need finite values.
        shape, (x, y) = _flat(x=x, y=y)
        return shape, [x, y, x]

    def _need_heading(self, theta: ArrayLike | None) -> None:
        if theta is None and self.has_headings:
            raise InputError(
                f"layer {self.layer!r} depends on the heading; give theta, or use the layer "
                f"{self.layer}_mean."
            )


def _outside(amap: AmbiguityMap, shape: BaseGeometry) -> Bools:
    """Return the cells outside of a shape, (rows, columns); in walls as the nearest free cell.

    Raises:
        InputError: it is no geometry, or all free cells lie outside.
    """
    if not isinstance(shape, BaseGeometry):
        raise InputError(f"preferred is {shape!r}; give a shapely geometry in the map's frame.")
    x, y = np.meshgrid(*(amap.dataset[axis].values for axis in "xy"))
    shapely.prepare(shape)
    free = np.asarray(amap.dataset["free"].values, dtype=np.bool_)
    outside = ~shapely.intersects_xy(shape, x, y)
    if outside[free].all():
        raise InputError(
            "preferred: the polygons hold the centre of no free cell of the map; give some in the "
            f"map's frame, metres, wider than a cell of {amap.spacing:g} m."
        )
    row, column, _ = nearest_possible(free[:, :, np.newaxis], 0)
    return np.asarray(outside[row, column])


def _motions(field: Field, a: Floats, b: Floats, steering: Steering) -> Floats:
    """Integrate a field over each motion from a to b.

    Raises:
        InputError: the poses are not of one shape (N, 3).
    """
    check_kind(steering, Steering, "steering")
    a, b = (np.ascontiguousarray(poses, dtype=np.float64) for poses in (a, b))
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3:
        raise InputError(f"a and b have the shapes {a.shape} and {b.shape}; give {POSES}, each.")
    parts = np.empty(len(a))
    values, _, left, low, inverse = field.arrays
    motion_integrals(
        steering.kind, steering.kernel_radius, a, b, values, left, low, inverse, parts,
    )  # fmt: skip
    return parts


def _along(field: Field, poses: ArrayLike, steering: Steering | None) -> float:
    """Integrate a field along a route."""
    route = checked_poses(poses, "poses")
    return float(_motions(field, route[:-1], route[1:], steering or Steering("se2")).sum())


def _flat(**values: ArrayLike | None) -> tuple[tuple[int, ...], list[Floats]]:
    """Return the broadcast shape, and the values flattened; None is heading 0, or no place.

    What can be read as it is, is not copied: kernels are compiled for arrays that can be written.
    """
    missing = {name: 0.0 if name.startswith("theta") else math.nan for name in values}
    shape, parts = as_arrays(
        **{name: missing[name] if value is None else value for name, value in values.items()}
    )

    def row(part: Floats) -> Floats:
        if part.shape == shape and shape and part.flags.c_contiguous and part.flags.carray:
            return part.reshape(-1)
        return np.broadcast_to(part, shape).flatten()

    return shape, [row(part) for part in parts]
