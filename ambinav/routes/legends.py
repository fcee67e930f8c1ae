"""Legends of pictures with routes: the colours of the floor, and below them the routes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.legend import Legend
from matplotlib.patches import Patch
from matplotlib.transforms import ScaledTranslation

from ambinav.maps import drawing
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.plot import view
from ambinav.routes.drawing import root_figure

FONT_SIZE: Final = 11
_DROP: Final = 34.0
"""Points from the floor's lower edge to the routes' legend: scale bar and colours lie between."""
_DROP_BESIDE: Final = 20.0
"""Points for each entry of the colours where the legends stand beside the floor."""
_COLUMNS: Final = 3


def colour_patch(colour: str, label: str) -> Patch:
    """Entry of a legend for a colour of the floor."""
    return Patch(facecolor=colour, edgecolor="#555555", linewidth=0.6, label=label)


def floor_legend(axes: Axes, amap: AmbiguityMap, patches: Sequence[Patch]) -> None:
    """Tell the colours: one row right of the scale bar, or a column beside a tall building."""
    if drawing.is_tall(view(amap)):
        legend = _legend(axes, patches, 0.0, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    else:
        legend = _legend(
            axes, patches, 0.0, loc="upper right", bbox_to_anchor=(1.0, -0.005), ncol=len(patches)
        )
    axes.add_artist(legend)


def lower_legend(axes: Axes, amap: AmbiguityMap, handles: Sequence[Artist], caption: str) -> None:
    """Tell the routes, below the colours.

    Args:
        axes: Of the picture; `floor_legend` comes first.
        amap: The map, whose shape decides where legends stand.
        handles: With labels.
        caption: One line above them.
    """
    if drawing.is_tall(view(amap)):
        place = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)}
        legend = _legend(axes, handles, 4 * _DROP_BESIDE + 20.0, **place)
    else:
        place = {"loc": "upper left", "bbox_to_anchor": (-0.005, -0.005)}
        columns = min(len(handles), _COLUMNS)
        legend = _legend(axes, handles, _DROP, ncol=columns, **place)
    legend.set_title(caption, prop={"size": FONT_SIZE})
    legend.set_alignment("left")
    axes.add_artist(legend)


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
