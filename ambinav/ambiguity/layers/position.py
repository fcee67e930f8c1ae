"""Position error to expect at a point, all headings taken together, as a cost in [0, 1].

Source: our own; `ambinav.ambiguity.radius` has the formula, docs/truth.md how it fares against
measured errors. The layer `level` is the share of its neighbourhood that a robot can slide in
unseen, at one heading. This one counts metres, and what the headings tell adds up: for scanners
that do not look all around it tells bad places from good ones better.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.layers.context import LayerContext
from ambinav.ambiguity.layers.registry import Layer
from ambinav.ambiguity.radius import VIEWS, position_radius
from ambinav.errors import InputError


def position(context: LayerContext, views: float = VIEWS) -> dict[str, NDArray[np.float32]]:
    """Position radius of each free cell, and its share of that of a whole, featureless disc.

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
    return {
        "position": share.astype(np.float32),
        "position_radius": metres.astype(np.float32),
    }


LAYER = Layer(
    name="position",
    title="position radius, as a share of the neighbourhood's",
    unit="1",
    source="own, from the ambiguity tensors of all headings: docs/truth.md",
    worse="high",
    compute=position,
    companions={"position_radius": ("position radius, all headings together", "m")},
)
