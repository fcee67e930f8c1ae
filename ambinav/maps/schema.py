"""Schema of a map's xarray.Dataset: its variables, attributes and suffixes."""

from __future__ import annotations

import json
import math
import reprlib
from typing import Final

import numpy as np
import xarray as xr

from ambinav.config import check_kind
from ambinav.maps.core_layers import AGGREGATES as AGGREGATES
from ambinav.maps.core_layers import CORE_LAYERS
from ambinav.runtime.errors import InputError

REQUIRED_LAYERS: Final = tuple(layer.name for layer in CORE_LAYERS.values() if layer.required)
REQUIRED: Final = (*REQUIRED_LAYERS, "segments", "segment_kind", "floor")
REQUIRED_ATTRS: Final = ("environment", "scanner", "parameters")

CORE: Final = frozenset(
    {
        *CORE_LAYERS,
        "segments",
        "segment_kind",
        "floor",
        "drivable",
        "space",
        "solid",
        "x",
        "y",
        "theta",
    }
) - {"clearance"}
"""Names of what every map is made of: no layer that is added may take one. `clearance` may be
asked for as a layer too, and is the same."""

BACKDROP: Final = "solid"
"""Cells with something in them that is known to be solid, bool, over (y, x). Pictures are drawn
over it; it is no layer."""

ANGLES: Final = ("_angle", "_turn")
"""Ends of the names of added layers that hold angles with period 2 pi."""
_PLACES: Final = ("aliasing_x", "aliasing_y", "aliasing_distance")
"""Between two places that look alike there is none that does."""
_FLOOR: Final = ("y", "x")
_LAYER_DIMS: Final = (_FLOOR, ("y", "x", "theta"))


def base_name(layer: str) -> str:
    """Return the layer's name without the suffix of an aggregate: `level_mean` -> `level`."""
    stem, _, suffix = layer.rpartition("_")
    return stem if stem and suffix in AGGREGATES else layer


def is_axis(layer: str) -> bool:
    """Return whether the layer holds an axis: an angle with period pi.

    The axes of layers that were added are named after them: `fisher_direction`.
    """
    base = base_name(layer)
    return _read(base) == "axis" or base.endswith("_direction")


def is_place(layer: str) -> bool:
    """Return whether a layer tells of the places of other poses."""
    return base_name(layer) in _PLACES


def is_nearest(layer: str) -> bool:
    """Return whether the layer is read at the nearest cell, without interpolation.

    A zone is a class. The best heading belongs to its cell: it jumps from one to the next. So does
    a direction of a layer that was added: `best_yaw_angle`, `aliasing_turn`.
    """
    return _read(base_name(layer)) == "nearest"


def is_angle(layer: str) -> bool:
    """Return whether an added layer holds an angle with period 2 pi."""
    return base_name(layer).endswith(ANGLES)


def is_share(layer: str) -> bool:
    """Return whether the layer runs from 0 to 1 and is drawn on that scale."""
    core = CORE_LAYERS.get(base_name(layer))
    return core is not None and core.share


def _read(base: str) -> str:
    """Return how a layer is interpolated between cells."""
    core = CORE_LAYERS.get(base)
    if core is None:
        return "nearest" if base.endswith(ANGLES) or base in _PLACES else "linear"
    return core.read


