"""Dataset of an ambiguity map: its layers with units and provenance, in xarray."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import shapely
import xarray as xr
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.ambiguity.cost_layer import cost_layer
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.tensor import classify, classify_over_headings, relative_radii
from ambinav.casting.packed import packed
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.outside import solid_cells
from ambinav.geometry.principal_axes import principal_axes
from ambinav.maps import schema
from ambinav.maps.core_layers import CORE_LAYERS
from ambinav.maps.judged_floor import LAYER as JUDGED
from ambinav.maps.judged_floor import FloorJudge
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav.runtime.provenance import library_version
from ambinav.sensing.robot_radius import robot_radius
from ambinav.sensing.scanner import RangeScanner
from ambinav.version import __version__

SUMMARY = {"mean": "mean over heading", "best": "at the best heading", "worst": "at the worst one"}
LIBRARIES = ("numpy", "numba", "shapely", "xarray")

Values = dict[str, Floats]


@dataclass(frozen=True, eq=False)
class LatticeSums:
    """Results at the N free points of a lattice.

    Attributes:
        sums: The kernel's sums, float64, shape (N, H, 7); nan where the pose is impossible, which
            each point is at fewer than H headings.
        unknown: Share of the beams that end in unknown space, shape (N,).
        turning: Turning moments, shape (N, 2), or None.
    """

    sums: Floats
    unknown: Floats
    turning: Floats | None


def assemble(
    lattice: Lattice,
    scanner: RangeScanner,
    thinned: RangeScanner,
    model: AmbiguityModel,
    theta: Floats | None,
    results: LatticeSums,
) -> xr.Dataset:
    """Make the dataset of an ambiguity map.

    Args:
        lattice: The lattice, with N free points.
        scanner: The scanner that the map is for.
        thinned: The beams of it that took part.
        model: The parameters.
        theta: Headings, radians, shape (H,), or None for a map without heading.
        results: What was computed.
    """
    variables = pose_layers(lattice, model, theta, results)
    variables["clearance"] = clearance_layer(lattice)
    return with_judged(
        with_building(variables, lattice, scanner, thinned, model, theta),
        FloorJudge.for_robot(lattice.environment, judged_radius(scanner, model)),
    )


def judged_radius(scanner: RangeScanner, model: AmbiguityModel) -> float:
    """Return the radius of the robot that the floor of a map is judged for, metres."""
    return model.robot_radius or robot_radius(scanner)


def with_judged(dataset: xr.Dataset, judge: FloorJudge) -> xr.Dataset:
    """Return the dataset of a map with the layer of judged floor."""
    judged = judge.floor(
        dataset["free"].values, dataset["unknown"].values, dataset["x"].values,
        dataset["y"].values, 0.0,
    )  # fmt: skip
    return dataset.assign({JUDGED: judged.layer})


def clearance_layer(lattice: Lattice) -> xr.DataArray:
    """Return the distance of the free points to the nearest segment, over the lattice."""
    clear = CORE_LAYERS["clearance"]
    distance = np.full(lattice.free.shape, np.nan, dtype=np.float32)
    distance[lattice.free] = lattice.clearance(np.inf)
    return xr.DataArray(distance, dims=("y", "x"), attrs=_attributes(clear.title, clear.unit))


def pose_layers(
    lattice: Lattice, model: AmbiguityModel, theta: Floats | None, results: LatticeSums
) -> dict[str, xr.DataArray]:
    """Return the layers that the beams determine, as variables over the lattice.

    Args:
        lattice: The lattice, with N free points.
        model: The parameters.
        theta: Headings, radians, shape (H,), or None for a map without heading.
        results: What was computed.
    """
    layers = relative_radii(results.sums)
    zone = classify(layers["major"], layers["minor"], model.low, model.high)
    variables: dict[str, xr.DataArray] = {}

    def add(name: str, values: NDArray[Any], summary: str = "") -> None:
        record = CORE_LAYERS[name]
        dtype: type[np.generic] = np.uint8 if name == "zone" else np.float32
        empty = NOT_FREE if name == "zone" else np.nan
        full = np.full((*lattice.free.shape, *values.shape[1:]), empty, dtype=dtype)
        full[lattice.free] = values
        dims = ("y", "x", "theta")[: full.ndim]
        of_all = "over all headings" if (name, summary) == ("zone", "mean") else None
        title = f"{record.title} ({of_all or SUMMARY[summary]})" if summary else record.title
        key = f"{name}_{summary}" if summary else name
        variables[key] = xr.DataArray(full, dims=dims, attrs=_attributes(title, record.unit))

    for name, values in (layers | {"zone": zone}).items():
        add(name, values[:, 0] if theta is None else values)
    if theta is not None:
        _summarize(layers, zone, theta, results.sums, add)
    if results.turning is not None:
        add("heading_radius", results.turning[:, 0])
        add("heading", np.minimum(results.turning[:, 0] / results.turning[:, 1], 1.0))
    add("unknown", results.unknown)
    return variables


def with_building(
    variables: dict[str, xr.DataArray],
    lattice: Lattice,
    scanner: RangeScanner,
    thinned: RangeScanner,
    model: AmbiguityModel,
    theta: Floats | None,
    solid: Bools | None = None,
) -> xr.Dataset:
    """Make the dataset of a map from its layers and the building.

    Args:
        variables: `pose_layers`, and the clearance.
        lattice: The lattice.
        scanner: The scanner that the map is for.
        thinned: The beams of it that took part.
        model: The parameters.
        theta: Headings, radians, shape (H,), or None for a map without heading.
        solid: What `solid_cells` would give, if it is known.
    """
    variables |= _building(lattice, solid_cells(lattice) if solid is None else solid)
    coords = {
        "x": ("x", lattice.x, {"long_name": "x of the cell's centre", "units": "m"}),
        "y": ("y", lattice.y, {"long_name": "y of the cell's centre", "units": "m"}),
    }
    if theta is not None:
        coords["theta"] = ("theta", theta, {"long_name": "heading", "units": "rad"})
    # Aligning arrays takes longer than all else here.
    plain = {name: array.variable for name, array in variables.items()}
    return xr.Dataset(plain, coords, _provenance(lattice, scanner, thinned, model, theta))


def _building(lattice: Lattice, solid: Bools) -> dict[str, xr.DataArray]:
    """Return the variables of the map that describe the building."""
    free = CORE_LAYERS["free"]
    segments = lattice.environment.segments
    arrays: dict[str, tuple[NDArray[Any], tuple[str, ...], str, str]] = {
        "free": (lattice.free, ("y", "x"), free.title, free.unit),
        schema.BACKDROP: (
            solid, ("y", "x"), "something in the cell is known to be solid", "bool",
        ),
        "segments": (
            segments.xy, ("segment", "end"),
            "end points ax, ay, bx, by of walls and frontiers", "m",
        ),
        "segment_kind": (
            segments.kind, ("segment",), "0: wall, 1: frontier, 2: reflector, 3: glass", "code",
        ),
        "floor": (
            _outline(lattice.environment.free), ("byte",),
            "outline of the free space as well-known binary", "m",
        ),
    }  # fmt: skip
    space = lattice.environment.space
    npz = None if space is None else packed(space)
    if npz is not None:
        arrays["space"] = (npz, ("space_byte",), "walls and solids in space as an .npz file", "m")
    drivable = lattice.environment.drivable
    if drivable is not None:
        title = "outline of the space without occupied cells as well-known binary"
        arrays["drivable"] = (_outline(drivable), ("drivable_byte",), title, "m")
    return {
        name: xr.DataArray(values, dims=dims, attrs=_attributes(title, unit))
        for name, (values, dims, title, unit) in arrays.items()
    }


def _outline(free: BaseGeometry) -> Bytes:
    """Encode a polygon as well-known binary."""
    return np.frombuffer(shapely.to_wkb(free), dtype=np.uint8).copy()


def labels(env: Environment, scanner: RangeScanner) -> dict[str, str]:
    """Return attributes with the building's name and origin, which affect no number."""
    return {
        "title": f"Ambiguity map of {env.name} for {scanner.name}",
        "environment": env.name,
        "environment_source": "" if env.source is None else str(env.source),
        "environment_sha256": env.checksum,
        "environment_notes": json.dumps(list(env.notes)),
    }


