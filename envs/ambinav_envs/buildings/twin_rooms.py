"""Buildings whose wings are equal: only what stands behind a side passage tells them apart."""

from __future__ import annotations

from functools import partial

from shapely.affinity import rotate

from ambinav_envs.buildings.furnish import along_walls
from ambinav_envs.buildings.plan import WALL, Plan, rectangle
from ambinav_envs.buildings.plan_sampler import PlanSampler

# Width of a side passage, edges of the chamber at its end, edge of the post there, metres.
LANE, CHAMBER, POST = 1.3, (2.6, 2.0), 0.8


def twin_rooms(sampler: PlanSampler, wings: int, depths: tuple[float, float]) -> Plan:
    """Draw a building of equal wings about a centre, turned from one to the next.

    A wing is a corridor with a furnished room at its end, and beside it a passage with a chamber
    round a corner. In one of the chambers stands a post, and nothing else tells the wings apart.

    Args:
        sampler: Source of the random choices.
        wings: Number of wings, 2 or more.
        depths: Least and greatest length of the side passages, metres; at 0 the post is seen from
            the corridor.
    """
    width, length = sampler.between(1.8, 2.2), sampler.between(7.0, 9.0)
    deep, wide = sampler.between(3.6, 4.4), sampler.between(4.0, 5.0)
    side, depth = sampler.between(2.8, 3.6), sampler.between(*depths)
    wing, half = Plan(), 0.5 * width
    # Into the other wings, so that two of them are one straight corridor.
    wing.box(-half if wings == 2 else 0.0, -half, length, half)
    room = wing.box(length + WALL, -0.5 * wide, length + WALL + deep, 0.5 * wide)
    wing.door((length + 0.5 * WALL, 0.0), 90.0)
    low, high = half + depth, half + depth + CHAMBER[1]
    wing.box(side, 0.0, side + LANE, high)
    wing.box(side, low, side + CHAMBER[0], high)
    along_walls(wing, sampler, room, 0.4)
    plan = Plan()
    for k in range(wings):
        turned = partial(rotate, angle=360.0 * k / wings, origin=(0.0, 0.0))
        plan.rooms += map(turned, wing.rooms)
        plan.doors += map(turned, wing.doors)
        plan.solids += map(turned, wing.solids)
    middle = (side + CHAMBER[0] - 0.5 * POST, 0.5 * (low + high))
    plan.solids.append(rectangle(middle, 0.0, POST, POST))
    return plan
