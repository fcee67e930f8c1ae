"""Five families of buildings, each with one feature that makes localization hard.

Every function draws one building of its family; `PlanSampler(None)` gives the plain one.
"""

from __future__ import annotations

import itertools

import shapely

from ambinav_envs.buildings.furnish import along_walls, freestanding, racks
from ambinav_envs.buildings.plan import WALL, Plan, rectangle
from ambinav_envs.buildings.plan_sampler import PlanSampler

# Numbers of the sides of a box, as `along_walls` takes them.
SOUTH, EAST, NORTH, WEST = range(4)


def hall(sampler: PlanSampler) -> Plan:
    """Draw a hall wider than a short range, bare in its middle, furnished along some walls.

    Straight across it a robot sees nothing; along the furnished walls it does.
    """
    plan = Plan()
    width, depth = sampler.between(14.0, 19.0), sampler.between(12.0, 16.0)
    room = plan.box(0.0, 0.0, width, depth)
    foyer = plan.box(-4.2, 0.2 * depth, -WALL, 0.2 * depth + sampler.between(4.0, 6.0))
    store_y = depth - sampler.between(4.5, 6.0)
    store = plan.box(width + WALL, store_y, width + 4.2, depth)
    foyer_y = 0.5 * (foyer.bounds[1] + foyer.bounds[3])
    plan.door((-0.5 * WALL, foyer_y), 90.0, 1.4)
    plan.door((width + 0.5 * WALL, store_y + sampler.between(1.2, 2.5)), 90.0, 1.2)
    furnished = sampler.one_of(((SOUTH, EAST), (SOUTH, WEST), (NORTH, WEST), (NORTH, EAST)))
    along_walls(plan, sampler, room, 0.4, depths=(0.3, 1.0), lengths=(0.4, 2.2), walls=furnished)
    along_walls(plan, sampler, foyer, 0.4)
    along_walls(plan, sampler, store, 0.5)
    # A few columns near the furnished walls; the middle stays bare.
    low_x, high_x = (2.0, 4.5) if WEST in furnished else (width - 4.5, width - 2.0)
    for k in range(sampler.count(2, 3)):
        y = depth * (0.25 + 0.25 * k) + sampler.between(-0.5, 0.5)
        plan.stand(room, rectangle((sampler.between(low_x, high_x), y), 0.0, 0.5, 0.5))
    return plan


def corridor(sampler: PlanSampler) -> Plan:
    """Draw a long bare corridor beside a row of furnished rooms with doors from one to the next.

    From the lobby to the store lead two paths of about the same length.
    """
    plan = Plan()
    length, width = sampler.between(16.0, 21.0), sampler.between(1.7, 2.3)
    depth = sampler.between(4.2, 5.2)
    top = depth + WALL + width
    plan.box(0.0, depth + WALL, length, top)
    lobby = plan.box(-4.2, 0.0, -WALL, top + sampler.between(0.0, 2.0))
    store = plan.box(length + WALL, 0.0, length + 4.2, top + sampler.between(0.0, 2.0))
    y = depth + WALL + 0.5 * width
    plan.door((-0.5 * WALL, y), 90.0, 1.3)
    plan.door((length + 0.5 * WALL, y), 90.0, 1.3)
    count = sampler.count(4, 5)
    edges = [length * k / count + sampler.between(-0.5, 0.5) for k in range(count + 1)]
    edges[0], edges[-1] = 0.0, length
    rooms = []
    for k in range(count):
        left = edges[k] + (0.5 * WALL if k else 0.0)
        right = edges[k + 1] - (0.5 * WALL if k + 1 < count else 0.0)
        rooms.append(plan.box(left, 0.0, right, depth))
    for k in range(count + 1):
        x = -0.5 * WALL if k == 0 else length + 0.5 * WALL if k == count else edges[k]
        plan.door((x, sampler.between(1.2, depth - 1.2)), 90.0, 1.0)
    for room in rooms:
        if sampler.happens(0.4):
            x = sampler.between(room.bounds[0] + 1.0, room.bounds[2] - 1.0)
            plan.door((x, depth + 0.5 * WALL), 0.0, 1.0)
    for room in (*rooms, lobby, store):
        along_walls(plan, sampler, room, 0.45)
        freestanding(plan, sampler, room, sampler.count(0, 2))
    return plan


