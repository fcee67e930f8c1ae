"""Improvement of a route that must keep a limit on bad metres in a row.

Made cheaper by the cost alone, a route may cut through bad floor for longer than it may. So bad
metres are given a price of their own, as much as it takes (Lagrangian relaxation, Handler and
Zang 1980): the least price at which the improved route keeps the limit is bracketed and halved.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.collision import CollisionChecker
from ambinav.service.service import AmbiguityService
from ambinav_planners.improve import improve
from ambinav_planners.limit import BadStretchLimit

Floats = NDArray[np.float64]

# Prices of a bad metre, in metres-equivalent, relative to the dearest metre; and how often the
# bracket between the last one that was too low and the first one that was not is halved.
PRICES = (0.1, 0.3, 1.0, 3.0, 10.0)
HALVINGS = 2


def improve_within(
    poses: Floats, service: AmbiguityService, checker: CollisionChecker, limit: BadStretchLimit
) -> Floats | None:
    """The route improved such that it keeps a limit; None where no price of bad metres does it.

    Args:
        poses: A free route, shape (N, 3), N at least 2. It need not keep the limit itself.
        service: What a metre costs.
        checker: Where the robot fits and how it moves.
        limit: What the result keeps.

    Raises:
        InputError: see `improve`.
    """

    def at(price: float) -> Floats | None:
        found = improve(poses, priced(service, limit.level, price), checker)
        return found if limit.kept_by(found, service, checker.steering) else None

    best = at(0.0)
    if best is not None:
        return best
    dearest = float(service.density.values.max())
    low, high = 0.0, 0.0
    for share in PRICES:
        high = share * dearest
        best = at(high)
        if best is not None:
            break
        low = high
    if best is None:
        return None
    found = [best]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        route = at(middle)
        if route is None:
            low = middle
        else:
            high = middle
            found.append(route)
    return min(found, key=lambda route: service.route_cost(route, checker.steering))


def priced(service: AmbiguityService, level: float, price: float) -> AmbiguityService:
    """The service with `price` more for each metre where the layer is above a level."""
    if price == 0.0:
        return service
    bad = (service.ambiguity.values > level).astype(np.float32)
    other = copy(service)
    other.density = replace(service.density, values=service.density.values + price * bad)
    return other
