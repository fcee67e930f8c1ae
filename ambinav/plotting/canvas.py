"""Figures without global state: creation, fitting and saving."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final
from weakref import WeakSet

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text

from ambinav.runtime.files import replacing

DPI: Final = 160
MARGIN: Final = 0.08
"""Inches around a picture."""
_fitted: WeakSet[Figure] = WeakSet()
"""Figures that end where what they hold ends."""


def new_figure(width: float, height: float, *, laid_out: bool = True, **pads: float) -> Figure:
    """Create an empty figure; no global state is touched.

    Args:
        width: Inches.
        height: Inches.
        laid_out: Whether Matplotlib finds room for everything ("constrained" layout).
        pads: Padding of that layout.
    """
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    if laid_out:
        figure.set_layout_engine("constrained", **pads)
    FigureCanvasAgg(figure)
    return figure


def head(figure: Figure, title: str) -> None:
    """Write the title of a picture at its upper left."""
    figure.suptitle(title, x=0.01, ha="left", fontsize=13)


def foot(
    figure: Figure, handles: Sequence[Artist], columns: int | None = None, font: float = 10
) -> None:
    """Draw a legend below a picture, in one row if no number of columns is given."""
    figure.legend(
        handles=handles, loc="outside lower left", frameon=False, fontsize=font,
        ncol=columns or len(handles),
    )  # fmt: skip


def chart(axes: Axes) -> None:
    """Give axes a pale grid behind what is drawn, and no frame above and on the right."""
    axes.grid(color="#DDDDDD", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def root_figure(axes: Axes) -> Figure:
    """Return the figure of some axes, also if they are in a subfigure."""
    figure = axes.get_figure(root=True)
    if figure is None:
        raise ValueError("these axes were removed from their figure")
    return figure


def fit(axes: Axes) -> None:
    """Fit the figure around its only axes, which keep their size, and their surroundings."""
    figure = root_figure(axes)
    _take_literally(figure)
    _fitted.add(figure)
    size = figure.get_size_inches()
    inner = axes.get_position()
    box = figure.get_tightbbox()
    width, height = box.width + 2.0 * MARGIN, box.height + 2.0 * MARGIN
    figure.set_size_inches(width, height)
    axes.set_position(
        (
            (inner.x0 * size[0] - box.x0 + MARGIN) / width,
            (inner.y0 * size[1] - box.y0 + MARGIN) / height,
            inner.width * size[0] / width,
            inner.height * size[1] / height,
        )
    )


def save_figure(picture: Axes | Figure, path: Path) -> None:
    """Write a figure, or the figure of some axes, completely or not at all.

    Args:
        picture: The figure, or some axes of it.
        path: File to write; its suffix sets the format.

    Raises:
        InputError: see `ambinav.runtime.files.replacing`.
    """
    figure = picture if isinstance(picture, Figure) else root_figure(picture)
    _take_literally(figure)
    suffix = path.suffix.lower()
    options: dict[str, Any] = {}
    if suffix == ".png":
        # Twice as fast to pack as the default, and hardly larger.
        options["pil_kwargs"] = {"compress_level": 3}
    elif suffix == ".svg":
        options["metadata"] = {"Date": None}
    if figure not in _fitted:
        # This layout draws the whole figure twice.
        options |= {"bbox_inches": "tight", "pad_inches": MARGIN}
    # Else the ids in an SVG file are drawn at random.
    with rc_context({"svg.hashsalt": "ambinav"}), replacing(path) as fresh:
        figure.savefig(fresh, dpi=DPI, **options)


def _take_literally(figure: Figure) -> None:
    """Show dollar signs in names as they are; only tick labels are formulas."""
    texts: list[Artist] = [
        label for axes in figure.axes for label in (axes.xaxis.label, axes.yaxis.label)
    ]
    for part in (figure, *figure.subfigs, *figure.axes):
        for child in part.get_children():
            texts += child.get_texts() if isinstance(child, Legend) else [child]
    for text in texts:
        # What is escaped already reads well.
        if isinstance(text, Text) and r"\$" not in text.get_text():
            text.set_parse_math(False)
