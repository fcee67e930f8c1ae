"""The floor figure: a floor to scale, on which every picture of a floor is drawn.

It has what they all share: coordinates on the axes in metres, walls, what is solid, unknown,
unexplored or not reached, a scale bar, strokes of the weak direction, round labels, legends.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.font_manager import FontProperties
from matplotlib.image import AxesImage
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import MultipleLocator
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.plotting import style
from ambinav.plotting.canvas import fit, new_figure, root_figure
from ambinav.plotting.legend_patches import colour_patch, unexplored_patch
from ambinav.plotting.solid_cells import padded_solid
from ambinav.plotting.strokes import weak_strokes
from ambinav.plotting.style import round_length
from ambinav.reports.number_text import metres2
from ambinav.runtime.array_types import Bools, Bounds, Floats

Pixels = NDArray[np.uint8]
Heading = str | float

LONGEST: Final = 12.0
"""Inches of the longer side of a floor, about."""
SMALL: Final = 8.0
"""Up to this size of a floor, inches, letters are small."""
_BAR: Final = 26.0
_BELOW: Final = 36.0
_BESIDE: Final = 8.0
_BETWEEN: Final = 4.0
"""Points from a floor to its scale bar, to a legend below it and beside it, and between legends."""
_NARROW: Final = 160.0
_LINE: Final = 13.0
"""Below a floor of less width, the bar stands so much lower, below the name of the x axis."""
_BACKDROP, _CELLS, _FRONTIERS, _WALLS, _STROKES, _LABELS = 0.5, 1.0, 3.0, 4.0, 5.0, 10.0
"""Drawing order; routes are drawn from 6 to 9."""
_STRIPES: Final = 90
"""Stripes of unexplored floor across the longer side of a picture."""
_HALF_CELLS: Final = 2
"""Cells across a stripe, at least."""


class FloorFigure:
    """A floor to scale, with walls, coordinates, scale bar and title.

    Args:
        amap: The map.
        ax: Axes to draw on; None makes a figure of its own, which `finish` fits around the floor.
        title: Above the floor.
        bounds: (xmin, ymin, xmax, ymax) to be shown, metres; None: all free floor and a margin.
        longest: Inches of the longer side in a figure of its own.
        unknown: Colour of what is not known.
        walls: Width of walls, points.
        scale_bar: Whether to draw one.
    """

    def __init__(
        self,
        amap: AmbiguityMap,
        ax: Axes | None,
        title: str,
        *,
        bounds: Bounds | None = None,
        longest: float = LONGEST,
        unknown: str = style.UNKNOWN,
        walls: float = 0.9,
        scale_bar: bool = True,
    ) -> None:
        self.amap, self.bounds, self._unknown = amap, bounds or view(amap), unknown
        width, height = self.bounds[2] - self.bounds[0], self.bounds[3] - self.bounds[1]
        self._tall = height > 1.1 * width
        self._owns_figure = ax is None
        if ax is None:
            inches = longest / max(width, 1.2 * height)
            ax = new_figure(width * inches, height * inches, laid_out=False).add_axes(
                (0.0, 0.0, 1.0, 1.0)
            )
        self.axes = ax
        self._font = 11 if longest > SMALL else 9
        self._coordinates(width, height)
        size = ax.get_window_extent().width * 72.0 / root_figure(ax).dpi
        self._lower = _LINE if size < _NARROW else 0.0
        self._drops = {True: 0.0, False: _BELOW + self._lower if scale_bar else _BAR}
        self._backdrop()
        self._draw_walls(walls)
        if scale_bar:
            self._scale_bar(max(width, height / 4.0))
        ax.set_title(title, fontsize=self._font + 2, loc="left")

    def paint(self, values: NDArray[Any], bounds: Bounds | None = None, **scale: Any) -> AxesImage:
        """Draw values (ny, nx), or colours in bytes (ny, nx, 4), over the map's cells, or bounds.

        Colours as floats would take eight times the memory, and longer.
        """
        xmin, ymin, xmax, ymax = bounds or self.amap.bounds
        return self._image(values, (xmin, xmax, ymin, ymax), _CELLS, **scale)

    def paint_parts(self, picture: Pixels, parts: JudgedFloor) -> None:
        """Draw stripes over unexplored floor and greys over unreached or outside floor.

        Args:
            picture: Colours of the cells, shape (ny, nx, 4), changed in place.
            parts: Masks of the parts of the floor.
        """
        picture[parts.unreachable] = rgba_bytes(style.UNREACHABLE)
        picture[parts.outside] = rgba_bytes(style.UNKNOWN)
        xmin, ymin, xmax, ymax = self.bounds
        size = max(xmax - xmin, ymax - ymin)
        half = max(round(0.5 * size / _STRIPES / self.amap.spacing), _HALF_CELLS)
        row, column = np.nonzero(parts.unexplored)
        # At an angle of 45 degrees, as the hatching of the legend.
        dark = (column - row) % (2 * half) < half
        stripes = np.array([rgba_bytes(style.UNKNOWN), rgba_bytes(style.UNEXPLORED)])
        picture[row, column] = stripes[dark.astype(np.int64)]

    def strokes(self, heading: Heading, parts: JudgedFloor) -> None:
        """Draw the weak direction, where the floor counts."""
        major, minor, direction, depth = (
            self.amap.floor(name, heading).values.astype(np.float64)
            for name in ("major", "minor", "direction", "clearance")
        )
        x, y = self.amap.dataset["x"].values, self.amap.dataset["y"].values
        strength = np.where(parts.counted, major - minor, np.nan)
        lines = weak_strokes(x, y, direction, strength, depth)
        self._lines(lines, zorder=_STROKES, colors=style.WALL, linewidths=1.7)

    def part_patches(self, parts: JudgedFloor) -> list[Artist]:
        """Return legend entries for the floor that does not count, if there is any."""
        patches: list[Artist] = []
        if parts.unexplored.any():
            area = metres2(parts.area(parts.unexplored))
            patches.append(unexplored_patch(f"unexplored\n{area}"))
        if parts.unreachable.any():
            label = f"not reachable by a\nrobot of {parts.radius:.2f} m, "
            label += metres2(parts.area(parts.unreachable))
            patches.append(colour_patch(style.UNREACHABLE, label))
        if parts.outside.any():
            label = f"outside of the\nbuilding, {metres2(parts.area(parts.outside))}"
            patches.append(colour_patch(style.UNKNOWN, label))
        return patches

    def outside_patches(self) -> list[Artist]:
        """Return legend entries for the shown parts that are not free."""
        x, y = self.amap.dataset["x"].values, self.amap.dataset["y"].values
        shown = np.ix_(
            (y > self.bounds[1]) & (y < self.bounds[3]), (x > self.bounds[0]) & (x < self.bounds[2])
        )
        solid, free = self.amap.solid[shown], np.asarray(self.amap.dataset["free"].values)[shown]
        patches: list[Artist] = []
        if (~free & solid).any():
            patches.append(colour_patch(style.SOLID, "solid"))
        if (~free & ~solid).any():
            patches.append(colour_patch(self._unknown, "unknown"))
        return patches + self.reflector_lines()

    def reflector_lines(self) -> list[Artist]:
        """Return legend entries for glass and reflectors, if some are shown."""
        shown, segments = self._shown_segments(), self.amap.segments
        entries: list[Artist] = []
        if shown[segments.glass].any():
            entries.append(Line2D([], [], color=style.GLASS, linewidth=1.5, label="glass"))
        if not shown[segments.reflectors].any():
            return entries
        rim = [Stroke(linewidth=4.0, foreground=style.WALL), Normal()]
        look: dict[str, Any] = {"linewidth": 2.2, "path_effects": rim}
        return [*entries, Line2D([], [], color=style.REFLECTOR, label="reflector", **look)]

    def _shown_segments(self) -> Bools:
        """Return a mask, shape (N,), of the segments visible within the bounds."""
        left, low, right, high = self.bounds
        x, y = np.split(self.amap.segments.xy.reshape(-1, 2, 2), 2, axis=-1)
        seen = (x.max(1) >= left) & (x.min(1) <= right) & (y.max(1) >= low) & (y.min(1) <= high)
        return np.asarray(seen[:, 0])

    def legend(
        self, handles: Sequence[Artist], caption: Sequence[str] = (), *, below: bool = False
    ) -> None:
        """Add a legend beside a tall floor, otherwise below it and below earlier legends.

        Args:
            handles: Handles with labels, in reading order row by row.
            caption: Remarks above them, in one line, or beside a tall floor one below the other.
            below: Not beside, even if the floor is tall.
        """
        if not handles:
            return
        beside = self._tall and not below
        corner, right = ((1.0, 1.0), _BESIDE) if beside else ((0.0, 0.0), 0.0)
        shift = ScaledTranslation(
            right / 72.0, -self._drops[beside] / 72.0, root_figure(self.axes).dpi_scale_trans
        )
        look: dict[str, Any] = {
            "loc": "upper left",
            "bbox_to_anchor": corner,
            "bbox_transform": self.axes.transAxes + shift,
            "frameon": False,
            "fontsize": self._font,
            "title": ("\n" if beside else "   ").join(caption) or None,
            "title_fontproperties": FontProperties(size=self._font),
            "alignment": "left",
            "handlelength": 2.0,
            "columnspacing": 1.6,
            "borderaxespad": 0.0,
            "borderpad": 0.2,
        }
        self.axes.apply_aspect()
        room = self.axes.get_window_extent().width
        for rows in range(len(handles) if beside else 1, len(handles) + 1):
            columns = -(-len(handles) // rows)
            # Matplotlib fills columns first, but readers read rows.
            ordered = [handle for first in range(columns) for handle in handles[first::columns]]
            # A dollar sign is no formula.
            labels = [str(handle.get_label()).replace("$", r"\$") for handle in ordered]
            legend = Legend(self.axes, ordered, labels, ncols=columns, **look)
            box = legend.get_window_extent()
            if box.width <= room:
                break
        if self.axes.get_legend() is None:
            legend = self.axes.legend(ordered, labels, ncols=columns, **look)
        else:
            self.axes.add_artist(legend)
            # A clipped artist would not count for the size of the picture.
            legend.set_clip_on(False)
        self._drops[beside] += box.height * 72.0 / root_figure(self.axes).dpi + _BETWEEN

    def colour_bar(self, image: AxesImage, label: str) -> None:
        """Add a colour bar to the right of the floor."""
        self.axes.apply_aspect()
        inch = root_figure(self.axes).dpi / self.axes.get_window_extent().width
        place = self.axes.inset_axes((1.0 + 0.12 * inch, 0.1, 0.18 * inch, 0.8))
        bar = root_figure(self.axes).colorbar(image, cax=place)
        bar.set_label(label, fontsize=self._font)
        bar.outline.set_linewidth(0.5)

    def stretches(self, ends: Floats, **look: Any) -> None:
        """Draw straight lines over the walls, given by their end points, shape (N, 4)."""
        self._lines(ends.reshape(-1, 2, 2), zorder=_STROKES, **look)

    def finish(self) -> Axes:
        """Fit an own figure around the floor and its legends; return the axes."""
        if self._owns_figure:
            fit(self.axes)
        return self.axes

    def _coordinates(self, width: float, height: float) -> None:
        axes = self.axes
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlim(self.bounds[0], self.bounds[2])
        axes.set_ylim(self.bounds[1], self.bounds[3])
        axes.set_autoscale_on(False)
        axes.set_facecolor(self._unknown)
        axes.apply_aspect()
        # Metres that a number of the ticks takes up, a letter high.
        letter = self._font * root_figure(axes).dpi / 72.0 * width / axes.get_window_extent().width
        step = round_length(0.5 * max(width, height))
        for axis, name, size, letters in (
            (axes.xaxis, "x", width, 3.0), (axes.yaxis, "y", height, 1.5)
        ):  # fmt: skip
            apart = min(step, round_length(2.0 * size))
            if apart < letters * letter:
                # The next round length, at most 2.5 times as long.
                apart = round_length(10.0 * letters * letter)
            axis.set_major_locator(MultipleLocator(apart))
            axis.set_label_text(f"{name} (m)", fontsize=self._font - 1)
        axes.tick_params(labelsize=self._font - 2, color="#888888", width=0.6)
        axes.spines[:].set(color="#888888", linewidth=0.6)

    def _backdrop(self) -> None:
        """Fill cells that are not free, below everything else: solid and unknown ones."""
        padding = 3 + max(self.amap.solid.shape) // 50
        step, (left, low, *_) = self.amap.spacing, self.amap.bounds
        left, low = left - padding * step, low - padding * step
        # Only the shown part: pictures of places show little of a large building.
        spans = []
        for begin, end, size, origin in (
            (self.bounds[1], self.bounds[3], self.amap.solid.shape[0] + 2 * padding, low),
            (self.bounds[0], self.bounds[2], self.amap.solid.shape[1] + 2 * padding, left),
        ):
            first = min(max(math.floor((begin - origin) / step) - 1, 0), size - 1)
            last = max(min(math.ceil((end - origin) / step) + 1, size), first + 1)
            spans.append((first, last))
        (bottom, top), (west, east) = spans
        solid = padded_solid(self.amap, padding, spans[0], spans[1])
        if not solid.any():
            return
        colours = np.array([rgba_bytes(self._unknown), rgba_bytes(style.SOLID)])
        picture = colours[solid.astype(np.uint8)]
        extent = (
            left + west * step, left + east * step, low + bottom * step, low + top * step
        )  # fmt: skip
        self._image(picture, extent, _BACKDROP)

    def _image(
        self, values: NDArray[Any], extent: Bounds, zorder: float, **scale: Any
    ) -> AxesImage:
        return self.axes.imshow(
            values, extent=extent, origin="lower", interpolation="nearest", zorder=zorder, **scale
        )

    def _draw_walls(self, width: float) -> None:
        """Draw walls dark, glass blue, reflectors bright, frontiers thin and dashed."""
        segments = self.amap.segments
        shown = self._shown_segments()
        lines = segments.xy.reshape(-1, 2, 2)
        self._lines(
            lines[shown & ~segments.walls],
            zorder=_FRONTIERS,
            colors=style.FRONTIER,
            linewidths=0.6 * width,
            linestyles=(0, (4, 3)),
        )
        for which, colour in ((segments.walls, style.WALL), (segments.glass, style.GLASS)):
            self._lines(
                lines[shown & which],
                zorder=_WALLS,
                colors=colour,
                linewidths=width,
                capstyle="round",
            )
        bright = lines[shown & segments.reflectors]
        for colour, times in ((style.WALL, 4.5), (style.REFLECTOR, 2.5)):
            self._lines(bright, zorder=_WALLS, colors=colour, linewidths=times * width)

    def _lines(self, lines: Floats, **look: Any) -> None:
        self.axes.add_collection(LineCollection(list(lines), **look), autolim=False)

    def _scale_bar(self, width: float) -> None:
        """Draw a bar of a round length below the lower left corner, with its length."""
        length, left = round_length(width), self.bounds[0]
        drop = -(_BAR + self._lower) / 72.0
        down = ScaledTranslation(0.0, drop, root_figure(self.axes).dpi_scale_trans)
        below = self.axes.get_xaxis_transform() + down
        bar = Line2D(
            [left, left + length],
            [0.0, 0.0],
            transform=below,
            color="black",
            linewidth=3,
            solid_capstyle="butt",
            clip_on=False,
        )
        self.axes.add_artist(bar)
        self.axes.annotate(
            f"{length:g} m" if length >= 1 else f"{length * 100:g} cm",
            (left + length, 0.0),
            xycoords=below,
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=self._font - 1,
            annotation_clip=False,
        )


def rgba_bytes(colour: str | tuple[float, float, float]) -> Pixels:
    """Return a colour as red, green, blue and opacity, a byte each."""
    return np.rint(255.0 * np.array(to_rgba(colour))).astype(np.uint8)


def blend_white(colour: str, strength: float) -> tuple[float, float, float]:
    """Blend a colour with white; its own share is `strength`."""
    red, green, blue = (1.0 - strength * (1.0 - part) for part in to_rgb(colour))
    return red, green, blue


def view(amap: AmbiguityMap) -> Bounds:
    """Return the bounds of the free cells with a small margin; unknown cells may surround them."""
    free = amap.dataset["free"].values
    x, y = amap.dataset["x"].values, amap.dataset["y"].values
    columns, rows = np.nonzero(free.any(axis=0))[0], np.nonzero(free.any(axis=1))[0]
    if columns.size == 0:
        return amap.bounds
    left, right, low, high = x[columns[0]], x[columns[-1]], y[rows[0]], y[rows[-1]]
    margin = amap.spacing + 0.01 * max(right - left, high - low)
    return (
        float(left - margin), float(low - margin), float(right + margin), float(high + margin)
    )  # fmt: skip


def label_points(
    axes: Axes, points: Iterable[tuple[float, float, str]], edge: str = "black"
) -> None:
    """Draw round labels at points (x, y, text), one per position; later ones are on top."""
    for x, y, text in dict.fromkeys((round(x, 3), round(y, 3), text) for x, y, text in points):
        axes.annotate(
            text,
            (x, y),
            ha="center",
            va="center_baseline",
            fontsize=10.5,
            fontweight="bold",
            color="black",
            bbox={
                "boxstyle": "circle,pad=0.22",
                "facecolor": "white",
                "edgecolor": edge,
                "linewidth": 1.8,
            },
            zorder=_LABELS,
        )
