"""Ambiguity over heights: maps of one building and scanner, one above the other."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from ambinav.config import check_kind
from ambinav.geometry.collision.reach import ROBOT_RADIUS
from ambinav.maps import schema, store
from ambinav.maps.address import Address
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

DIMS: Final = ("z", "y", "x")
SURFACES: Final = "surfaces"
"""Triangles of the building, over (triangle, corner, axis), metres; no layer."""
_REMEDY: Final = "make one with `ambinav map --heights`"


class AmbiguityVolume:
    """Layers of ambiguity over (z, y, x): a map for each of several heights of a flying robot.

    Each layer is that of the `AmbiguityMap` at its height. Poses are compared within one height:
    how well a robot knows its own height is not in it. Made by `ambinav.build_volume`.

    Args:
        dataset: Layers over (z, y, x), among them `free`, and the attributes of a map; `surfaces`,
            the building's triangles over (triangle, corner, axis), may be in it.
        source: Named in error messages: where the dataset comes from.

    Attributes:
        dataset: As given.
        heights: z of the robot's frame, shape (K,), metres, map frame, in equal steps.
        free: Where the robot can be, bool, shape (K, rows, columns).
        step: Distance between two heights, metres.
        spacing: Distance between lattice points in the plane, metres.

    Raises:
        InputError: the dataset is not an ambiguity volume; the message names what is missing.
    """

    def __init__(self, dataset: xr.Dataset, source: str = "the volume") -> None:
        check_kind(
            dataset, xr.Dataset, source, "give a Dataset; `AmbiguityVolume.open` reads files"
        )
        if "z" not in dataset.coords and {*schema.REQUIRED} <= {*map(str, dataset.data_vars)}:
            raise InputError(
                f"{source}: this is an ambiguity map of one height, and a volume is needed here; "
                f"{_REMEDY}."
            )
        lacking = [name for name in DIMS if name not in dataset.coords]
        lacking += [name for name in ("free",) if name not in dataset.data_vars]
        lacking += [
            f"attribute {name}" for name in schema.REQUIRED_ATTRS if name not in dataset.attrs
        ]
        if lacking:
            raise InputError(
                f"{source}: not an ambiguity volume, it lacks {', '.join(lacking)}; {_REMEDY}."
            )
        for name, values in dataset.data_vars.items():
            if name == SURFACES:
                continue
            if values.dims != DIMS:
                raise InputError(
                    f"{source}: layer {name} has the dimensions {values.dims}, a volume has "
                    f"{DIMS}; {_REMEDY}."
                )
        for name in DIMS:
            schema.check_even(np.asarray(dataset[name].values, dtype=np.float64), name, source)
        self.heights = np.asarray(dataset["z"].values, dtype=np.float64)
        if len(self.heights) < 2:
            raise InputError(f"{source}: it has one height; a volume needs two or more.")
        self.dataset = dataset
        self.source = source
        self.free = np.ascontiguousarray(dataset["free"].values, dtype=np.bool_)
        self.step = float(np.ptp(self.heights)) / (len(self.heights) - 1)
        self.spacing = schema.spacings(dataset, source)[0]

    def __repr__(self) -> str:
        """Return names, size and heights as text."""
        levels, rows, columns = self.free.shape
        return (
            f"<AmbiguityVolume of {self.dataset.attrs['environment']!r}, {columns} x {rows} cells "
            f"of {self.spacing:g} m at {levels} heights from z = {self.heights[0]:g} to "
            f"{self.heights[-1]:g} m>"
        )

    @classmethod
    def open(
        cls, path: str | Path, *, storage_options: Mapping[str, Any] | None = None
    ) -> AmbiguityVolume:
        """Read a volume that `save` wrote, from a folder or a URL; see `AmbiguityMap.open`.

        Raises:
            InputError: there is none, or it is damaged.
        """
        return cls(store.read(Address.of(path, storage_options)), source=str(path))

    def save(self, path: str | Path, *, storage_options: Mapping[str, Any] | None = None) -> None:
        """Write the volume as one zarr store, completely or not at all; see `AmbiguityMap.save`.

        Raises:
            InputError: the place is not writable, or holds something that is no map.
        """
        store.write(self.dataset, Address.of(path, storage_options))

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the layers, sorted."""
        others = ("free", SURFACES)
        return tuple(sorted(str(name) for name in self.dataset.data_vars if name not in others))

    @property
    def cost_layer(self) -> str:
        """Default layer of costs; the mean over headings where the scanner has some."""
        name = str(self.dataset.attrs.get("cost_layer", "level"))
        return name if name in self.dataset else f"{name}_mean"

    @property
    def robot_radius(self) -> float:
        """Radius of the sphere of the robot that it was made for, metres."""
        return float(json.loads(self.dataset.attrs["parameters"]).get("robot_radius", ROBOT_RADIUS))

    @property
    def surfaces(self) -> Floats:
        """Surfaces of the building as triangles, shape (T, 3, 3), metres, map frame.

        Raises:
            InputError: they are not in the volume.
        """
        if SURFACES not in self.dataset:
            raise InputError(
                f"{self.source}: the surfaces of the building are not kept in this volume; make it "
                "again with `ambinav map --heights`, or in Python give the building."
            )
        return np.asarray(self.dataset[SURFACES].values, dtype=np.float64)

    def check_layer(self, layer: str) -> str:
        """Return the name of an amount, a layer that is no angle and no axis.

        Raises:
            InputError: there is no such layer.
        """
        layer_names = [
            name for name in self.layers if not (schema.is_axis(name) or schema.is_nearest(name))
        ]
        if layer not in layer_names:
            raise InputError(f"layer is {layer!r}; give one of {', '.join(layer_names)}.")
        return layer

    def check_height(self, z: float | np.ndarray) -> None:
        """Check that heights lie within those of the volume, metres.

        Raises:
            InputError: one does not, or is no number.
        """
        values = np.atleast_1d(np.asarray(z, dtype=np.float64)).ravel()
        low, high = self.heights[0], self.heights[-1]
        outside = values[~((values >= low - 1e-9) & (values <= high + 1e-9))]
        if len(outside):
            raise InputError(
                f"z is {outside[0]:g} m and {self.source} covers heights from {low:g} to "
                f"{high:g} m; give a height within it."
            )
