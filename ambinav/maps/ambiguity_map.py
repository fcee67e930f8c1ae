"""Ambiguity map: layers over a building's floor, read at any pose, saved and opened again."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ambinav.config import as_flat, nearest
from ambinav.geometry.collision.reach import ROBOT_RADIUS, Reach, check_reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.maps import schema, store, updater
from ambinav.maps.address import Address
from ambinav.maps.judged_floor import LAYER as JUDGED
from ambinav.maps.judged_floor import FloorJudge, JudgedFloor
from ambinav.maps.kept_environment import kept_environment
from ambinav.maps.prepared_layer import PreparedLayer
from ambinav.maps.zones import NOT_FREE, UNEXPLORED, ZONES, ZoneShare
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress
from ambinav.runtime.scalars import Scalar


class AmbiguityMap:
    """Map of the ambiguity at every point of a building for one scanner.

    A thin class over an `xarray.Dataset`: coordinates x, y (cell centres, metres) and, where the
    scanner does not look all around, theta (radians); layers over (y, x) or (y, x, theta), NaN
    where a robot cannot stand: its body or a sensor would be inside a wall. Sampling keeps copies
    of the layers that it reads, so the dataset must not be changed afterwards.

    Attributes:
        dataset: All layers, the walls and, in attrs, the origin of everything.
        source: File or URL from which it was read; of other maps the name of the building.
    """

    def __init__(self, dataset: xr.Dataset, *, source: str | None = None) -> None:
        """Wrap a dataset made by `build_map` or read from disk.

        Args:
            dataset: Layers and attributes; see `ambinav.maps.schema`.
            source: Named in error messages: where the dataset comes from; None: the building.

        Raises:
            InputError: the dataset is not an ambiguity map; the message names what is missing.
        """
        schema.check(dataset, source or "dataset")
        self.dataset = dataset
        self.source = source or str(dataset.attrs["environment"])
        self._layers = schema.layers(dataset)
        self._free = np.ascontiguousarray(dataset["free"].values, dtype=np.bool_)
        headings = dataset.sizes.get("theta", 1)
        self._possible = np.repeat(self._free[:, :, np.newaxis], headings, axis=2)
        if "theta" in dataset["zone"].dims:
            self._possible &= dataset["zone"].transpose("y", "x", "theta").values != NOT_FREE
        dx, dy = schema.spacings(dataset, self.source)
        self._origin = [float(dataset["x"].values[0]), float(dataset["y"].values[0]), 0.0]
        self._step = [dx, dy, 2.0 * math.pi]
        if self.has_theta:
            theta = dataset["theta"].values
            self._origin[2] = float(theta[0])
            self._step[2] = 2.0 * math.pi / theta.size
        self._prepared: dict[str, PreparedLayer] = {}

    @classmethod
    def open(
        cls,
        path: str | Path,
        *,
        bounds: tuple[float, float, float, float] | None = None,
        lazy: bool = False,
        storage_options: Mapping[str, Any] | None = None,
    ) -> AmbiguityMap:
        """Read a map that `save` wrote, or `ambinav map --tile`.

        Args:
            path: Folder of the map, or a URL that fsspec supports (`s3://maps/office.zarr`); over
                HTTP the address of the folder's files.
            bounds: (xmin, ymin, xmax, ymax), metres: only the cells whose centres lie in it; None:
                all. Walls and floor are those of the whole building.
            lazy: Read each layer on first use instead of all at once: a service reads only the
                layer of its cost, the clearance and the free cells. The files must then not change;
                missing or damaged ones are detected when they are read.
            storage_options: Options of the file system of a URL.

        Raises:
            InputError: there is no such folder, it does not hold an ambiguity map, or no cell of
                it lies in the bounds. For a URL: the bucket does not exist or is not readable, no
                server answers, or a package is missing.
        """
        address = Address.of(path, storage_options)
        return cls(store.read(address, bounds=bounds, lazy=lazy), source=str(path))

    def save(self, path: str | Path, *, storage_options: Mapping[str, Any] | None = None) -> None:
        """Write the map as a zarr store, completely or not at all.

        Args:
            path: Folder to create, or a URL that fsspec supports. An older map there is replaced: a
                folder in one step, at a URL in place. Opening it there meanwhile raises an error
                that it is not finished.
            storage_options: Options of the file system of a URL.

        Raises:
            InputError: the place is not writable, or holds something that is not a map.
        """
        store.write(self.dataset, Address.of(path, storage_options))

    def update(self, env: Environment, *, progress: bool | Progress = False) -> AmbiguityMap:
        """Return the map of the changed building, recomputed only where scans see the change.

        The result equals, to rounding, the map that `build_map` makes of `env` with this map's
        scanner and parameters. It takes the time of the poses that see the change; where, by a
        sample of them, a build would take no longer, all are computed anew.

        Args:
            env: The building, see `Environment.edited`.
            progress: True for a progress bar on standard error, or a function that is called with
                the share done, from 0 to 1.

        Returns:
            A new map; this one is not changed.

        Raises:
            InputError: the map lacks its parameters, or was made by another version; or the robot
                fits nowhere in `env`; or one of the two buildings is in space and one is a plan.
        """
        changed: AmbiguityMap = updater.installed()(self, env, progress=progress)
        return changed

    @property
    def has_theta(self) -> bool:
        """True if the heading of the robot matters."""
        return "theta" in self.dataset.coords

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of all layers, aggregates over heading included."""
        return self._layers

    @property
    def cost_layer(self) -> str:
        """Default layer of costs and rewards.

        It depends on the scanner, see `ambinav.ambiguity.cost_layer`.
        """
        return str(self.dataset.attrs.get("cost_layer", "level"))

    def is_share(self, layer: str) -> bool:
        """Return True if the layer is a share from 0 to 1 without a unit."""
        return schema.is_share(layer)

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters with which the map was computed, by name."""
        parameters: dict[str, Any] = json.loads(self.dataset.attrs["parameters"])
        return parameters

    @property
    def spacing(self) -> float:
        """Distance between cell centres, metres."""
        return self._step[0]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the lattice, edges of the outermost cells, metres."""
        ny, nx = self._free.shape
        x, y, dx, dy = *self._origin[:2], *self._step[:2]
        return x - dx / 2, y - dy / 2, x + (nx - 0.5) * dx, y + (ny - 0.5) * dy

    @property
    def segments(self) -> Segments:
        """The walls and frontiers that the map was computed from."""
        return Segments(self.dataset["segments"].values, self.dataset["segment_kind"].values)

    @cached_property
    def environment(self) -> Environment:
        """Building that the map was computed from, as far as a robot can reach it.

        Raises:
            InputError: the outline of the free space cannot be read.
        """
        return kept_environment(self.dataset, self.source)

    @cached_property
    def judged(self) -> JudgedFloor:
        """Floor that counts in every figure, and why the rest does not.

        The robot is that of `for_robot`, or of the map's parameters, or of the scanner.

        """
        if JUDGED in self.dataset:
            return JudgedFloor.read(self.dataset[JUDGED], self.cell_area)
        robot = self.parameters.get("robot_radius")
        return self._judged(FloorJudge.for_robot(self.environment, robot or ROBOT_RADIUS))

    @cached_property
    def judge(self) -> FloorJudge:
        """Judge that decided which floor counts; computed when first used."""
        return FloorJudge.for_robot(self.environment, self.judged.radius, self.judged.start)

    def judged_by(self, reach: Reach) -> JudgedFloor:
        """Judge which floor counts for another robot.

        Args:
            reach: Floor that it reaches (`ambinav.geometry.collision.reach.find_reach`).

        Raises:
            InputError: it is something else.
        """
        check_reach(reach)
        return self._judged(FloorJudge.of(self.environment, reach))

    def for_robot(self, reach: Reach) -> AmbiguityMap:
        """Return the map with its floor judged for another robot, as in `judged_by`."""
        check_reach(reach)
        if (self.judged.radius, self.judged.start) == (reach.radius, reach.start):
            return self
        layer = self.judged_by(reach).layer
        return AmbiguityMap(self.dataset.assign({JUDGED: layer}), source=self.source)

    def _judged(self, judge: FloorJudge) -> JudgedFloor:
        unknown = self.dataset["unknown"].values if "unknown" in self.dataset else None
        x, y = self.dataset["x"].values, self.dataset["y"].values
        return judge.floor(self._free, unknown, x, y, self.cell_area)

    @property
    def unexplored(self) -> Bools:
        """Mask, shape (ny, nx): free, but half of the beams or more end in unknown space."""
        if "unknown" not in self.dataset:
            return np.zeros_like(self._free)
        return np.asarray(self.dataset["unknown"].values >= UNEXPLORED)  # NaN is not

    @property
    def unmapped(self) -> Bools:
        """Mask, shape (ny, nx): unexplored, reached or not, or outside of the building.

        This floor is not judged, not even for a robot that drives there.
        """
        return self.unexplored | self.judged.outside

    @property
    def cell_area(self) -> float:
        """Area of one cell, square metres."""
        return self._step[0] * self._step[1]

    def centres(self, mask: Bools) -> Floats:
        """Return the centres of the cells of a mask of the floor, x and y, shape (N, 2), metres.

        Raises:
            InputError: the mask has another shape than the floor.
        """
        row, column = np.nonzero(self._mask(mask))
        return np.column_stack([self.dataset["x"].values[column], self.dataset["y"].values[row]])

    def _mask(self, mask: Bools) -> Bools:
        mask = np.asarray(mask, dtype=np.bool_)
        if mask.shape != self._free.shape:
            raise InputError(
                f"mask has the shape {mask.shape}; the map's lattice has {self._free.shape}."
            )
        return mask

    @property
    def possible(self) -> Bools:
        """Mask, shape (ny, nx, headings): where a robot can be at a heading.

        One heading represents all if the map has none.
        """
        return self._possible

    @property
    def impossible_poses(self) -> int:
        """Number of poses without a value in free cells, where only other headings are possible.

        A free cell has a value at one heading at least, and in a map without headings always.
        """
        headings = int(self._possible.shape[2])
        return int(self._free.sum()) * headings - int(self._possible.sum())

    @property
    def free_area(self) -> float:
        """Area of all free cells, square metres."""
        return float(self._free.sum()) * self.cell_area

    @property
    def solid(self) -> Bools:
        """Mask, shape (ny, nx): the cell contains something solid, even if its centre is free."""
        if schema.BACKDROP not in self.dataset:
            return np.zeros_like(self._free)
        return np.asarray(self.dataset[schema.BACKDROP].values, dtype=np.bool_)

    @overload
    def sample(self, layer: str, x: Scalar, y: Scalar, theta: Scalar | None = None) -> float: ...

    @overload
    def sample(
        self, layer: str, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None = None
    ) -> Floats: ...

    def sample(
        self, layer: str, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None = None
    ) -> Floats | float:
        """Read a layer at poses.

        Linear in x and y between cell centres, and in heading if the layer has one. Corners
        inside a wall are left out. `direction` is interpolated as an axis (period pi). `zone`,
        `free` and `best_heading` are read from the nearest cell.

        Args:
            layer: Name of a layer.
            x: Metres; arrays broadcast against y and theta.
            y: Metres.
            theta: Radians. None reads the `_mean` aggregate of a layer with headings. A layer
                without headings is the same for every theta.

        Returns:
            The layer's unit, in the broadcast shape; a float if all arguments are. NaN where the
            nearest cell is not free, or impossible at the nearest heading, or outside of the map
            (`free` itself: 0).

        Raises:
            InputError: there is no such layer, or it needs a heading.
        """
        name = self._resolve(layer, theta is not None)
        if name not in self._prepared:
            layer_data = self.dataset[name]
            self._prepared[name] = PreparedLayer.of(layer_data, self._free, self._possible)
        shape, flat = as_flat(x=x, y=y, theta=0.0 if theta is None else theta)
        origin = (self._origin[0], self._origin[1], self._origin[2])
        step = (self._step[0], self._step[1], self._step[2])
        values = self._prepared[name].at(origin, step, *flat)
        shaped: Floats = values.reshape(shape)
        return float(shaped) if shaped.ndim == 0 else shaped

    def floor(self, layer: str, heading: str | float = "mean") -> xr.DataArray:
        """Return one layer over the floor, for any heading of the robot.

        Args:
            layer: Name of a layer, without suffix.
            heading: "mean", "best" or "worst" over all headings, or one heading in radians. A
                layer whose best or worst is not stored is read at the heading of the lowest or
                highest `level`.

        Returns:
            Dims (y, x). A layer without headings is returned as it is.

        Raises:
            InputError: no such layer, or no such heading.
        """
        self._resolve(layer, True)
        data = self.dataset[layer]
        if isinstance(heading, str) and heading not in schema.AGGREGATES:
            raise InputError(
                f"heading: {heading!r} is none of {', '.join(schema.AGGREGATES)} or an angle."
            )
        if "theta" not in data.dims:
            return data
        if isinstance(heading, str):
            stored = f"{layer}_{heading}"
            if stored in self.dataset:
                return self.dataset[stored]
            if heading == "mean":
                raise InputError(f"{layer}: the map keeps no mean over heading; give an angle.")
            level = self.dataset["level"].values
            best = heading == "best"
            level = np.where(self._possible, level, np.inf if best else -np.inf)
            index = level.argmin(axis=2) if best else level.argmax(axis=2)
            chosen = np.take_along_axis(data.values, index[..., np.newaxis], axis=2)[..., 0]
            return self._on_floor(layer, chosen)
        if not math.isfinite(heading):
            raise InputError(f"heading: {heading} is not an angle; give radians.")
        x, y = np.meshgrid(self.dataset["x"].values, self.dataset["y"].values)
        values = np.asarray(self.sample(layer, x, y, heading))
        if data.dtype.kind == "u":
            values = np.nan_to_num(values, nan=NOT_FREE).astype(data.dtype)
        return self._on_floor(layer, values)

    def _on_floor(self, layer: str, values: NDArray[np.generic]) -> xr.DataArray:
        coords = {"y": self.dataset["y"], "x": self.dataset["x"]}
        # The fast path does not import dask, which takes longer than drawing a floor.
        plain = xr.Variable(("y", "x"), values, self.dataset[layer].attrs, fastpath=True)
        return xr.DataArray(plain, coords, name=layer)

    def zone_shares(
        self, heading: str | float = "mean", mask: Bools | None = None
    ) -> tuple[ZoneShare, ...]:
        """Return share and area of every zone of the free floor, in the order of ZONES.

        Args:
            heading: "mean", "best", "worst" or radians, where the heading matters.
            mask: Cells that count, shape (ny, nx), such as `judged.counted`; None: all free cells.
                Shares refer to the free cells in it, and are 0 if there are none.

        Raises:
            InputError: no such heading, or the mask has another shape.
        """
        counted = self._free
        if mask is not None:
            counted = self._free & self._mask(mask)
        zone = self.floor("zone", heading).values[counted].astype(np.intp)
        counts = np.bincount(zone[zone < len(ZONES)], minlength=len(ZONES))
        total = max(int(counts.sum()), 1)
        return tuple(
            ZoneShare(name, float(count * self.cell_area), float(count / total))
            for name, count in zip(ZONES, counts, strict=True)
        )

    def __repr__(self) -> str:
        """Return environment, scanner, size and zone shares as text, in a few lines."""
        ny, nx = self._free.shape
        headings = f" x {self.dataset.sizes['theta']} headings" if self.has_theta else ""
        judged = self.judged
        shares = ", ".join(f"{s.zone} {s.share:.0%}" for s in self.zone_shares(mask=judged.counted))
        judged_shares = f": {shares}" if judged.counted.any() else ""
        count = self.impossible_poses
        impossible = f", {count} poses impossible" if count else ""
        return (
            f"<AmbiguityMap of {self.dataset.attrs['environment']!r} "
            f"for {self.dataset.attrs['scanner']!r}\n"
            f"  {nx} x {ny} cells of {self.spacing:g} m{headings}, "
            f"{self.free_area:.0f} m^2 free{impossible}\n"
            f"  of {judged.area(judged.counted):.0f} m^2 judged{judged_shares}\n"
            f"  layers: {', '.join(self._layers)}\n"
            f"  costs read: {self.cost_layer}>"
        )

    def _resolve(self, layer: str, has_heading: bool) -> str:
        """Return the variable to read: the `_mean` aggregate if a needed heading is absent."""
        if layer not in self._layers:
            offer = nearest(layer, {schema.base_name(name) for name in self._layers})
            raise InputError(
                f"{layer!r}: the map has no such layer; {offer}, or one that "
                "`ambinav map --layers` makes."
            )
        if has_heading or "theta" not in self.dataset.variables[layer].dims:
            return layer
        mean = f"{layer}_mean"
        if mean not in self.dataset:
            raise InputError(f"{layer}: the map keeps no mean over heading; give theta.")
        return mean
