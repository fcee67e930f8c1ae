"""Building of an ambiguity volume: a map at each of several heights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from ambinav.buildings.flight_levels import flight_levels
from ambinav.casting.triangles import triangles_of
from ambinav.config import as_number, as_positive, check_kind
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_volume import SURFACES, AmbiguityVolume
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, reporter, step_of
from ambinav.sensing.scanner import RangeScanner

if TYPE_CHECKING:
    from ambinav.store.map_store import MapStore

# Metres. A sensor has to be above the floor of its map; the lowest one is so far.
_OVER: Final = 1e-3


def build_volume(
    env: Environment,
    scanner: RangeScanner | str | Path,
    heights: Sequence[float],
    spacing: float = 0.2,
    *,
    robot_radius: float = 0.2,
    progress: bool | Progress = False,
    store: bool | MapStore = True,
    **settings: Any,
) -> AmbiguityVolume:
    """Compute the ambiguity of a flying robot at several heights of a building in space.

    At each height a map is built of what the robot can reach there (`flight_levels`), with rays in
    three dimensions. All have one lattice; at heights where a cell is not free it has no value.

    Args:
        env: A building in space: of an .ifc file, of a mesh, or `env.in_space(extruded(env, m))`.
        scanner: As for `build_map`. Its mounts count from the robot's frame, up and down.
        heights: z of the robot's frame in the map frame, two or more in equal steps, metres.
        spacing: Distance between lattice points in the plane, metres.
        robot_radius: Radius of the sphere that covers the robot, metres.
        progress: As for `build_map`.
        store: As for `build_map`: of the map at each height.
        settings: Further arguments of `build_map`, the same at every height.

    Returns:
        The volume, with the surfaces of the building. Of a scanner that does not look all around it
        holds the aggregates over heading.

    Raises:
        InputError: the heights do not rise in equal steps, see `flight_levels`, or see `build_map`.
    """
    try:
        levels = np.array([as_number(z, "heights") for z in heights])
    except TypeError:
        raise InputError(f"heights is {heights!r}; give two or more heights in metres.") from None
    if len(levels) < 2 or not (
        np.diff(levels) > 0.0
    ).all() or not np.allclose(np.diff(levels), np.diff(levels).mean()):  # fmt: skip
        raise InputError(
            f"heights is {heights!r}; give two or more that rise in equal steps, in metres."
        )
    robot_radius = as_positive(robot_radius, "robot_radius", "metres")
    check_kind(env, Environment, "env", "give what `load_environment` returns")
    if not isinstance(scanner, RangeScanner):
        scanner = RangeScanner.load(scanner)
    lift = max(_OVER - float(scanner.upright[:, 0].min()), 0.0)
    raised = scanner.raised(lift) if lift else scanner
    if settings.get("map_std") is None:
        # That of the building: cut at a height it is one of unknown origin.
        settings = {**settings, "map_std": env.map_std}
    made = []
    with reporter(progress, f"{env.name}, {scanner.name}") as report:
        floors = flight_levels(env, levels.tolist(), robot_radius, drop=lift)
        for k, level in enumerate(floors):
            amap = build_map(
                level, raised, spacing, progress=step_of(report, k, len(floors)),
                robot_radius=robot_radius, store=store, **settings,
            )  # fmt: skip
            dataset = amap.dataset
            names = [name for name in amap.layers if dataset[name].dims == ("y", "x")]
            names = [name for name in names if dataset[name].dtype.kind == "f" or name == "free"]
            made.append(dataset[names].drop_vars("theta", errors="ignore"))
    fill = {name: False if name == "free" else np.nan for name in made[0].data_vars}
    volume = xr.concat(
        made, xr.Variable("z", levels, {"units": "m"}), join="outer", fill_value=fill,
        combine_attrs="override", data_vars="all", coords="minimal", compat="override",
    )  # fmt: skip
    volume.attrs["environment"] = env.name
    assert env.space is not None  # or there were no levels
    surfaces = triangles_of(env.space, env.bounds)
    volume[SURFACES] = ("triangle", "corner", "axis"), surfaces, {"units": "m"}
    return AmbiguityVolume(volume, source=f"the volume of {env.name}")
