"""Layer as plain arrays, read at poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from ambinav.maps import lattice_values, schema
from ambinav.runtime.array_types import Bools, Floats, Floats32


@dataclass(frozen=True, eq=False)
class PreparedLayer:
    """Layer as plain arrays.

    Attributes:
        name: Name of the layer.
        parts: Its values, (ny, nx, headings or 1), NaN where they are not known; of an axis cosine
            and sine of its double angle.
        stands: Where a robot can stand, in the shape of `parts`.
    """

    name: str
    parts: tuple[Floats32, ...]
    stands: Bools

    @classmethod
    def of(cls, data: xr.DataArray, free: Bools, possible: Bools) -> PreparedLayer:
        """Prepare a layer over (y, x) or (y, x, theta).

        Args:
            data: The layer.
            free: Free cells, shape (ny, nx).
            possible: Possible poses, shape (ny, nx, headings).
        """
        name = str(data.name)
        values = data.values.astype(np.float32)
        if data.dims == ("y", "x"):
            values = values[:, :, np.newaxis]
        stands = possible if values.shape[2] > 1 else free[:, :, np.newaxis]
        if name != "free":
            values[~(free[:, :, np.newaxis] & stands)] = np.nan
        parts: tuple[Floats32, ...] = (np.ascontiguousarray(values),)
        if schema.is_axis(name):
            parts = (np.cos(2.0 * values), np.sin(2.0 * values))
        return cls(name, parts, stands)

    def at(
        self,
        origin: tuple[float, float, float],
        step: tuple[float, float, float],
        x: Floats,
        y: Floats,
        theta: Floats,
    ) -> Floats:
        """Return values at poses, shape (n,); see `AmbiguityMap.sample`.

        Args:
            origin: x, y and theta of the first cell, metres and radians.
            step: Distance between cells, metres and radians.
            x: (n,) metres.
            y: (n,) metres.
            theta: (n,) radians.
        """
        values: Floats
        if schema.is_nearest(self.name):
            values = lattice_values.nearest(self.parts[0], origin, step, x, y, theta)
            if self.name == "free":
                values = np.nan_to_num(values)
            return values
        components: list[Floats] = [
            lattice_values.linear(part, self.stands, origin, step, x, y, theta)
            for part in self.parts
        ]
        if len(components) == 1:
            return components[0]
        values = 0.5 * np.arctan2(components[1], components[0])
        values[values < 0.0] += np.pi
        values[values >= np.pi] = 0.0  # a hair below zero rounds up to pi
        return values
