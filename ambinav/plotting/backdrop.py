"""What lies around and beside the floor that counts: solid, unknown, unexplored, not reachable.

All pictures of a floor share these colours and their entries in the legend.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Patch
from numpy.typing import NDArray
from scipy import ndimage

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.floor_parts import FloorParts
from ambinav.maps.zones import (
    SOLID_COLOUR,
    UNEXPLORED_COLOUR,
    UNKNOWN_COLOUR,
    UNREACHABLE_COLOUR,
)

Bounds = tuple[float, float, float, float]

STRIPES: Final = 90
"""Stripes of unexplored floor across the longer side of a picture."""
HALF_CELLS: Final = 2
"""Cells across a stripe, at least."""
THICK: Final = 5
"""Cells across something solid from which it is a block, not a wall."""
EDGE: Final = "#555555"
"""Line around the colours of a legend."""


def draw_backdrop(axes: Axes, amap: AmbiguityMap, unknown: str = UNKNOWN_COLOUR) -> None:
    """Fill what is not free, below everything: what is solid, and what is not known."""
    padding = 3 + max(amap.solid.shape) // 50
    solid = _padded_solid(amap, padding)
    picture = np.where(solid[..., np.newaxis], to_rgba(SOLID_COLOUR), to_rgba(unknown))
    bounds = np.array(amap.bounds) + padding * amap.spacing * np.array([-1, -1, 1, 1])
    xmin, ymin, xmax, ymax = bounds.tolist()
    limits = axes.get_xlim(), axes.get_ylim()
    axes.imshow(
        picture,
        extent=(xmin, xmax, ymin, ymax),
        origin="lower",
        interpolation="nearest",
        zorder=0.5,
    )
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])


def _padded_solid(amap: AmbiguityMap, padding: int) -> NDArray[np.bool_]:
    """What is solid, with so many cells of margin on each side.

    Blocks of an occupancy map go on beyond the outermost cells, walls do not. A drawn plan ends at
    its outline, and an obstacle that stands there ends with it.
    """
    solid = np.zeros(np.add(amap.solid.shape, 2 * padding), dtype=np.bool_)
    if amap.dataset.attrs.get("environment_resolution", "null") != "null":
        blocks = ndimage.binary_opening(amap.solid, np.ones((THICK, THICK)))
        solid = np.pad(blocks, padding, mode="edge")
    solid[padding:-padding, padding:-padding] = amap.solid
    return solid


def paint_parts(
    picture: NDArray[np.float64], amap: AmbiguityMap, parts: FloorParts, bounds: Bounds
) -> None:
    """Lay stripes over unexplored floor and grey over what is not reached.

    Args:
        picture: Colours of the cells, shape (ny, nx, 4), changed in place.
        amap: The map.
        parts: Of its floor.
        bounds: (xmin, ymin, xmax, ymax) of the picture, metres: the stripes are laid for it.
    """
    picture[parts.unreachable] = to_rgba(UNREACHABLE_COLOUR)
    size = max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    half = max(round(0.5 * size / STRIPES / amap.spacing), HALF_CELLS)
    row, column = np.indices(parts.unexplored.shape)
    # At an angle of 45 degrees, as the hatching of the legend.
    dark = (column - row) % (2 * half) < half
    picture[parts.unexplored & dark] = to_rgba(UNEXPLORED_COLOUR)
    picture[parts.unexplored & ~dark] = to_rgba(UNKNOWN_COLOUR)


def unexplored_patch(label: str) -> Patch:
    """Entry of a legend for floor that is not explored."""
    return Patch(
        facecolor=UNKNOWN_COLOUR,
        edgecolor=UNEXPLORED_COLOUR,
        hatch="/////",
        linewidth=0.6,
        label=label,
    )


def part_patches(amap: AmbiguityMap, parts: FloorParts) -> list[Patch]:
    """Entries of a legend for the parts of the floor that do not count, if there are any."""
    patches = []
    if parts.unexplored.any():
        patches.append(unexplored_patch(f"unexplored\n{area_text(parts.area(parts.unexplored))}"))
    if parts.unreachable.any():
        label = f"not reachable by a\nrobot of {parts.radius or 0.0:.2f} m, "
        label += area_text(parts.area(parts.unreachable))
        patches.append(colour_patch(UNREACHABLE_COLOUR, label))
    return patches


def outside_patches(amap: AmbiguityMap, bounds: Bounds) -> list[Patch]:
    """Entries of a legend for what is not free, as much of it as a picture shows.

    Args:
        amap: The map.
        bounds: (xmin, ymin, xmax, ymax) of the picture, metres.
    """
    x, y = amap.dataset["x"].values, amap.dataset["y"].values
    shown = np.ix_(
        (y > bounds[1]) & (y < bounds[3]),
        (x > bounds[0]) & (x < bounds[2]),
    )
    solid, free = amap.solid[shown], np.asarray(amap.dataset["free"].values)[shown]
    patches = []
    if (~free & solid).any():
        patches.append(colour_patch(SOLID_COLOUR, "solid"))
    if (~free & ~solid).any():
        patches.append(colour_patch(UNKNOWN_COLOUR, "unknown"))
    return patches


def colour_patch(colour: str, label: str) -> Patch:
    """Entry of a legend for a colour of the floor."""
    return Patch(facecolor=colour, edgecolor=EDGE, linewidth=0.6, label=label)


def area_text(area: float) -> str:
    """An area in square metres as a legend tells it."""
    return f"{area:,.0f} m²" if area >= 10 else f"{area:.1f} m²"
