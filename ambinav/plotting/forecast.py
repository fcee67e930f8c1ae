"""Picture of a forecast: where on a route robots get lost, and how the error grows."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ambinav.forecasting.forecast import Forecast
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.plotting.canvas import new_figure
from ambinav.plotting.floor import FloorFigure, label_points
from ambinav.plotting.legend_patches import zone_patches
from ambinav.plotting.maps import ZONES_OF_ALL, floor_title, paint_zones
from ambinav.plotting.routes import route_line
from ambinav.plotting.style import GOAL, START, route_style

_WIDTH: Final = 9.0
"""Inches of the picture."""
_CURVES: Final = 2.4
"""Inches of the height of the curves."""
_CAUSES: Final = 5
"""Number of stretches that are marked, the worst first."""


def plot_forecast(amap: AmbiguityMap, forecast: Forecast) -> Figure:
    """Draw a route on the zones, the stretches that lose robots, and the curves over its length."""
    figure = new_figure(_WIDTH, 8.0)
    above, below = figure.subplots(2, 1, height_ratios=(3.0, 1.2))
    floor = FloorFigure(amap, above, floor_title(amap, "Forecast", "mean", ZONES_OF_ALL))
    left, low, right, high = floor.bounds
    tall = _WIDTH * min((high - low) / (right - left), 1.0)
    figure.set_size_inches(_WIDTH, tall + _CURVES + 1.2)
    below.get_subplotspec().get_gridspec().set_height_ratios((tall, _CURVES))
    paint_zones(floor, "mean", amap.judged)
    line = route_line(route_style("ambiguity"), 3.0, forecast.poses)
    line.set_zorder(6)
    above.add_line(line)
    worst = forecast.causes[:_CAUSES]
    ends = [(*forecast.poses[end, :2].tolist(), name) for end, name in ((0, START), (-1, GOAL))]
    label_points(above, ends)
    label_points(
        above,
        [(cause.x, cause.y, str(k)) for k, cause in enumerate(worst, 1)],
        style.ZONE_COLOURS[3],
    )
    caption = [f"{START}: start", f"{GOAL}: goal"]
    caption += [
        f"{k}: {100.0 * cause.probability:.1f} % get lost, {cause.kind}"
        for k, cause in enumerate(worst, 1)
    ]
    floor.legend(
        zone_patches() + floor.part_patches(amap.judged) + floor.outside_patches(), caption
    )
    floor.finish()
    _curves(below, forecast)
    return figure


def _curves(axes: Axes, forecast: Forecast) -> None:
    """Draw the lost share and the expected error over the metres of the route."""
    lost, error = style.SILENT, style.ECHO
    axes.plot(forecast.distance, 100.0 * forecast.lost, color=lost, linewidth=2.2)
    axes.fill_between(forecast.distance, 100.0 * forecast.lost, color=lost, alpha=0.2, linewidth=0)
    axes.set_ylabel("robots lost (%)", color=lost)
    axes.set_xlabel("distance along the route (m)")
    axes.set_xlim(0.0, float(forecast.distance[-1]))
    axes.set_ylim(0.0, max(105.0 * float(forecast.lost[-1]), 1.0))
    other = axes.twinx()
    other.plot(forecast.distance, forecast.expected_error, color=error, linestyle="--")
    other.set_ylabel("error of the others (m)", color=error)
    other.set_ylim(0.0, 1.15 * float(np.max(forecast.expected_error)))
    axes.set_title(
        f"{forecast.localizer.title}: {100.0 * forecast.lost_probability:.1f} % get lost",
        loc="left",
        fontsize=10,
    )
