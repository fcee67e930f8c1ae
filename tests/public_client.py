"""A program of a user, as type checkers see it: no casts, and no types but those that it names."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import ambinav as an
from ambinav.plugin import LAYERS, Layer, LayerContext
from ambinav_envs import Policy, load_policy
from ambinav_planners import RoutePlanner

Floats = NDArray[np.float64]


def depth(context: LayerContext) -> dict[str, NDArray[np.float32]]:
    means = [context.hits(k).distance.mean(axis=1) for k in range(len(context.headings))]
    return {"depth": context.spread(np.stack(means, axis=1))}


def worst_of(poses: Floats) -> tuple[float, Floats, float, str]:
    building: an.Environment = an.load_environment(an.DEMO_BUILDING)
    amap: an.AmbiguityMap = an.build_map(building, an.DEMO_SCANNER, spacing=0.4)
    service = an.AmbiguityService(amap, weight=2.0)
    level: float = amap.sample("level", 3.0, 3.0)
    costs: Floats = service.cost(poses[:, 0], poses[:, 1])
    step: float = service.motion_cost(3.0, 3.0, 4.0, 3.0)
    free: bool = building.is_free(3.0, 3.0, radius=0.2)
    route: an.Route = RoutePlanner(service, footprint=0.2).plan(an.DEMO_START, an.DEMO_GOAL)
    policy: Policy = load_policy("vfh")
    return level, costs[costs > step], route.length, f"{free} {type(policy).__name__}"


LAYERS.register(
    Layer(name="depth", title="depth", unit="m", source="own", worse="high", compute=depth)
)
