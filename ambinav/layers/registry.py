"""Registry of layers that can be added to an ambiguity map."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from ambinav.casting.prisms.prisms import Prisms
from ambinav.config import nearest
from ambinav.maps import schema
from ambinav.maps.core_layers import CORE_LAYERS, LayerRecord
from ambinav.plugins import Registry
from ambinav.runtime.array_types import Floats32
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment

ALL: Final = "all"
"""Stands for every layer that the scanner can have, but those that are slow."""

_NAME: Final = re.compile(r"[a-z][a-z0-9_]*")


def any_scanner(scanner: RangeScanner) -> None:
    """Return None: the `why_not` of a layer that every scanner can have."""


@dataclass(frozen=True, kw_only=True)
class Layer(LayerRecord):
    """A measure of how well a robot is localized at a pose, computed for a whole map.

    Its `worse` is one of the two ends.

    Attributes:
        compute: From the `LayerContext` and the layer's own keyword options to arrays, the layer
            under its name and each companion under its own; float32, shape (ny, nx), or
            (ny, nx, K) for K headings; NaN where the lattice is not free (`LayerContext.spread`
            makes them).
        why_not: Why a scanner cannot have it, as a sentence, or None.
        companions: Title and unit of each further array that `compute` gives. Their names begin
            with the layer's and an underscore; one that ends in "_direction" is an axis
            (radians, period pi).
        high_is_good: Companions that are high where a robot is well localized: no costs.
        slow: Left out of `ALL`; it has to be named.
        in_space: Whether it is known of buildings in space and of scanners that look up and down:
            whether all that it casts goes through `LayerContext.returns`, `scans.scan_rays` or
            `cast_tables`.
        not_in_space: Message if it does not support buildings in space.
        prisms_alone: Whether it is known in space of prisms alone (`cast_tables`).
        lasers_alone: Whether it is known in space of lasers alone.
        reach: From the context and the options, how far from a cell a change of the building may
            be and still change the layer there, metres, whatever stands between; what lies
            further off must not matter, nor cells beyond the map's radius. None: no limit is
            known, so that for a changed building (`AmbiguityMap.update`) it is computed in full.
        compares_cells: Whether its values at a cell depend on other cells of the map, so that a
            part of a map (`AmbiguityMap.open(bounds=)`) cannot have it.
    """

    compute: Callable[..., Mapping[str, Floats32]]
    why_not: Callable[[RangeScanner], str | None] = any_scanner
    companions: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    high_is_good: tuple[str, ...] = ()
    slow: bool = False
    in_space: bool = False
    not_in_space: str = "the layer is known for plans and level beams alone; leave it out."
    prisms_alone: bool = False
    lasers_alone: bool = False
    reach: Callable[..., float] | None = None
    compares_cells: bool = False

    def __post_init__(self) -> None:
        """Check the names, which become variables of the dataset.

        Raises:
            InputError: a name cannot be used.
        """
        if not _NAME.fullmatch(self.name):
            raise InputError(
                f"layer {self.name!r}: give a name of lower-case letters, digits and underscores."
            )
        for name in (self.name, *self.companions):
            if schema.base_name(name) != name:
                raise InputError(
                    f"layer {name!r}: _{name.rpartition('_')[2]} is kept for summaries over "
                    "heading; give another name."
                )
            if name in schema.CORE:
                raise InputError(f"layer {name!r}: every map has a layer of that name; rename it.")
        if self.worse not in ("high", "low"):
            raise InputError(f"layer {self.name!r}: worse is {self.worse!r}; give high or low.")
        for name in self.high_is_good:
            if name not in self.companions:
                raise InputError(
                    f"layer {self.name!r}: high_is_good names {name!r}; give names of companions."
                )
        for name in self.companions:
            if not name.startswith(f"{self.name}_"):
                raise InputError(
                    f"layer {self.name!r}: its companion {name!r} must begin with {self.name}_."
                )


LAYERS: Final = Registry(
    "layer",
    Layer,
    "ambinav.layers",
    {
        "position": "ambinav.layers.position:LAYER",
        "fisher": "ambinav.layers.fisher:LAYER",
        "localizability": "ambinav.layers.localizability:LAYER",
        "coastal_entropy": "ambinav.layers.coastal_entropy:LAYER",
        "gfm": "ambinav.layers.gfm:LAYER",
        "wall_normals": "ambinav.layers.wall_normals:LAYER",
        "clearance": "ambinav.layers.clearance:LAYER",
        "perturbation": "ambinav.layers.perturbation:LAYER",
        "aliasing": "ambinav.layers.aliasing.layer:LAYER",
        "reflectors": "ambinav.layers.reflectors.layer:LAYER",
        "beacons": "ambinav.layers.beacons:LAYER",
        "best_yaw": "ambinav.layers.best_yaw:LAYER",
        "best_aperture": "ambinav.layers.best_aperture:LAYER",
        "expected_error": "ambinav.forecasting.steady_layers:EXPECTED_ERROR",
        "lost_rate": "ambinav.forecasting.steady_layers:LOST_RATE",
    },
)
"""The layers that can be added to a map; `build_map`, `with_layers` and the plots know them all."""


def on_request(name: str) -> tuple[str, ...]:
    """Return the name for `build_map(..., layers=...)` if maps only have the layer on request."""
    return (name,) if name in LAYERS.names() else ()


def check_known(name: str) -> None:
    """Check, before a map is made, that it can have a layer.

    Raises:
        InputError: no map can; the nearest names are offered.
    """
    layer_names = {*CORE_LAYERS, *LAYERS.names()}
    if schema.base_name(name) not in layer_names:
        raise InputError(f"layer {name!r} is unknown; {nearest(name, layer_names)}.")


def chosen_layers(
    names: str | Iterable[str], scanner: RangeScanner | None, environment: Environment | None = None
) -> tuple[Layer, ...]:
    """Return the layers of these names, each once.

    Args:
        names: Names, or one name; `ALL` means every layer that the scanner supports.
        scanner: What the map is for; None: only the names are checked.
        environment: What the map is made of; None: a plan.

    Raises:
        InputError: there is no such layer, or the scanner cannot have it.
    """
    chosen: dict[str, Layer] = {}
    for name in (names,) if isinstance(names, str) else names:
        if name == ALL:
            every = map(LAYERS.get, LAYERS.names())
            chosen |= {
                layer.name: layer
                for layer in every
                if not layer.slow
                and (scanner is None or _reason(layer, scanner, environment) is None)
            }
            continue
        try:
            layer = LAYERS.get(name)
        except InputError as error:
            raise InputError(f"layers: {error}") from error
        reason = None if scanner is None else _reason(layer, scanner, environment)
        if reason is not None:
            raise InputError(f"layers: scanner {_called(scanner)} cannot have {name}: {reason}")
        chosen[name] = layer
    return tuple(chosen.values())


def _reason(layer: Layer, scanner: RangeScanner, environment: Environment | None) -> str | None:
    in_space = environment is not None and environment.space is not None
    if not layer.in_space and (in_space or not scanner.level):
        which = "the building is in space" if in_space else "it looks up and down"
        return f"{which}, and {layer.not_in_space}"
    if environment is not None and in_space:
        cones = any(sensor.aperture > 0.0 for sensor in scanner.sensors)
        if layer.lasers_alone and cones:
            return "the building is in space, and the layer is known of lasers alone; leave it out."
        if layer.prisms_alone and not isinstance(environment.space, Prisms):
            return "the building is a mesh, and the layer is known of prisms alone; leave it out."
    with LAYERS.calling(layer.name):
        return layer.why_not(scanner)


def _called(scanner: RangeScanner | None) -> str:
    return repr(scanner.name) if scanner is not None else "?"
