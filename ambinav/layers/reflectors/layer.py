"""Reflectors that a robot sees, the precision of its position by them, and aliasing.

For robots that navigate by reflectors alone. `reflectors` is how many are recognised (`views`);
`reflectors_std` the standard deviation of the position by their ranges and bearings (`precision`);
`reflectors_margin` how many of them the best wrong pose does not explain (`aliased_poses`), 0 also
where fewer than needed are seen.
"""

from __future__ import annotations

import numpy as np

from ambinav.layers.context import LayerContext
from ambinav.layers.reflectors.positioning import Site
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules, why_no_reflectors
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Floats32


def reflectors(
    context: LayerContext,
    *,
    needed: int = 3,
    max_range: float | None = None,
    max_incidence: float = 45.0,
    tolerance: float = 0.1,
) -> dict[str, Floats32]:
    """Compute the layer and its companions.

    Args:
        context: What the map was made of; all beams of its scanner are taken.
        needed: See `ReflectorRules`, like the next three.
        max_range: See there.
        max_incidence: See there.
        tolerance: See there.

    Raises:
        InputError: an option is out of its range.
    """
    rules = ReflectorRules(needed, max_range, max_incidence, tolerance)
    site, targets = Site.of(context, rules), Targets.of(context.environment)
    positioning = site.positioning(targets, site.views(targets))
    std = np.where(np.isfinite(positioning.std), positioning.std, np.nan)
    values = {
        "reflectors": positioning.count,
        "reflectors_std": std,
        "reflectors_margin": positioning.margin,
    }
    shape = context.possible.shape
    return {
        name: context.spread(np.broadcast_to(value.astype(np.float64), shape))
        for name, value in values.items()
    }


LAYER = Layer(
    name="reflectors",
    title="reflectors in view",
    unit="1",
    source="own; aliased poses as Ronzoni, Olmi, Secchi and Fantuzzi 2011 (ICRA) match reflectors",
    worse="low",
    compute=reflectors,
    why_not=why_no_reflectors,
    companions={
        "reflectors_std": ("standard deviation of the position by reflectors", "m"),
        "reflectors_margin": ("reflectors in view that no wrong pose explains", "1"),
    },
    high_is_good=("reflectors_margin",),
)
