"""Addition of layers of other measures to an ambiguity map."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable, Mapping
from types import NoneType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ambinav.config import check_kind
from ambinav.geometry.environment import Environment
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import LAYERS, Layer, chosen_layers
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.part import is_part
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, reporter, silent
from ambinav.sensing.scanner import RangeScanner

Values = NDArray[np.float32]

SUMMARY = {"mean": "mean over heading", "best": "at its best heading", "worst": "at its worst one"}


def with_layers(
    amap: AmbiguityMap,
    names: str | Iterable[str],
    *,
    environment: Environment | None = None,
    progress: bool | Progress = False,
    **options: Mapping[str, object],
) -> AmbiguityMap:
    """Return a map with more layers; a layer that the map already has is recomputed.

    Args:
        amap: The map.
        names: Names of layers (see `registry.LAYERS`), or "all" for every layer that the scanner
            supports, except slow ones.
        environment: Building of the map, if available; None: that stored in the map.
        progress: True for a progress bar on standard error, or a function that is called with
            the share done, from 0 to 1.
        options: Keyword arguments of a layer's function, by the layer's name:
            `with_layers(amap, ["fisher"], fisher={"odometry_std": 0.1})`.

    Raises:
        InputError: there is no such layer or option, the scanner does not support the layer, or the
            map lacks its parameters, or is a part of its building and a layer compares its cells.
    """
    check_kind(amap, AmbiguityMap, "amap")
    check_kind(environment, (Environment, NoneType), "environment")
    chosen = layers_for(amap, names, environment)
    compared = [layer.name for layer in chosen if layer.compares_cells]
    if compared and is_part(amap, environment):
        raise InputError(
            f"{amap.source}: the map is a part of its building and lacks cells that are compared "
            f"for {', '.join(compared)}; open it without bounds, or leave that out."
        )
    with reporter(progress, ", ".join(layer.name for layer in chosen)) as report:
        return layered(amap, chosen, environment=environment, progress=report, **options)


def layers_for(
    amap: AmbiguityMap, names: str | Iterable[str], environment: Environment | None = None
) -> tuple[Layer, ...]:
    """Return the layers of these names that a map gets; see `with_layers`."""
    stored = amap.dataset.attrs.get("scanner_yaml")
    scanner = None if stored is None else RangeScanner.from_yaml_text(stored, file=amap.source)
    return chosen_layers(names, scanner, environment or amap.environment)


def layered(
    amap: AmbiguityMap,
    chosen: tuple[Layer, ...],
    *,
    environment: Environment | None = None,
    progress: Progress = silent,
    **options: Mapping[str, object],
) -> AmbiguityMap:
    """Return a map, or a part of one, with more layers; see `with_layers`.

    At the rim of a part the values of layers that compare cells are those of the part alone.
    """
    _check_options(chosen, options)
    if not chosen:
        return amap
    context = LayerContext.of(amap, environment)
    added: dict[str, xr.DataArray] = {}
    for done, layer in enumerate(chosen):
        kwargs = dict(options.get(layer.name, {}))
        with LAYERS.calling(layer.name):
            added |= layer_variables(layer, context, layer.compute(context, **kwargs), kwargs)
        progress((done + 1) / len(chosen))
    return AmbiguityMap(amap.dataset.assign(added), source=amap.source)


def _check_options(chosen: tuple[Layer, ...], options: Mapping[str, Mapping[str, object]]) -> None:
    by_name = {layer.name: layer for layer in chosen}
    for name, layer_options in options.items():
        if name not in by_name:
            raise InputError(
                f"options of {name!r}: this layer is not asked for; the layers are "
                f"{', '.join(by_name) or 'none'}."
            )
        # The first is the context.
        parameters = list(inspect.signature(by_name[name].compute).parameters)[1:]
        for key in layer_options:
            if key not in parameters:
                offer = f"it takes {', '.join(parameters)}" if parameters else "it takes none"
                raise InputError(f"layer {name}: it has no option {key!r}; {offer}.")


def layer_variables(
    layer: Layer,
    context: LayerContext,
    results: Mapping[str, Values],
    options: Mapping[str, object],
) -> dict[str, xr.DataArray]:
    """Return a layer, its companions and their summaries over heading as dataset variables."""
    called = {layer.name: (layer.title, layer.unit), **layer.companions}
    if results.keys() != called.keys():
        raise ValueError(f"layer {layer.name} gave {sorted(results)}, not {sorted(called)}")
    shape = (*context.free.shape, len(context.headings))
    for name, values in results.items():
        if values.shape not in (shape[:2], shape) or (values.ndim == 3 and not context.has_theta):
            raise ValueError(f"layer {layer.name} gave {name} in the shape {values.shape}")
    variables: dict[str, xr.DataArray] = {}

    def add(name: str, values: Values, summary: str = "") -> None:
        title, unit = called[name]
        attrs: dict[str, Any] = {
            "long_name": f"{title} ({SUMMARY[summary]})" if summary else title,
            "units": unit,
            "source": layer.source,
        }
        if name == layer.name:
            attrs["worse"] = layer.worse
        elif name in layer.high_is_good:
            attrs["better"] = "high"
        if options:
            attrs["options"] = json.dumps(options, default=_plain, sort_keys=True)
        key = f"{name}_{summary}" if summary else name
        dims = ("y", "x", "theta")[: values.ndim]
        variables[key] = xr.DataArray(values.astype(np.float32), dims=dims, attrs=attrs)

    for name, values in results.items():
        add(name, values)
    if results[layer.name].ndim == 3:
        for name, values in results.items():
            if values.ndim == 3:
                floors = _summaries(layer, context, results[layer.name], name, values)
                for summary, floor in floors.items():
                    add(name, floor, summary)
    return variables


def _plain(value: object) -> object:
    """Return what JSON has for a value of an option: an array as lists, others as their text."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def _summaries(
    layer: Layer, context: LayerContext, main: Values, name: str, values: Values
) -> dict[str, Values]:
    """Return the mean over possible headings, and the values at the layer's best and worst one.

    Places have no mean: between several there is none that any heading has.
    """
    order = np.where(np.isnan(main), np.inf, main if layer.worse == "high" else -main)
    # A heading without a value is neither: it comes last among the best, and among the worst.
    best = order.argmin(axis=2)[..., np.newaxis]
    worst = np.where(np.isnan(main), -np.inf, order).argmax(axis=2)[..., np.newaxis]
    mean = {} if schema.is_place(name) else {"mean": _mean(context, name, values)}
    return mean | {
        "best": np.take_along_axis(values, best, axis=2)[..., 0],
        "worst": np.take_along_axis(values, worst, axis=2)[..., 0],
    }


def _mean(context: LayerContext, name: str, values: Values) -> Values:
    """Average over headings; nan where a possible heading has no value, and off the free cells."""
    full = np.full(context.free.shape, np.nan, dtype=np.float32)
    standable = context.possible.any(axis=1)
    cells = np.zeros_like(context.free)
    cells[context.free] = standable
    floor, where = values[cells].astype(np.float64), context.possible[standable]
    if schema.is_axis(name):
        double = np.exp(2j * floor).mean(axis=1, where=where)
        mean = np.mod(0.5 * np.angle(double), np.pi).astype(np.float32)
        full[cells] = np.where(mean >= np.pi, 0.0, mean)
    elif schema.is_angle(name):
        full[cells] = np.angle(np.exp(1j * floor).mean(axis=1, where=where))
    else:
        full[cells] = floor.mean(axis=1, where=where)
    return full
