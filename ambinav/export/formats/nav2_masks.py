"""Masks of Nav2's costmap filters, each with the parameters that enable it.

A mask is an occupancy grid whose values 0 to 100 the filter takes for costs, speed limits or a
switch (`value = base + multiplier * mask`). It is written in map_server's mode "raw", in which the
grey of a pixel is the value of its cell, so that nothing is rounded twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from ambinav.export.formats.nav2_launch import launch_file
from ambinav.export.occupancy import save_map_server
from ambinav.export.options import BAD, MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.maps import schema
from ambinav.maps.zones import OPEN, ZONES
from ambinav.runtime.array_types import Bytes
from ambinav.runtime.errors import InputError

# In mode raw nothing is compared with them, but map_server's readers want them there.
RAW: Final = {"occupied_thresh": 0.65, "free_thresh": 0.196}
MARKED: Final = 100
MOST_PREFERENCE: Final = 90
"""Maximum of a graded mask, at layer 1: costs up to 99 are not lethal, and inflation adds up."""
SLOWEST: Final = 30.0
KEPT_OUT: Final = (ZONES[OPEN],)
"""Without corridors: a building has no other path between its rooms."""
KEEPOUT_TYPE, PERCENT_TYPE, METRES_TYPE, BINARY_TYPE = 0, 1, 2, 3
"""Types of filters in nav2_msgs/CostmapFilterInfo."""


@dataclass(frozen=True, kw_only=True)
class FilterInfo:
    """Description of a mask for Nav2's costmap filter info server.

    Attributes:
        name: Name of the filter: "keepout", "preference", "speed", "binary".
        plugin: The class of the filter.
        type: Code of its type.
        base: See the module.
        multiplier: See the module.
        costmap: The costmap that it belongs in.
        extra: Further parameters of the filter.
    """

    name: str
    plugin: str
    type: int
    base: float
    multiplier: float
    costmap: str
    extra: dict[str, Any]


def parameters(info: FilterInfo, mask: str) -> dict[str, Any]:
    """Return ROS parameters of servers and filter, by node, named as in nav2_bringup.

    Topics are absolute: before Kilted, Nav2's costmaps look for others in their own namespace.
    """
    server, publisher = f"{info.name}_filter_mask_server", f"{info.name}_costmap_filter_info_server"
    topic, info_topic = f"/{info.name}_filter_mask", f"/{info.name}_costmap_filter_info"
    plugin = {"plugin": info.plugin, "enabled": True, "filter_info_topic": info_topic, **info.extra}
    return {
        server: {"ros__parameters": {"topic_name": topic, "yaml_filename": mask}},
        publisher: {
            "ros__parameters": {
                "type": info.type,
                "filter_info_topic": info_topic,
                "mask_topic": topic,
                "base": info.base,
                "multiplier": info.multiplier,
            }
        },
        f"lifecycle_manager_{info.name}_filter": {
            "ros__parameters": {"autostart": True, "node_names": [server, publisher]}
        },
        info.costmap: {
            info.costmap: {
                "ros__parameters": {
                    "filters": [f"{info.name}_filter"],
                    f"{info.name}_filter": plugin,
                }
            }
        },
    }


def marked(export: MapExport, usual: tuple[str, ...]) -> Bytes:
    """Return 100 in the named zones, or where a layer reaches a threshold; 0 elsewhere.

    Floor that is not judged (unexplored or out of reach) is not marked.

    Args:
        export: Map and options.
        usual: The zones where nobody names any.
    """
    options = export.options
    if options.threshold is None:
        if options.layer is not None:
            raise InputError("--layer is for --threshold here; give both, or zones with --zone.")
        mask = np.isin(export.counted("zone"), export.zone_codes(usual))
    else:
        with np.errstate(invalid="ignore"):
            values = export.counted(options.layer or export.amap.cost_layer)
            mask = values >= options.threshold
    return np.where(mask, MARKED, 0).astype(np.uint8)


def graded(export: MapExport, most: float) -> Bytes:
    """Scale a layer from 0 to 1 to 0 to `most`, 0 off the judged floor, uint8, (ny, nx).

    Raises:
        InputError: the layer does not run from 0 to 1.
    """
    layer = export.options.layer or export.amap.cost_layer
    values = np.nan_to_num(export.counted(layer), nan=0.0)
    if not schema.is_share(layer) and (values.min() < 0.0 or values.max() > 1.0):
        raise InputError(
            f"--layer: {layer} runs from {values.min():.3g} to {values.max():.3g}, and a mask "
            "needs 0 to 1; give level, major, minor or ambiguity."
        )
    return np.rint(np.clip(values, 0.0, 1.0) * most).astype(np.uint8)


def _save(export: MapExport, path: Path, mask: Bytes, info: FilterInfo) -> tuple[Path, ...]:
    if not mask.any():
        export.note_empty(path, "no judged floor of the map is to be marked")
    written = save_map_server(path, mask, Raster.of_map(export.amap), "raw", **RAW)
    params, launch = (path.with_name(path.stem + end) for end in SUFFIXES[2:])
    head = (
        f"# For Nav2: {launch.name} starts the first three nodes with these parameters.\n"
        f"# Merge those of {info.costmap} into yours, in a namespace with topics /NAMESPACE/...\n"
    )
    body = yaml.safe_dump(parameters(info, _mask_path(export, path.name)), sort_keys=False)
    params.write_text(head + body, encoding="utf-8")
    launch.write_text(launch_file(info.name), encoding="utf-8")
    return *written, params, launch


def _mask_path(export: MapExport, name: str) -> str:
    """Return the mask's path in the parameters: in the package's share, or beside them."""
    package, _, folder = (export.options.package or "").strip("/").partition("/")
    return f"$(find-pkg-share {package})/{folder}/{name}".replace("//", "/") if package else name


def write_keepout(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write a mask that is lethal in the chosen zones."""
    return _save(export, path, marked(export, KEPT_OUT), _keepout("keepout"))