def office(sampler: PlanSampler) -> Plan:
    """Draw furnished rooms on both sides of a corridor, some with doors between them as well."""
    plan = Plan()
    length, width = sampler.between(15.0, 19.0), sampler.between(1.6, 2.2)
    plan.box(0.0, 0.0, length, width)
    for north in (False, True):
        depth = sampler.between(4.5, 6.0)
        count = sampler.count(3, 4)
        edges = [length * k / count + sampler.between(-0.7, 0.7) for k in range(count + 1)]
        edges[0], edges[-1] = 0.0, length
        low = width + WALL if north else -WALL - depth
        wall = width + 0.5 * WALL if north else -0.5 * WALL
        rooms = []
        for left, right in itertools.pairwise(edges):
            left, right = left + 0.5 * WALL, right - 0.5 * WALL
            rooms.append(plan.box(left, low, right, low + depth))
            plan.door((sampler.between(left + 1.0, right - 1.0), wall), 0.0, 1.0)
        for edge in edges[1:-1]:
            if sampler.happens(0.4):
                plan.door((edge, low + sampler.between(1.3, depth - 1.3)), 90.0, 0.9)
        for room in rooms:
            along_walls(plan, sampler, room, 0.5)
            freestanding(plan, sampler, room, sampler.count(0, 2))
    return plan


def warehouse(sampler: PlanSampler) -> Plan:
    """Draw rows of equal racks, which look alike from aisle to aisle, and an office beside them."""
    plan = Plan()
    width, depth = sampler.between(16.0, 21.0), sampler.between(12.0, 15.0)
    room = plan.box(0.0, 0.0, width, depth)
    bureau = plan.box(-3.8, 0.0, -WALL, sampler.between(4.0, 5.5))
    dock = plan.box(-3.8, bureau.bounds[3] + WALL, -WALL, depth)
    plan.door((-0.5 * WALL, 0.5 * bureau.bounds[3]), 90.0, 1.1)
    plan.door((-2.0, bureau.bounds[3] + 0.5 * WALL), 0.0, 1.1)
    plan.door((-0.5 * WALL, sampler.between(bureau.bounds[3] + 1.5, depth - 1.5)), 90.0, 1.6)
    along_walls(plan, sampler, bureau, 0.5)
    along_walls(plan, sampler, dock, 0.3)
    racks(
        plan, sampler, room, depth=sampler.between(0.9, 1.2), aisle=sampler.between(1.7, 2.3),
        border=sampler.between(1.7, 2.4), gaps=0.6,
    )  # fmt: skip
    along_walls(plan, sampler, room, 0.15, depths=(0.4, 0.6), lengths=(0.8, 1.6))
    return plan


def loop(sampler: PlanSampler) -> Plan:
    """Draw a ring of corridors, bare on some sides and with niches and rooms on the others."""
    plan = Plan()
    width, depth = sampler.between(13.0, 18.0), sampler.between(11.0, 15.0)
    lane = sampler.between(1.8, 2.4)
    outer = plan.box(0.0, 0.0, width, depth)
    plan.solids.append(shapely.box(lane, lane, width - lane, depth - lane))
    # Rooms in the core and outside, each behind one door.
    sides = sampler.shuffled((SOUTH, EAST, NORTH, WEST))
    middle = (0.5 * width, 0.5 * depth)
    for side in sides[:2]:
        offset, size, deep = (
            sampler.between(-2.0, 2.0),
            sampler.between(3.5, 5.5),
            sampler.between(3.0, 4.0),
        )
        x, y = middle[0] + offset, middle[1] + offset
        low, high = -WALL - deep, -WALL
        if side == SOUTH:
            room = plan.box(x - 0.5 * size, low, x + 0.5 * size, high)
            plan.door((x, -0.5 * WALL), 0.0)
        elif side == NORTH:
            room = plan.box(x - 0.5 * size, depth - high, x + 0.5 * size, depth - low)
            plan.door((x, depth + 0.5 * WALL), 0.0)
        elif side == WEST:
            room = plan.box(low, y - 0.5 * size, high, y + 0.5 * size)
            plan.door((-0.5 * WALL, y), 90.0)
        else:
            room = plan.box(width - high, y - 0.5 * size, width - low, y + 0.5 * size)
            plan.door((width + 0.5 * WALL, y), 90.0)
        along_walls(plan, sampler, room, 0.5)
    # Shallow cabinets on one of these sides: what stands there tells the lanes apart.
    depths = (0.25, max(0.3, min(0.5, lane - 1.35)))
    along_walls(
        plan, sampler, outer, 0.3, depths=depths, lengths=(0.4, 1.4), walls=tuple(sides[:1])
    )
    return plan
