"""Distance to the nearest wall or frontier, which every map already has as a layer.

No paper's measure: the oldest rule of thumb for where a range sensor sees much, to stay near
walls, which Roy, Burgard, Fox and Thrun (1999, "Coastal navigation", ICRA) improve on. It is here
so that it can be judged beside the other layers; far from every wall counts as badly localized.
"""

from __future__ import annotations

import numpy as np

from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.maps.core_layers import CORE_LAYERS
from ambinav.runtime.array_types import Floats32


def clearance(context: LayerContext) -> dict[str, Floats32]:
    """Compute the distance from each free cell's centre to the nearest segment, metres."""
    return {"clearance": context.spread(context.lattice.clearance(np.inf))}


_CORE = CORE_LAYERS["clearance"]
LAYER = Layer(
    name=_CORE.name,
    title=_CORE.title,
    unit=_CORE.unit,
    source=_CORE.source,
    worse=_CORE.worse,
    compute=clearance,
    in_space=True,
)
