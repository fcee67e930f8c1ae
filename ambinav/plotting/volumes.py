"""Pictures of an ambiguity volume: a layer at each height, and a route in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ambinav.maps.ambiguity_volume import AmbiguityVolume
from ambinav.plotting import style
from ambinav.plotting.canvas import new_figure
from ambinav.plotting.scales import LayerScale, layer_scale
from ambinav.runtime.array_types import Floats
from ambinav.service.volume_service import VolumeService

_STEP = 0.02
"""Spacing of the points of a route that are drawn, metres."""


def plot_volume(
    volume: AmbiguityVolume, layer: str | None = None, points: Floats | None = None
) -> Figure:
    """Draw a layer at each height; with a route also its height over distance, and it in space.

    Args:
        volume: The volume.
        layer: Name of a layer; None: the volume's `cost_layer`.
        points: x, y, z of a route, shape (N, 3), metres. At each height its part that is nearest
            to that height is drawn, and the rest of it thinly.

    Raises:
        InputError: no such layer.
    """
    layer = volume.check_layer(volume.cost_layer if layer is None else layer)
    data = volume.dataset[layer]
    scale = layer_scale(layer, data, data.values.astype(np.float64))
    count, columns = len(volume.heights), min(len(volume.heights), 3)
    rows = -(-count // columns)
    x, y = (volume.dataset[name].values for name in "xy")
    aspect = float(np.ptp(y) + volume.spacing) / float(np.ptp(x) + volume.spacing)
    figure = new_figure(9.0, 9.0 / columns * aspect * rows + (3.2 if points is not None else 0.6))
    parts: Any = [figure]
    if points is not None:
        parts = figure.subfigures(2, 1, height_ratios=(9.0 / columns * aspect * rows, 3.0))
    axes = parts[0].subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    half = 0.5 * volume.spacing
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    fine = None if points is None else _sampled(points)
    for k, ax in enumerate(axes):
        if k >= count:
            ax.set_axis_off()
            continue
        image = ax.imshow(
            scale.values[k], origin="lower", extent=extent, cmap=scale.colours, norm=scale.norm
        )
        ax.set_facecolor(scale.unknown)
        ax.set_title(f"z = {volume.heights[k]:.2f} m", fontsize=9)
        ax.set_aspect("equal")
        ax.set(xlabel="x (m)", ylabel="y (m)")
        ax.label_outer()
        if fine is not None:
            near = np.abs(fine[:, 3] - volume.heights[k]) <= 0.5 * volume.step + 1e-9
            ax.plot(fine[:, 1], fine[:, 2], color=style.WALL, linewidth=0.5)
            ax.plot(np.where(near, fine[:, 1], np.nan), fine[:, 2], color=style.WALL, linewidth=2.2)
    bar = parts[0].colorbar(image, ax=axes.tolist(), shrink=0.8)
    bar.set_label(str(data.attrs.get("long_name", layer)), fontsize=8)
    if fine is None:
        return figure
    grid = parts[1].add_gridspec(1, 2, width_ratios=(1.5, 1.0))
    _draw_profile(parts[1].add_subplot(grid[0]), volume, layer, scale, fine)
    _draw_in_space(parts[1].add_subplot(grid[1], projection="3d"), volume, scale, fine)
    return figure


def _draw_profile(
    axes: Axes, volume: AmbiguityVolume, layer: str, scale: LayerScale, fine: Floats
) -> None:
    """Draw the height of a route over distance, coloured by the layer."""
    # Next to a wall, where the map has no value, that of the nearest free point.
    service = VolumeService(volume, layer, weight=1.0)
    value = np.array([service.near(*point) - 1.0 for point in fine[:-1, 1:].tolist()])
    pieces = list(np.stack([fine[:-1, [0, 3]], fine[1:, [0, 3]]], axis=1))
    line = LineCollection(pieces, cmap=scale.colours, norm=scale.norm, linewidths=3.0)
    line.set_array(layer_scale(layer, volume.dataset[layer], value).values)
    axes.add_collection(line)
    axes.set(
        xlim=(0.0, fine[-1, 0]), ylim=(volume.heights[0] - 0.1, volume.heights[-1] + 0.1),
        xlabel="distance (m)", ylabel="z (m)",
    )  # fmt: skip
    label = volume.dataset[layer].attrs.get("long_name", layer)
    axes.set_title(f"height along the route, coloured by {label}", fontsize=9)


def _draw_in_space(axes: Any, volume: AmbiguityVolume, scale: LayerScale, fine: Floats) -> None:
    """Draw a route in space, above the layer at the lowest height."""
    x, y = (volume.dataset[name].values for name in "xy")
    axes.contourf(
        *np.meshgrid(x, y), np.ma.masked_invalid(scale.values[0]), zdir="z",
        offset=volume.heights[0], cmap=scale.colours, norm=scale.norm, alpha=0.6,
    )  # fmt: skip
    axes.plot(*fine[:, 1:].T, color=style.WALL, linewidth=1.8)
    axes.set(zlim=volume.heights[[0, -1]])
    axes.set_xlabel("x (m)", labelpad=12.0)
    axes.set_ylabel("y (m)", labelpad=6.0)
    axes.set_box_aspect((np.ptp(x), np.ptp(y), max(3.0 * np.ptp(volume.heights), 1.0)))
    axes.tick_params(labelsize=6)
    for axis, ticks in ((axes.xaxis, 5), (axes.yaxis, 3), (axes.zaxis, 2)):
        axis.set_major_locator(MaxNLocator(ticks))


def _sampled(points: Floats) -> Floats:
    """Return distance, x, y, z of evenly spaced points along a route, shape (M, 4)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.append(0.0, np.cumsum(steps))
    at = np.linspace(0.0, along[-1], max(int(along[-1] / _STEP), 1) + 1)
    return np.column_stack([at, *(np.interp(at, along, points[:, k]) for k in range(3))])
