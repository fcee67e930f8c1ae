"""How far a robot is off, in metres, from a map's ambiguity tensors.

The tensor of a pose is the covariance of the positions that its scan could be of, within the
neighbourhood that it is compared with (docs/model.md). What the scan itself tells is the tensor's
inverse less that of the neighbourhood; a robot that turns and passes with several headings
gathers the mean of what they tell, as often as it scans. `position_radius` is the root of the
trace of what is then left: a root mean square distance. Our own definition; docs/truth.md has how
it fares against measured errors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambinav.config import as_number
from ambinav.errors import InputError
from ambinav.maps.ambiguity_map import AmbiguityMap

VIEWS = 2.0
"""How many scans the views of a scanner that does not look all around are worth together."""


def position_radius(amap: AmbiguityMap, views: float = VIEWS) -> NDArray[np.float64]:
    """Root mean square distance to the positions aliased with a pose's, whatever the heading.

    Args:
        amap: The map.
        views: How many scans the headings of the map are worth together, above 0; a scanner that
            looks all around sees the same again and again, and has one.

    Returns:
        Shape (ny, nx), metres, at most the radius of the neighbourhood; nan where it is not free.

    Raises:
        InputError: `views` is not above 0.
    """
    if not as_number(views, "views") > 0.0:
        raise InputError(f"views is {views}; give a number of scans above 0.")
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
    known = np.isfinite(parts[0])
    count = np.where(known.any(axis=-1), known.sum(axis=-1), np.nan)
    xx, yy, xy = (np.where(known, part, 0.0).sum(axis=-1) / count for part in parts)
    # The trace of the inverse of [[xx, xy], [xy, yy]].
    return np.asarray(np.sqrt((xx + yy) / (xx * yy - xy**2)))
