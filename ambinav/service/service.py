"""The service that planners and environments ask: cost per metre, cost of a motion, reward."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.errors import InputError
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.service.field import Field

Floats = NDArray[np.float64]


class AmbiguityService:
    """Cost and reward from one layer of an ambiguity map.

    The cost of a metre is c = 1 + weight * layer, so a route's cost is in metres-equivalent and
    its length is a lower bound of it. Costs of states and integrals over motions come from the
    same field, exactly integrated: everything that asks gets the same number.

    Args:
        amap: The map.
        layer: A layer with values from 0 on, such as `level`, `major` or `ambiguity`.
        weight: How many extra metres one metre at layer 1 is worth, at least 0.

    Raises:
        InputError: the map has no such layer, the layer holds negative values, or the weight is
            not a number of at least 0.
    """

    def __init__(self, amap: AmbiguityMap, layer: str = "level", weight: float = 5.0) -> None:
        if not (math.isfinite(weight) and weight >= 0.0):
            raise InputError(f"weight is {weight}; give a number of at least 0.")
        amap.floor(layer)
        if schema.is_axis(layer) or schema.is_nearest(layer):
            raise InputError(f"layer {layer!r} is no amount; a cost needs one such as level.")
        self.map = amap
        self.layer = layer
        self.weight = float(weight)
        self.ambiguity = Field.of(amap, layer)
        least = float(self.ambiguity.values.min())
        if not least >= 0.0:
            raise InputError(
                f"layer {layer!r} holds {least:g}; a cost needs a layer with values from 0 on, "
                "such as level."
            )
        density = np.float32(1.0) + np.float32(self.weight) * self.ambiguity.values
        self.density = replace(self.ambiguity, values=density)

    def __repr__(self) -> str:
        """Layer, weight and map."""
        return f"AmbiguityService(layer={self.layer!r}, weight={self.weight:g}, map={self.map!r})"

    def cost(self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None = None) -> Floats | float:
        """Cost per metre at poses.

        Args:
            x: Metres, map frame; arrays broadcast against y and theta.
            y: Metres.
            theta: Radians; needed if the layer depends on the heading.

        Returns:
            At least 1 in free space, inf elsewhere; a float if all arguments are.

        Raises:
            InputError: the layer depends on the heading and theta is missing.
        """
        shape, poses = self._poses(x, y, theta)
        value = self.density.at(*poses)
        value[np.isnan(value)] = math.inf
        return value.reshape(shape) if shape else float(value[0])

    def gradient(self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None = None) -> Floats:
        """Derivative of `cost` by x and y, shape (..., 2), per metre; nan where not free."""
        shape, poses = self._poses(x, y, theta)
        return self.density.slope(*poses).reshape(*shape, 2)

    def motion_cost(
        self,
        x0: ArrayLike,
        y0: ArrayLike,
        x1: ArrayLike,
        y1: ArrayLike,
        theta0: ArrayLike | None = None,
        theta1: ArrayLike | None = None,
    ) -> Floats | float:
        """Cost of straight motions in metres-equivalent: at least their length.

        Walls are not looked at: whether a motion is possible is for a collision check to say.

        Args:
            x0: Start, metres; all arguments broadcast.
            y0: Start, metres.
            x1: End, metres.
            y1: End, metres.
            theta0: Heading at the start, radians; needed if the layer depends on the heading.
            theta1: Heading at the end; in between it turns evenly, the short way round.
        """
        return self._integrate(self.density, x0, y0, x1, y1, theta0, theta1)

    def reward(
        self,
        x0: ArrayLike,
        y0: ArrayLike,
        x1: ArrayLike,
        y1: ArrayLike,
        theta0: ArrayLike | None = None,
        theta1: ArrayLike | None = None,
    ) -> Floats | float:
        """Minus the layer integrated over the step, at most 0; arguments as in `motion_cost`."""
        exposure = self._integrate(self.ambiguity, x0, y0, x1, y1, theta0, theta1)
        return 0.0 - exposure

    def _integrate(
        self,
        field: Field,
        x0: ArrayLike,
        y0: ArrayLike,
        x1: ArrayLike,
        y1: ArrayLike,
        theta0: ArrayLike | None,
        theta1: ArrayLike | None,
    ) -> Floats | float:
        self._need_heading(theta0)
        self._need_heading(theta1)
        shape, ends = _flat(x0, y0, theta0, x1, y1, theta1)
        for name, end in zip(("x0", "y0", "theta0", "x1", "y1", "theta1"), ends, strict=True):
            if not np.isfinite(end).all():
                raise InputError(f"{name} is not finite; give metres and radians.")
        total = field.integral(*ends)
        return total.reshape(shape) if shape else float(total[0])

    def _poses(
        self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None
    ) -> tuple[tuple[int, ...], list[Floats]]:
        self._need_heading(theta)
        return _flat(x, y, theta)

    def _need_heading(self, theta: ArrayLike | None) -> None:
        if theta is None and self.density.values.shape[2] > 1:
            raise InputError(
                f"layer {self.layer!r} depends on the heading; give theta, or use the layer "
                f"{self.layer}_mean."
            )


def _flat(*values: ArrayLike | None) -> tuple[tuple[int, ...], list[Floats]]:
    """Broadcast shape, and the values in one row each; None counts as 0."""
    parts = np.broadcast_arrays(
        *(np.asarray(0.0 if value is None else value, dtype=np.float64) for value in values)
    )
    return parts[0].shape, [part.flatten() for part in parts]
