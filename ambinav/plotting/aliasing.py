"""The picture of aliased regions: regions in one colour and letter, joined by lines."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Patch
from matplotlib.patheffects import withStroke
from scipy.spatial import cKDTree

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.plotting import style
from ambinav.plotting.floor import FloorFigure, Pixels, blend_white, label_points, rgba_bytes
from ambinav.runtime.array_types import Bools, Bounds, Floats

DARK, PALE = 0.6, 0.25
"""Share of the colour in a place, and in what it is aliased with."""
BENDS = (0.18, -0.18, 0.12, -0.12, 0.06, -0.06)
EDGE = 0.01
"""So far from the picture's edge lines stay, as a share of its shorter side."""


class AliasedPair(Protocol):
    """Two regions with the same scans; `ambinav.studies.audit.aliased_pairs.AliasedPair` is one."""

    @property
    def letter(self) -> str:
        """Letter of the pair; pairs of one letter start at the same point."""

    @property
    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """A point of each region, x and y, metres."""

    @property
    def cells(self) -> Floats:
        """The region's poses, x and y, shape (M, 2), metres."""

    @property
    def images(self) -> Floats:
        """Poses of the other region with the same scans, shape (M, 2), metres."""


def plot_aliasing(
    amap: AmbiguityMap,
    pairs: Sequence[AliasedPair],
    spacing: float,
    parts: JudgedFloor | None = None,
) -> Axes:
    """Draw regions with the same scans on the plain floor.

    Args:
        amap: The map.
        pairs: The pairs; a colour and a letter for those that start at the same point.
        spacing: Spacing of the poses in the regions, metres.
        parts: Masks of the floor that counts; None: all that is explored.
    """
    floor = FloorFigure(amap, None, "Perceptual aliasing: regions with the same scans")
    free = amap.dataset["free"].values[..., np.newaxis]
    picture = np.where(free, rgba_bytes(style.FLOOR), np.uint8(0))
    parts = amap.judged if parts is None else parts
    floor.paint_parts(picture, parts)
    letters = list(dict.fromkeys(pair.letter for pair in pairs))
    colour = dict(zip(letters, itertools.cycle(style.SERIES), strict=False))
    handles = []
    # Large regions first, since they stay visible below the small ones.
    for letter in letters:
        group = [pair for pair in pairs if pair.letter == letter]
        everywhere = np.concatenate([part for pair in group for part in (pair.cells, pair.images)])
        pale, dark = (blend_white(colour[letter], strength) for strength in (PALE, DARK))
        _paint(picture, amap, parts.counted, everywhere, spacing, pale)
        _paint(picture, amap, parts.counted, _representative_points(group, spacing), spacing, dark)
        label = f"{letter}, aliased with {len(group)} region{'s' if len(group) > 1 else ''}"
        handles.append(Patch(facecolor=blend_white(colour[letter], DARK), label=label))
    floor.paint(picture)
    floor.legend(handles + floor.part_patches(parts) + floor.outside_patches())
    for pair in reversed(pairs):
        first, other = pair.ends
        floor.axes.add_patch(
            FancyArrowPatch(
                first,
                other,
                arrowstyle="-",
                connectionstyle=f"arc3,rad={_choose_bend(pair, floor.bounds)}",
                color=colour[pair.letter],
                linewidth=2.2,
                shrinkA=9,
                shrinkB=9,
                path_effects=[withStroke(linewidth=4, foreground="white")],
                zorder=8,
            )
        )
        label_points(
            floor.axes, [(*first, pair.letter), (*other, pair.letter)], colour[pair.letter]
        )
    return floor.finish()


def _choose_bend(pair: AliasedPair, box: Bounds) -> float:
    """Choose how far a line bends sideways, as a share of its length, to stay in the picture.

    Args:
        pair: Its ends.
        box: xmin, ymin, xmax, ymax of the picture, metres.
    """
    ends = np.array(pair.ends)
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


def _representative_points(pairs: Sequence[AliasedPair], spacing: float) -> Floats:
    """Return the points of the first pair's region that represent it.

    Where a building is turned or moved onto itself, the region is all of it and so are its
    aliased poses: of these points, those nearer to the start than to any other end of the pairs.
    """
    first = pairs[0]
    ends = [first.ends[0], *(pair.ends[1] for pair in pairs)]
    images = np.concatenate([pair.images for pair in pairs])
    both = cKDTree(images).query(first.cells)[0] <= spacing
    is_nearest = cKDTree(ends).query(first.cells)[1] == 0
    return np.asarray(first.cells[~both | is_nearest])


def _paint(
    picture: Pixels,
    amap: AmbiguityMap,
    counted: Bools,
    points: Floats,
    spacing: float,
    colour: tuple[float, float, float],
) -> None:
    """Colour the counted cells around points of a lattice, which may be rotated."""
    rows, columns = np.nonzero(counted)
    near, _ = cKDTree(points).query(amap.centres(counted))
    # Half the diagonal of a lattice's cell, and a little for aliased poses that lie farther apart.
    is_near = near <= 0.75 * spacing
    picture[rows[is_near], columns[is_near]] = rgba_bytes(colour)
