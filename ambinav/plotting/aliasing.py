"""The picture of look-alikes: regions in one colour and letter, joined by lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.patches import FancyArrowPatch, Patch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ambinav.audit.aliased_pairs import Link
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.floor_parts import FloorParts
from ambinav.plotting.backdrop import outside_patches, paint_parts, part_patches
from ambinav.plotting.floor import is_tall
from ambinav.plotting.maps import draw_image, finish, floor_axes, view

# Okabe and Ito: told apart by the colour-blind too; each colour also has a letter.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
FLOOR = "#FFFFFF"
DARK, PALE = 0.6, 0.25
"""Share of the colour in a place, and in what it looks like."""
BENDS = (0.18, -0.18, 0.12, -0.12, 0.06, -0.06)
EDGE = 0.01
"""So far from the picture's edge lines stay, as a share of its shorter side."""


def plot_links(
    amap: AmbiguityMap, links: Sequence[Link], spacing: float, parts: FloorParts | None = None
) -> Axes:
    """Draw regions that look alike on the plain floor.

    Args:
        amap: The map.
        links: The pairs; a colour and a letter for those that start at the same point.
        spacing: Of the poses that the regions are made of, metres.
        parts: Which floor counts; None: all that is explored.
    """
    axes = floor_axes(amap)
    picture = np.where(amap.dataset["free"].values[..., np.newaxis], to_rgba(FLOOR), 0.0)
    parts = FloorParts.of(amap) if parts is None else parts
    paint_parts(picture, amap, parts, view(amap))
    letters = list(dict.fromkeys(link.letter for link in links))
    colour = {letter: COLOURS[i % len(COLOURS)] for i, letter in enumerate(letters)}
    handles = []
    # Large places first: of these enough is left to be seen.
    for letter in letters:
        own = [link for link in links if link.letter == letter]
        everywhere = np.concatenate([part for link in own for part in (link.cells, link.images)])
        pale, dark = (_mixed(colour[letter], strength) for strength in (PALE, DARK))
        _paint(picture, amap, parts.counted, everywhere, spacing, pale)
        _paint(picture, amap, parts.counted, _around(own, spacing), spacing, dark)
        label = f"{letter} and {len(own)} look-alike{'s' if len(own) > 1 else ''}"
        handles.append(Patch(facecolor=_mixed(colour[letter], DARK), label=label))
    handles += part_patches(amap, parts) + outside_patches(amap, view(amap))
    draw_image(axes, amap, picture)
    finish(axes, amap, "Places that look alike")
    tall = is_tall(view(amap))
    if handles:
        axes.legend(
            handles=handles,
            frameon=False,
            fontsize=11,
            loc="upper left" if tall else "upper right",
            bbox_to_anchor=(1.01, 1.0) if tall else (1.0, -0.01),
            ncol=1 if tall else min(len(handles), 3),
        )
    box = view(amap)
    for link in reversed(links):
        axes.add_patch(
            FancyArrowPatch(
                (link.x, link.y),
                (link.other_x, link.other_y),
                arrowstyle="-",
                connectionstyle=f"arc3,rad={_bend(link, box)}",
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


def _bend(link: Link, box: tuple[float, float, float, float]) -> float:
    """How far a line bends aside, as a share of its length: the first that stays in the picture.

    Args:
        link: Its ends.
        box: xmin, ymin, xmax, ymax of the picture, metres.
    """
    ends = np.array([[link.x, link.y], [link.other_x, link.other_y]])
    aside = np.array([ends[1, 1] - ends[0, 1], ends[0, 0] - ends[1, 0]])
    low, high = np.reshape(box, (2, 2))
    margin = EDGE * (high - low).min()
    share = np.linspace(0.0, 1.0, 33)[:, np.newaxis]
    straight = ends[0] + share * (ends[1] - ends[0])
    for bend in BENDS:
        # Matplotlib's arc3 is a parabola.
        line = straight + 2.0 * share * (1.0 - share) * bend * aside
        if (line > low + margin).all() and (line < high - margin).all():
            return bend
    return 0.0


def _mixed(colour: str, strength: float) -> tuple[float, float, float]:
    """A colour on white."""
    red, green, blue = (1.0 - strength * (1.0 - part) for part in to_rgb(colour))
    return red, green, blue


def _around(links: Sequence[Link], spacing: float) -> NDArray[np.float64]:
    """The points of the first link's region that stand for it.

    Where a building is turned or moved onto itself, the region is all of it and so are its
    look-alikes: of these points, those nearer to the start than to any other end of the links.
    """
    first = links[0]
    ends = [first.ends[0], *(link.ends[1] for link in links)]
    images = np.concatenate([link.images for link in links])
    both = cKDTree(images).query(first.cells)[0] <= spacing
    own = cKDTree(ends).query(first.cells)[1] == 0
    return np.asarray(first.cells[~both | own])


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
    counted: NDArray[np.bool_],
    points: NDArray[np.float64],
    spacing: float,
    colour: tuple[float, float, float],
) -> None:
    """Colour the cells that count around the points, which a lattice has or a turned one."""
    rows, columns = np.nonzero(counted)
    cells = np.column_stack([amap.dataset["x"].values[columns], amap.dataset["y"].values[rows]])
    near, _ = cKDTree(points).query(cells)
    # Half the diagonal of a lattice's cell, and a little for look-alikes that lie farther apart.
    held = near <= 0.75 * spacing
    picture[rows[held], columns[held], :3] = colour
