"""The picture of look-alikes: pairs of regions in one colour and letter, joined by a line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import FancyArrowPatch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ambinav.audit.links import Link
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.plot import draw_image, finish, floor_axes
from ambinav.maps.zones import OUTSIDE_COLOUR

# Okabe and Ito: told apart by the colour-blind too; each pair also has a letter.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
FLOOR = "#FFFFFF"


def plot_links(amap: AmbiguityMap, links: Sequence[Link], spacing: float) -> Axes:
    """Draw regions that look alike on the plain floor.

    Args:
        amap: The map.
        links: The pairs; a colour and a letter for those that start at the same point.
        spacing: Of the poses that the regions are made of, metres.
    """
    axes = floor_axes(amap)
    picture = np.where(
        amap.dataset["free"].values[..., np.newaxis], to_rgba(FLOOR), to_rgba(OUTSIDE_COLOUR)
    )
    letters = list(dict.fromkeys(link.letter for link in links))
    colour = {letter: COLOURS[i % len(COLOURS)] for i, letter in enumerate(letters)}
    # The first are the largest: they are painted last. Regions that are looked like are paler.
    for letter in reversed(letters):
        own = [link for link in links if link.letter == letter]
        _paint(picture, amap, np.concatenate([o.images for o in own]), spacing, colour[letter], 0.3)
        _paint(picture, amap, own[0].cells, spacing, colour[letter], 0.55)
    draw_image(axes, amap, picture)
    finish(axes, amap, "Places that look alike")
    for link in reversed(links):
        axes.add_patch(
            FancyArrowPatch(
                (link.x, link.y),
                (link.other_x, link.other_y),
                arrowstyle="-",
                connectionstyle="arc3,rad=0.18",
                color=colour[link.letter],
                linewidth=2.2,
                shrinkA=9,
                shrinkB=9,
                path_effects=[withStroke(linewidth=4, foreground="white")],
                zorder=8,
            )
        )
        for point in ((link.x, link.y), (link.other_x, link.other_y)):
            _mark(axes, link.letter, point, colour[link.letter])
    return axes


def _mark(axes: Axes, letter: str, point: tuple[float, float], colour: str) -> None:
    """A letter in a ring."""
    axes.annotate(
        letter,
        point,
        ha="center",
        va="center_baseline",
        fontsize=10,
        fontweight="bold",
        bbox={
            "boxstyle": "circle,pad=0.25",
            "facecolor": "white",
            "edgecolor": colour,
            "linewidth": 2.0,
        },
        zorder=10,
    )


def _paint(
    picture: NDArray[np.float64],
    amap: AmbiguityMap,
    points: NDArray[np.float64],
    spacing: float,
    colour: str,
    strength: float,
) -> None:
    """Colour the free cells of the map that a square around one of the points holds."""
    rows, columns = np.nonzero(amap.dataset["free"].values)
    cells = np.column_stack([amap.dataset["x"].values[columns], amap.dataset["y"].values[rows]])
    near, _ = cKDTree(points).query(cells, p=np.inf)
    # Look-alikes lie off the lattice, and up to a tenth farther apart than its points.
    held = near <= 0.6 * spacing
    picture[rows[held], columns[held]] = (1 - strength) + strength * np.array(to_rgba(colour))
