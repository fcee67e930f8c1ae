"""Legends of pictures with routes: the colours of the floor, and below them the routes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.legend import Legend
from matplotlib.patches import Patch
from matplotlib.transforms import ScaledTranslation

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import floor as drawing
from ambinav.plotting.maps import view
from ambinav.plotting.route_lines import root_figure

FONT_SIZE: Final = 11
_DROP: Final = 34.0
"""Points from the floor's lower edge to the routes' legend: scale bar and colours lie between."""
_DROP_BESIDE: Final = 150.0
"""Points from the floor's upper edge to the routes' legend, where they stand beside the floor."""
_SHORT: Final = 1.36
"""Inches that a column of colours takes below a wide floor."""
_WIDE: Final = 3.4
_BESIDE: Final = 1.6
_CAPTION: Final = 0.5
_ROW: Final = 0.62
"""Inches: of a column of routes; what routes need beside a tall building more than colours; what
their caption and each row of them need below a wide one."""


def make_room(axes: Axes, amap: AmbiguityMap, entries: int) -> None:
    """Enlarge a figure of `floor_axes`, so that the legend of routes does not shrink the floor.

    Args:
        axes: The only ones of their figure.
        amap: The map, whose shape decides where legends stand.
        entries: Routes in the legend.
    """
    figure = root_figure(axes)
    width, height = figure.get_size_inches().tolist()
    if drawing.is_tall(view(amap)):
        figure.set_size_inches(width + _BESIDE, height)
    else:
        rows = -(-entries // _columns(axes, entries))
        figure.set_size_inches(width, height + _CAPTION + _ROW * rows)


def floor_legend(axes: Axes, amap: AmbiguityMap, patches: Sequence[Patch]) -> None:
    """Tell the colours: right of the scale bar, or in a column beside a tall building."""
    if drawing.is_tall(view(amap)):
        legend = _legend(axes, patches, 0.0, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    else:
        # Entries of two lines are long ones: two columns leave room for the scale bar, whose the
        # left quarter is.
        most = int(0.75 * root_figure(axes).get_figwidth() / _SHORT)
        if any("\n" in str(patch.get_label()) for patch in patches):
            most = 2
        rows = -(-len(patches) // max(most, 2))
        columns = -(-len(patches) // rows)
        place = {"loc": "upper right", "bbox_to_anchor": (1.0, -0.005), "ncol": columns}
        legend = _legend(axes, patches, 0.0, **place)
    _add(axes, legend)


def lower_legend(
    axes: Axes, amap: AmbiguityMap, handles: Sequence[Artist], caption: Sequence[str]
) -> None:
    """Tell the routes, below the colours.

    Args:
        axes: Of the picture; `floor_legend` comes first.
        amap: The map, whose shape decides where legends stand.
        handles: With labels.
        caption: Remarks above them, in one line, or beside a tall building one below the other.
    """
    tall = drawing.is_tall(view(amap))
    if tall:
        place = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)}
        legend = _legend(axes, handles, _DROP_BESIDE, **place)
    else:
        place = {"loc": "upper left", "bbox_to_anchor": (-0.005, -0.005)}
        columns = _columns(axes, len(handles))
        # Matplotlib goes down a column first; who reads goes along a row.
        handles = [handle for first in range(columns) for handle in handles[first::columns]]
        legend = _legend(axes, handles, _DROP, ncol=columns, **place)
    legend.set_title(("\n" if tall else "   ").join(caption), prop=FontProperties(size=FONT_SIZE))
    legend.set_alignment("left")
    _add(axes, legend)


def _columns(axes: Axes, entries: int) -> int:
    """Columns of routes that fit below a floor."""
    return max(1, min(entries, int(root_figure(axes).get_figwidth() / _WIDE)))


def _legend(axes: Axes, handles: Sequence[Artist], drop: float, **place: Any) -> Legend:
    """A legend without a frame, `drop` points below where `place` says."""
    down = ScaledTranslation(0.0, -drop / 72.0, root_figure(axes).dpi_scale_trans)
    return Legend(
        axes,
        list(handles),
        [str(handle.get_label()) for handle in handles],
        frameon=False,
        fontsize=FONT_SIZE,
        handlelength=2.4,
        columnspacing=1.8,
        labelspacing=0.7,
        borderaxespad=0.2,
        bbox_transform=axes.transAxes + down,
        **place,
    )


def _add(axes: Axes, legend: Legend) -> None:
    axes.add_artist(legend)
    # Clipped to the floor it would not count for the size of the saved picture.
    legend.set_clip_on(False)
