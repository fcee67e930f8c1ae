"""Time that a metre takes where the localization error bounds the speed: a cost to plan with.

A planner needs a cost of a metre that depends on the place alone; the error of a forecast's filter
depends on the route up to there. So the error here is what the filter comes to after some metres of
floor as it is at that place (`steady_layers`), with its covariance, over directions of driving.
From it `BrakingRule` has a speed v, and with

    slowness = v_max / v - 1

a metre takes (1 + slowness) / v_max seconds: at weight 1 the cost of a route, in equivalent metres,
is v_max times the seconds that it takes at those speeds, without ramps, bends and turns on the
spot. Its length over v_max is a lower bound, as for every cost here.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ambinav.config import as_positive, check_kind
from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.braking import BrakingRule, free_distance
from ambinav.forecasting.document import ODOMETRY
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.forecasting.steady_layers import steady_state
from ambinav.layers.build import layer_variables
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.maps.ambiguity_map import AmbiguityMap

LAYER: Final = "slowness"
METRES: Final = 8.0
"""Metres of such floor."""
_RECORD: Final = Layer(
    name=LAYER,
    title="extra time of a metre where the position error bounds the speed",
    unit="1",
    source="own: docs/planning.md",
    worse="high",
    compute=dict,
)


def with_slowness(
    amap: AmbiguityMap,
    rule: BrakingRule,
    max_speed: float = 0.5,
    *,
    odometry: str | OdometryNoise = ODOMETRY,
    localizer: str | LocalizerClass = "product",
) -> AmbiguityMap:
    """Return a map with the layer `slowness`, the extra cost of a metre in minimum time.

    `AmbiguityService(with_slowness(amap, rule), "slowness", weight=1.0)` has costs of max_speed
    times seconds.

    Args:
        amap: A map with the layer `clearance`.
        rule: Rule that bounds the speed; its radius is the robot's.
        max_speed: Speed where nothing bounds it, metres per second, above 0.
        odometry: Errors of the odometry, as for `Forecaster`.
        localizer: Class of localizer, likewise.

    Raises:
        InputError: the speed is not above 0, or see `Forecaster`.
    """
    max_speed = as_positive(max_speed, "max_speed", "metres per second")
    check_kind(rule, BrakingRule, "rule")
    context = LayerContext.of(amap)
    spread, _ = steady_state(context, odometry, localizer, METRES, loses=False)
    speed = np.empty(spread.shape[:2])
    for k in range(len(context.headings)):
        covariance = spread[:, k, [[0, 1], [1, 2]]]
        room = free_distance(amap, context.poses(k), covariance, rule.sigmas) - rule.radius
        speed[:, k] = rule.speeds(room)
    slowness = np.maximum(max_speed / speed, 1.0) - 1.0
    options = {"max_speed": max_speed, "odometry": str(odometry), "localizer": str(localizer)}
    layer = layer_variables(
        _RECORD, context, {LAYER: context.spread(slowness)}, options | vars(rule)
    )
    return AmbiguityMap(amap.dataset.assign(layer), source=amap.source)