def _attributes(title: str, unit: str) -> dict[str, str]:
    """Return the attributes of a variable: its title and unit."""
    return {"long_name": title, "units": unit}


def _summarize(
    layers: Values,
    zone: Bytes,
    theta: Floats,
    sums: Floats,
    add: Callable[[str, NDArray[Any], str], None],
) -> None:
    """Add the aggregates over the possible headings."""

    def names_with(summary: str) -> list[str]:
        return [layer.name for layer in CORE_LAYERS.values() if summary in layer.summaries]

    for name in names_with("mean"):
        add(name, np.nanmean(layers[name], axis=1), "mean")
    add("zone", classify_over_headings(zone), "mean")
    mean = np.nanmean(sums, axis=1)
    add("direction", principal_axes(mean[:, 1], mean[:, 2], mean[:, 3])[2], "mean")
    level = layers["level"]
    best = np.nanargmin(level, axis=1)
    # Among equal values, take the last.
    worst = level.shape[1] - 1 - np.nanargmax(level[:, ::-1], axis=1)
    for summary, place in (("best", best), ("worst", worst)):
        for name in names_with(summary):
            values = zone if name == "zone" else layers[name]
            chosen = np.take_along_axis(values, place[:, np.newaxis], axis=1)
            add(name, chosen[:, 0], summary)
    add("best_heading", theta[best], "")


def _provenance(
    lattice: Lattice,
    scanner: RangeScanner,
    thinned: RangeScanner,
    model: AmbiguityModel,
    theta: Floats | None,
) -> dict[str, str]:
    """Return attributes with everything the map was made from."""
    env = lattice.environment
    # How far the beams are moved for a map without headings.
    moved = scanner.mounts[:, :2] - scanner.centred.mounts[:, :2]
    off_centre = float(np.hypot(*moved.T).max()) if theta is None else 0.0
    parameters = {
        "spacing": lattice.spacing,
        **model.as_dict(),
        "headings": None if theta is None else len(theta),
        "beams_used": thinned.beams,
        "beams": scanner.beams,
        "free_poses": int(lattice.free.sum()),
        "off_centre": off_centre,
    }
    versions = {name: library_version(name) for name in LIBRARIES}
    return {
        **labels(env, scanner),
        "frame": "map",
        "units": "metres, radians",
        "environment_space": "" if env.space is None else env.space.checksum,
        "environment_floor": json.dumps(env.floor),
        "environment_resolution": json.dumps(env.resolution),
        "collision": "floor" if env.drivable is None else "drivable",
        "environment_extent": json.dumps(
            [] if env.extent is None else shapely.get_coordinates(env.extent)[:4].tolist()
        ),
        "scanner": scanner.name,
        "scanner_yaml": scanner.to_yaml(),
        "cost_layer": cost_layer(scanner),
        "parameters": json.dumps(parameters),
        "ambinav_version": __version__,
        "versions": json.dumps({"python": platform.python_version(), **versions}),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }
