"""Parts of a floor map picture: canvas, walls, strokes along the weak direction, scale bar."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from ambinav.geometry.segments import Segments
from ambinav.maps.zones import UNKNOWN_COLOUR

Floats = NDArray[np.float64]

DPI = 160
WALL_COLOUR = "#1A1A1A"
FRONTIER_COLOUR = "#7A7A7A"
LONGEST = 12.0  # inches


def new_axes(bounds: tuple[float, float, float, float], *, longest: float = LONGEST) -> Axes:
    """Axes on a figure of their own, shaped like the building; no global state is touched.

    Args:
        bounds: (xmin, ymin, xmax, ymax) to be shown, metres.
        longest: Inches of the longer side, about.
    """
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    inches = longest / max(width, 1.2 * height)
    beside, below = (2.0, 0.8) if is_tall(bounds) else (0.0, 1.1)
    size = (max(width * inches, 2.0) + beside, max(height * inches, 2.0) + below)
    figure = Figure(figsize=size, dpi=DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure.add_subplot()


def is_tall(bounds: tuple[float, float, float, float]) -> bool:
    """Whether the building is higher than wide, so that a legend belongs beside the picture."""
    return bounds[3] - bounds[1] > 1.1 * (bounds[2] - bounds[0])


def save_figure(picture: Axes | Figure, path: Path) -> None:
    """Write a figure, or the one that holds some axes; the ending of `path` says the format."""
    figure = picture.get_figure(root=True)
    if figure is None:
        raise ValueError("these axes were removed from their figure")
    # Twice as fast to pack as the default, and hardly larger; only pictures of dots are packed.
    packing: dict[str, Any] = {}
    if path.suffix.lower() == ".png":
        packing["pil_kwargs"] = {"compress_level": 3}
    figure.savefig(path, dpi=DPI, bbox_inches="tight", pad_inches=0.08, **packing)


def frame(
    axes: Axes, bounds: tuple[float, float, float, float], outside: str = UNKNOWN_COLOUR
) -> None:
    """Equal scales, no ticks, one colour wherever nothing is drawn."""
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(bounds[0], bounds[2])
    axes.set_ylim(bounds[1], bounds[3])
    axes.set_facecolor(outside)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def draw_walls(axes: Axes, segments: Segments, width: float = 0.9) -> None:
    """Walls as dark lines, frontiers to unknown space thin, grey and dashed.

    Only what reaches into the limits of `axes` is drawn; set them first.
    """
    (left, right), (low, high) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    x, y = segments.xy[:, 0::2], segments.xy[:, 1::2]
    shown = (x.max(1) >= left) & (x.min(1) <= right) & (y.max(1) >= low) & (y.min(1) <= high)
    lines = segments.xy.reshape(-1, 2, 2)
    walls, frontiers = lines[shown & segments.walls], lines[shown & ~segments.walls]
    axes.add_collection(
        LineCollection(
            list(frontiers),
            colors=FRONTIER_COLOUR,
            linewidths=0.6 * width,
            linestyles=(0, (4, 3)),
            zorder=3,
        ),
        autolim=False,
    )
    axes.add_collection(
        LineCollection(
            list(walls), colors=WALL_COLOUR, linewidths=width, capstyle="round", zorder=4
        ),
        autolim=False,
    )


def draw_weak_direction(
    axes: Axes,
    x: Floats,
    y: Floats,
    direction: Floats,
    strength: Floats,
    depth: Floats,
    *,
    threshold: float = 0.3,
) -> None:
    """Short strokes along the direction in which the robot can slide unseen.

    One stroke for each patch of floor about 1/45 of the picture wide, where the direction is
    pronounced in most of the cells around; of the patch's cells the deepest, so that strokes run
    along a corridor's middle.

    Args:
        axes: Where to draw.
        x: (nx,) cell centres, metres.
        y: (ny,) cell centres, metres.
        direction: (ny, nx) radians.
        strength: (ny, nx) how pronounced the direction is, in [0, 1]; NaN where not free.
        depth: (ny, nx) metres to the nearest wall.
        threshold: Least strength that gets a stroke.
    """
    pronounced = np.nan_to_num(strength) >= threshold
    around, free = (
        uniform_filter(mask.astype(np.float32), 5, mode="constant")
        for mask in (pronounced, np.isfinite(strength))
    )
    rows, columns = np.nonzero(pronounced & (around >= 0.5 * free))
    if rows.size == 0:
        return
    patch = float(max(np.ptp(x), np.ptp(y), 1.0)) / 45.0
    # Strongest claim first: deep in the free space, then pronounced.
    claim = np.nan_to_num(depth[rows, columns]) + 0.1 * patch * strength[rows, columns]
    order = np.argsort(-claim, kind="stable")
    rows, columns = rows[order], columns[order]
    first = _first_of_block(x[columns], y[rows], patch / 4.0)
    rows, columns = rows[first], columns[first]
    px, py = x[columns], y[rows]
    chosen = _apart(px, py, patch)
    angle = direction[rows[chosen], columns[chosen]]
    half = 0.4 * patch * strength[rows[chosen], columns[chosen]]
    step = np.stack([half * np.cos(angle), half * np.sin(angle)], axis=-1)
    centre = np.stack([px[chosen], py[chosen]], axis=-1)
    strokes = np.stack([centre - step, centre + step], axis=1)
    axes.add_collection(
        LineCollection(list(strokes), colors=WALL_COLOUR, linewidths=1.7, zorder=5),
        autolim=False,
    )


def _first_of_block(x: Floats, y: Floats, side: float) -> NDArray[np.intp]:
    """Indices of the first point in each square block, in rising order: far fewer points."""
    column = np.floor((x - x.min()) / side).astype(np.int64)
    row = np.floor((y - y.min()) / side).astype(np.int64)
    _, first = np.unique(row * (column.max() + 1) + column, return_index=True)
    return np.sort(first)


def _apart(x: Floats, y: Floats, distance: float) -> NDArray[np.intp]:
    """Indices of points at least `distance` apart, taken greedily in the order given."""
    taken: dict[tuple[int, int], list[int]] = {}
    chosen: list[int] = []
    cells = np.stack([np.floor(x / distance), np.floor(y / distance)], axis=-1).astype(np.int64)
    for i, (a, b) in enumerate(cells.tolist()):
        near = (
            j for da in (-1, 0, 1) for db in (-1, 0, 1) for j in taken.get((a + da, b + db), ())
        )
        if all(math.hypot(x[i] - x[j], y[i] - y[j]) >= distance for j in near):
            taken.setdefault((a, b), []).append(i)
            chosen.append(i)
    return np.array(chosen, dtype=np.intp)


def round_length(width: float) -> float:
    """A length of 1, 2 or 5 times a power of ten, at most a quarter of `width` (both metres)."""
    target = width / 4.0
    power = 10.0 ** math.floor(math.log10(target))
    return max(m for m in (1.0, 2.0, 5.0) if m * power <= target * (1 + 1e-9)) * power


def draw_scale_bar(axes: Axes) -> None:
    """A bar of a round length below the lower left corner of the picture."""
    left, right = axes.get_xlim()
    length = round_length(right - left)
    below = axes.get_xaxis_transform()
    text = f"{length:g} m" if length >= 1 else f"{length * 100:g} cm"
    axes.plot(
        [left, left + length],
        [-0.025, -0.025],
        transform=below,
        color="black",
        linewidth=3,
        solid_capstyle="butt",
        clip_on=False,
    )
    axes.annotate(
        text,
        (left + length / 2, -0.025),
        xycoords=below,
        xytext=(0, -4),
        textcoords="offset points",
        ha="center",
        va="top",
        fontsize=11,
        annotation_clip=False,
    )
