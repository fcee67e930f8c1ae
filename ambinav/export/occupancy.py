"""Buildings as occupancy grids in map_server's format: a YAML file and a PGM image."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
import yaml
from PIL import Image

from ambinav.export.raster import Raster
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import edges_of
from ambinav.runtime.array_types import Bytes
from ambinav.runtime.errors import InputError

FREE: Final = 254
OCCUPIED: Final = 0
UNKNOWN: Final = 205
"""Grey as map_saver writes it."""
TRINARY: Final = {"occupied_thresh": 0.65, "free_thresh": 0.196}
MOST_CELLS: Final = 178_956_970
"""Maximum size that `buildings.map_server` reads, and Pillow without a warning."""
REACH: Final = 2.5
"""Cells that lie this near to a wall and are not free are the wall's own: as far as a fitted wall
may lie from the cells that it represents."""


def save_map_server(
    path: Path, pixels: Bytes, raster: Raster, mode: str, **thresholds: float
) -> tuple[Path, ...]:
    """Write a grey image and its YAML file.

    Args:
        path: The YAML file; the image stands beside it.
        pixels: uint8, shape (ny, nx), row 0 at the smallest y; the image has it at the bottom.
        raster: Where the cells lie.
        mode: "trinary", "scale" or "raw".
        thresholds: `occupied_thresh` and `free_thresh`.
    """
    image = path.with_suffix(".pgm")
    Image.fromarray(np.ascontiguousarray(np.flipud(pixels))).save(image)
    header: dict[str, Any] = {
        "image": image.name,
        "mode": mode,
        "resolution": raster.resolution,
        "origin": [raster.x, raster.y, 0.0],
        "negate": 0,
        **thresholds,
    }
    path.write_text(yaml.safe_dump(header, sort_keys=False), encoding="utf-8")
    return path, image


def raster_of(environment: Environment, resolution: float | None, spacing: float) -> Raster:
    """Return the cells a building is drawn with: those of its own map, if it comes from one.

    Args:
        environment: The building.
        resolution: Edge of a cell, metres; None: of its own map, or else the spacing.
        spacing: Spacing of the lattice of its ambiguity map, metres.

    Raises:
        InputError: there would be too many.
    """
    # Far from the origin, the last digits of a lattice's spacing are those of its coordinates.
    size = resolution or environment.resolution or float(np.round(spacing, 9))
    extent = environment.extent
    if extent is not None and _upright(extent):
        xmin, ymin, xmax, ymax = extent.bounds
    else:
        # A cell to spare, so that walls on the rim are drawn whole.
        xmin, ymin, xmax, ymax = environment.bounds
        xmin, ymin = (size * (math.floor(low / size) - 1) for low in (xmin, ymin))
        xmax, ymax = xmax + size, ymax + size
    shape = tuple(
        max(1, math.ceil((high - low) / size - 1e-6)) for low, high in ((ymin, ymax), (xmin, xmax))
    )
    if shape[0] * shape[1] > MOST_CELLS:
        raise InputError(
            f"--resolution: cells of {size:g} m make an image of {shape[1]} x {shape[0]} cells, "
            f"more than the {MOST_CELLS} that programs read; give a larger one."
        )
    return Raster(float(np.round(xmin, 9)), float(np.round(ymin, 9)), size, (shape[0], shape[1]))


def _upright(extent: shapely.Polygon) -> bool:
    return bool(math.isclose(extent.area, shapely.box(*extent.bounds).area, rel_tol=1e-9))


def occupancy(environment: Environment, raster: Raster, *, for_rays: bool = False) -> Bytes:
    """Return the grey value of each cell, uint8, (ny, nx): free, occupied or unknown.

    A cell is free if its centre is where a robot may be (`Environment.collision`) and, on a drawn
    plan, no wall runs through it, nor a pane that rays pass. Where one runs through a cell that is
    not free, or, on a building from an occupancy map, within `REACH` cells of it, it is occupied;
    the rest is unknown.

    Args:
        environment: The building.
        raster: The cells.
        for_rays: Draw of a drawn plan what rays meet: panes that they pass are floor.
    """
    barriers = environment.segments.xy[environment.segments.walls]
    floor, drivable = environment.free, environment.drivable
    is_plan = environment.resolution is None
    if drivable is not None and not (is_plan and for_rays):
        floor = drivable
        if is_plan:
            barriers = np.vstack([barriers, edges_of(drivable)])
    free, near = raster.inside(floor), raster.crossed(barriers)
    if is_plan:
        free &= ~near
    else:
        from scipy.ndimage import binary_dilation  # takes a third of a second

        steps = np.arange(-math.floor(REACH), math.floor(REACH) + 1)
        disc = np.hypot(steps[:, np.newaxis], steps) <= REACH
        near = binary_dilation(near, structure=disc)
    pixels = np.full(raster.shape, UNKNOWN, dtype=np.uint8)
    pixels[near] = OCCUPIED
    pixels[free] = FREE
    return pixels
