"""Expected position error at a point, over all headings together, as a cost in [0, 1].

Source: our own; docs/truth.md has how it fares against measured errors. The layer `level` is the
share of its neighbourhood that a robot can slide in unseen, at one heading. This one counts metres,
and what the headings tell adds up: for scanners that do not look all around it tells bad places
from good ones better.

The tensor of a pose is the covariance of the positions that its scan could be of, within the
neighbourhood that it is compared with (docs/model.md). What the scan itself tells is the tensor's
inverse less that of the neighbourhood; a robot that turns and passes with several headings
gathers the mean of what they tell, as often as it scans. `position_radius` is the root of the
trace of what is then left: a root mean square distance.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.config import as_positive
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.errors import InputError

VIEWS = 2.0
"""Number of independent scans in all views of a scanner that does not look all around."""


def position_radius(amap: AmbiguityMap, views: float = VIEWS) -> Floats:
    """Compute the RMS distance to positions aliased with a pose's, over all headings.

    Args:
        amap: The map.
        views: How many scans the headings of the map are worth together, above 0; a scanner that
            looks all around sees the same again and again, and has one.

    Returns:
        Shape (ny, nx), metres, at most the radius of the neighbourhood; nan where it is not free.

    Raises:
        InputError: `views` is not above 0.
    """
    views = as_positive(views, "views", "a number of scans")
    major, minor, major_radius, minor_radius, direction = (
        np.asarray(amap.dataset[name].values, dtype=np.float64)
        for name in ("major", "minor", "major_radius", "minor_radius", "direction")
    )
    if not amap.has_theta:
        return np.hypot(major_radius, minor_radius)
    # Of the inverse tensor, share^2 is the neighbourhood's and the rest is what a scan tells.
    along = (views * (1.0 - major**2) + major**2) / major_radius**2
    across = (views * (1.0 - minor**2) + minor**2) / minor_radius**2
    c, s = np.cos(direction), np.sin(direction)
    parts = (along * c**2 + across * s**2, along * s**2 + across * c**2, (along - across) * c * s)
    # Of the headings that are possible.
    is_finite = np.isfinite(parts[0])
    count = np.where(is_finite.any(axis=-1), is_finite.sum(axis=-1), np.nan)
    xx, yy, xy = (np.where(is_finite, part, 0.0).sum(axis=-1) / count for part in parts)
    # The trace of the inverse of [[xx, xy], [xy, yy]].
    return np.asarray(np.sqrt((xx + yy) / (xx * yy - xy**2)))


def position(context: LayerContext, views: float = VIEWS) -> dict[str, Floats32]:
    """Compute each free cell's position radius, and its share of a featureless disc's.

    Args:
        context: The poses, with the map that they are of.
        views: How many scans the headings are worth together, above 0.

    Raises:
        InputError: there is no map, or `views` is not above 0.
    """
    if context.amap is None:
        raise InputError("the layer position is made of a map's ambiguity; build the map first.")
    metres = position_radius(context.amap, views)
    # The second moments of a disc of radius R are R^2 / 4 along either axis.
    share = np.minimum(metres / (context.radius / math.sqrt(2.0)), 1.0)
    return {"position": share.astype(np.float32), "position_radius": metres.astype(np.float32)}


def _reach(context: LayerContext, **_: object) -> float:
    """Return the distance at which a change affects the layer: that of the tensor."""
    return context.sight + context.radius


LAYER = Layer(
    name="position",
    title="position radius, as a share of the neighbourhood's",
    unit="1",
    source="own, from the ambiguity tensors of all headings: docs/truth.md",
    worse="high",
    compute=position,
    in_space=True,
    reach=_reach,
    companions={"position_radius": ("position radius, all headings together", "m")},
)
