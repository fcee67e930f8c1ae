"""Added layers of a map, recomputed for the map of the changed building."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import xarray as xr
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import slices_in
from ambinav.layers.build import layered, layers_for
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import LAYERS, Layer
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bounds

# If more of the lattice is near a change, a layer is computed in full.
MOST = 0.5


@dataclass(frozen=True, eq=False)
class Changed:
    """Map of a changed building without the layers that were added to the earlier map.

    Attributes:
        old: The map before.
        new: The map now.
        environment: The building now.
        boxes: Boxes around all changes with a margin in metres: (xmin, ymin, xmax, ymax).
        taken: Values over the old lattice, laid over the new one; NaN where nobody can stand.
    """

    old: AmbiguityMap
    new: AmbiguityMap
    environment: Environment
    boxes: Callable[[float], Sequence[Bounds]]
    taken: Callable[[NDArray[Any]], NDArray[Any]]

    def with_layers(self) -> AmbiguityMap:
        """Return the map with these layers, recomputed locally or in full (`Layer.reach`)."""
        amap, in_full = self.new, []
        for name in schema.added(self.old.dataset):
            layer = LAYERS.get(name)
            fresh = self.near(layer)
            if fresh is None:
                in_full.append(layer)
            else:
                amap = AmbiguityMap(amap.dataset.assign(fresh), source=amap.source)
        for layer in in_full:
            amap = self.computed(layer, amap, self.environment)
        return amap

    def computed(self, layer: Layer, amap: AmbiguityMap, env: Environment) -> AmbiguityMap:
        """Return a map with the layer, computed with its old options."""
        layer_options: Any = {layer.name: self.options(layer)}
        return layered(amap, layers_for(amap, layer.name, env), environment=env, **layer_options)

    def options(self, layer: Layer) -> dict[str, Any]:
        """Return the options that the layer was computed with."""
        options: dict[str, Any] = json.loads(
            self.old.dataset[layer.name].attrs.get("options", "{}")
        )
        return options

    def near(self, layer: Layer) -> dict[str, xr.DataArray] | None:
        """Recompute the layer only near the changes; None if it must be recomputed in full."""
        if layer.reach is None:
            return None
        options, dataset = self.options(layer), self.new.dataset
        context = LayerContext.of(self.new, self.environment)
        spacing, radius = context.spacing, context.radius
        with LAYERS.calling(layer.name):
            reach = layer.reach(context, **options) + spacing
        x, y = dataset["x"].values, dataset["y"].values
        boxes = self.boxes(reach)
        inner = [slices_in(box, x, y) for box in boxes]
        cells = sum((r.stop - r.start) * (c.stop - c.start) for r, c in inner)
        if cells > MOST * context.free.size:
            return None
        ours = {layer.name, *layer.companions}
        names = [n for n in map(str, self.old.dataset.data_vars) if schema.base_name(n) in ours]
        merged = {name: self.taken(self.old.dataset[name].values) for name in names}
        for box, (rows, columns) in zip(boxes, inner, strict=True):
            pad = radius + spacing
            around = (box[0] - pad, box[1] - pad, box[2] + pad, box[3] + pad)
            wide_rows, wide_columns = slices_in(around, x, y)
            crop = dataset.isel(y=wide_rows, x=wide_columns)
            if not crop["free"].values.any():
                continue
            far = reach + radius
            far_around = (around[0] - far, around[1] - far, around[2] + far, around[3] + far)
            window = self.environment.window(far_around)
            part = self.computed(layer, AmbiguityMap(crop), window or self.environment)
            first_row, first_column = wide_rows.start, wide_columns.start
            core = (
                slice(rows.start - first_row, rows.stop - first_row),
                slice(columns.start - first_column, columns.stop - first_column),
            )
            for name in names:
                merged[name][rows, columns] = part.dataset[name].values[core]
        old = self.old.dataset
        return {
            name: xr.DataArray(values, dims=old[name].dims, attrs=old[name].attrs)
            for name, values in merged.items()
        }