def layers(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the variables over (y, x) or (y, x, theta), sorted."""
    # Not of the dataset itself, which makes an array with coordinates of each.
    return tuple(
        sorted(
            str(name)
            for name, values in dataset.variables.items()
            if values.dims in _LAYER_DIMS and name != BACKDROP
        )
    )


def added(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of added layers (`ambinav.layers`), without their companions.

    They say in their attributes which end is `worse`: "high" or "low".
    """
    # See `layers`.
    variables = dataset.variables.items()
    names = [str(name) for name, values in variables if "worse" in values.attrs]
    return tuple(name for name in names if base_name(name) == name)


def check(dataset: xr.Dataset, source: str) -> None:
    """Check that the dataset is an ambiguity map.

    Args:
        dataset: what to check.
        source: where it comes from, for the message.

    Raises:
        InputError: something is missing or has the wrong shape; the message names it.
    """
    check_kind(dataset, xr.Dataset, source, "give a Dataset; `AmbiguityMap.open` reads files")
    if "z" in dataset.dims:
        raise InputError(
            f"{source}: this is an ambiguity volume, over several heights, and a map is needed "
            "here; plan in it with `ambinav plan --space r3`, or make a map of one height with "
            "`ambinav map` without --heights."
        )
    missing = [name for name in ("x", "y") if name not in dataset.coords]
    missing += [name for name in REQUIRED if name not in dataset.data_vars]
    missing += [f"attribute {name}" for name in REQUIRED_ATTRS if name not in dataset.attrs]
    if missing:
        raise InputError(
            f"{source}: not an ambiguity map, it lacks {', '.join(missing)}; "
            "make one with `ambinav map`."
        )
    _check_parameters(dataset.attrs["parameters"], source)
    variables = dataset.variables
    for name in ("x", "y", "theta"):
        if name in dataset.coords:
            check_even(np.asarray(variables[name].values, dtype=np.float64), name, source)
    if "theta" in dataset.coords:
        theta = variables["theta"].values
        if theta.size > 1 and not math.isclose(
            (theta[1] - theta[0]) * theta.size, 2 * math.pi, rel_tol=1e-6
        ):
            raise InputError(f"{source}: coordinate theta must divide a whole turn evenly.")
    for name in REQUIRED_LAYERS:
        dims = variables[name].dims
        if dims not in _LAYER_DIMS or (name in ("free", "clearance") and dims != _FLOOR):
            raise InputError(
                f"{source}: layer {name} has the dimensions {dims}, an ambiguity map has "
                "(y, x) or (y, x, theta); make one with `ambinav map`."
            )
    if BACKDROP in variables and variables[BACKDROP].dims != _FLOOR:
        raise InputError(
            f"{source}: {BACKDROP} has the dimensions {variables[BACKDROP].dims}, an ambiguity map "
            "has (y, x); make one with `ambinav map`."
        )
    shape = variables["segments"].shape
    if len(shape) != 2 or shape[1] != 4 or variables["segment_kind"].shape != shape[:1]:
        raise InputError(
            f"{source}: segments has the shape {shape}, it must be (N, 4) with N segment_kind; "
            "make a map with `ambinav map`."
        )


def spacings(dataset: xr.Dataset, source: str) -> tuple[float, float]:
    """Return the distance between cell centres along x and y, metres.

    A map that is one cell wide says it in its parameters only.

    Raises:
        InputError: the distance is stated nowhere.
    """
    steps = [
        float((values[-1] - values[0]) / (values.size - 1)) if values.size > 1 else math.nan
        for values in (dataset.variables["x"].values, dataset.variables["y"].values)
    ]
    if any(map(math.isnan, steps)):
        spacing = json.loads(dataset.attrs["parameters"]).get("spacing")
        if not isinstance(spacing, int | float) or not spacing > 0:
            raise InputError(
                f"{source}: attribute parameters lacks a spacing above zero; "
                "make the map with `ambinav map`."
            )
        steps = [float(spacing) if math.isnan(step) else step for step in steps]
    return steps[0], steps[1]


def _check_parameters(stated: object, source: str) -> None:
    try:
        sound = isinstance(stated, str) and isinstance(json.loads(stated), dict)
    except ValueError:
        sound = False
    if not sound:
        raise InputError(
            f"{source}: attribute parameters is {reprlib.repr(stated)}, not a JSON object; make "
            "the map with `ambinav map`."
        )


def check_even(values: np.ndarray, name: str, source: str) -> None:
    """Check that a coordinate rises in equal steps.

    Raises:
        InputError: it does not, or is not a row of finite numbers.
    """
    if values.ndim != 1 or values.size == 0 or not np.isfinite(values).all():
        raise InputError(
            f"{source}: coordinate {name} is not a row of finite numbers; "
            "make the map with `ambinav map`."
        )
    steps = np.diff(values)
    if steps.size and not (
        steps.min() > 0.0 and np.allclose(steps, steps.mean(), rtol=1e-6, atol=1e-9)
    ):
        raise InputError(
            f"{source}: coordinate {name} does not rise in equal steps; "
            "make the map with `ambinav map`."
        )