def write_preference(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write a mask that makes ambiguous floor expensive, and nowhere lethal."""
    return _save(export, path, graded(export, MOST_PREFERENCE), _keepout("preference"))


def write_speed(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write a mask that slows a robot down where it is poorly localized."""
    options = export.options
    slowest = SLOWEST if options.slowest is None else options.slowest
    fastest = 100.0 if options.max_speed is None else options.max_speed
    # 100 would be a limit of 0, which Nav2 takes for no limit.
    mask = np.minimum(graded(export, 100.0 - slowest), MARKED - 1).astype(np.uint8)
    info = FilterInfo(
        name="speed",
        plugin="nav2_costmap_2d::SpeedFilter",
        type=PERCENT_TYPE if options.max_speed is None else METRES_TYPE,
        base=fastest,
        multiplier=-fastest / 100.0,
        costmap="local_costmap",
        extra={"speed_limit_topic": "/speed_limit"},
    )
    return _save(export, path, mask, info)


def write_binary(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write a mask that triggers a switch in the chosen zones."""
    info = FilterInfo(
        name="binary",
        plugin="nav2_costmap_2d::BinaryFilter",
        type=BINARY_TYPE,
        base=0.0,
        multiplier=1.0,
        costmap="local_costmap",
        extra={
            "default_state": False,
            "binary_state_topic": "/ambiguous_floor",
            "flip_threshold": 50.0,
        },
    )
    return _save(export, path, marked(export, BAD), info)


def _keepout(name: str) -> FilterInfo:
    return FilterInfo(
        name=name,
        plugin="nav2_costmap_2d::KeepoutFilter",
        type=KEEPOUT_TYPE,
        base=0.0,
        multiplier=1.0,
        costmap="global_costmap",
        extra={},
    )


SUFFIXES: Final = (".yaml", ".pgm", "_params.yaml", "_launch.py")

KEEPOUT: Final = Exporter(
    subject="map",
    format="nav2-keepout",
    title="a mask that forbids zones, or all above a threshold",
    reader="Nav2, KeepoutFilter (type 0)",
    write=write_keepout,
    suffixes=SUFFIXES,
    uses=frozenset({"zones", "layer", "threshold", "heading", "package"}),
)
PREFERENCE: Final = replace(
    KEEPOUT,
    format="nav2-preference",
    title="a graded mask: ambiguous floor costs more, none is forbidden",
    reader="Nav2, KeepoutFilter (type 0) as for preferred lanes",
    write=write_preference,
    uses=frozenset({"layer", "heading", "package"}),
)
SPEED: Final = replace(
    KEEPOUT,
    format="nav2-speed",
    title="a mask of speed limits, lower where the floor is more ambiguous",
    reader="Nav2, SpeedFilter (type 1, percent; with --max-speed type 2, m/s)",
    write=write_speed,
    uses=frozenset({"layer", "slowest", "max_speed", "heading", "package"}),
)
BINARY: Final = replace(
    KEEPOUT,
    format="nav2-binary",
    title="a mask that switches a topic in zones, or above a threshold",
    reader="Nav2, BinaryFilter (type 3)",
    write=write_binary,
)
