"""Furniture of rooms: desks along the walls, tables, pillars, rows of racks."""

from __future__ import annotations

import math

import numpy as np
import shapely

from ambinav_envs.buildings.plan import AISLE, Plan, disc, rectangle, sides
from ambinav_envs.buildings.plan_sampler import PlanSampler

# Attempts for each thing: where it does not fit, fewer stand.
TRIES = 6
# Steps of a sequence of points that covers a square evenly (Roberts 2018, the R2 sequence: powers
# of the inverse of the plastic number).
EVEN = (0.7548776662466927, 0.5698402909980532)


def along_walls(
    plan: Plan,
    sampler: PlanSampler,
    room: shapely.Polygon,
    share: float,
    *,
    depths: tuple[float, float] = (0.4, 0.8),
    lengths: tuple[float, float] = (0.6, 2.0),
    walls: tuple[int, ...] | None = None,
) -> None:
    """Place desks, shelves and cabinets against the walls of a convex room.

    Args:
        plan: The building.
        sampler: Source of the random choices.
        room: The room.
        share: Approximate share of the walls with furniture.
        depths: Least and greatest depth of a thing, metres.
        lengths: Least and greatest length along the wall, metres.
        walls: Numbers of the room's sides (`sides`) that are used; None: all.
    """
    for number, side in enumerate(sides(room)):
        if walls is not None and number not in walls:
            continue
        (ax, ay), (bx, by) = shapely.get_coordinates(side)
        size = math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / size, (by - ay) / size
        degrees = math.degrees(math.atan2(uy, ux))
        # From one end of the wall to the other: a thing, a gap.
        mean = 0.5 * (lengths[0] + lengths[1])
        gap = max(mean * (1.0 / share - 1.0), AISLE)
        begin = sampler.between(0.0, gap)
        while begin < size:
            length, depth = sampler.between(*lengths), sampler.between(*depths)
            end = begin + length
            # Near a corner it reaches into it: a gap there would be of no use.
            low = -2.0 if begin < AISLE else begin
            high = size + 2.0 if end > size - AISLE else end
            if high - low < size:
                middle, half = 0.5 * (low + high), 0.5 * depth - 0.05
                place = (ax + middle * ux - half * uy, ay + middle * uy + half * ux)
                plan.stand(room, rectangle(place, degrees, high - low, depth + 0.1))
            begin = end + sampler.between(max(0.5 * gap, AISLE), 1.5 * gap)


def freestanding(
    plan: Plan,
    sampler: PlanSampler,
    room: shapely.Polygon,
    count: int,
    *,
    sizes: tuple[float, float] = (0.5, 1.6),
    round_share: float = 0.3,
) -> None:
    """Place tables or pillars in a room, away from its walls, at right angles to one of them."""
    xmin, ymin, xmax, ymax = room.bounds
    u, v = sampler.between(0.0, 1.0), sampler.between(0.0, 1.0)
    placed = 0
    for _ in range(TRIES * count):
        if placed == count:
            return
        u, v = (u + EVEN[0]) % 1.0, (v + EVEN[1]) % 1.0
        middle = (xmin + u * (xmax - xmin), ymin + v * (ymax - ymin))
        length, depth = sampler.between(*sizes), sampler.between(*sizes)
        if sampler.happens(round_share):
            shape = disc(middle, 0.5 * length)
        else:
            shape = rectangle(middle, _degrees(sampler.one_of(sides(room))), length, depth)
        if room.contains(shape):
            placed += plan.stand(room, shape)


def racks(
    plan: Plan,
    sampler: PlanSampler,
    room: shapely.Polygon,
    *,
    depth: float = 1.0,
    aisle: float = 1.8,
    border: float = 1.6,
    gaps: float = 0.0,
) -> None:
    """Place rows of equal racks along the longest side of a convex room.

    Args:
        plan: The building.
        sampler: Source of the random choices.
        room: The room.
        depth: Depth of a rack, metres.
        aisle: Between two rows, metres.
        border: Between the rows and the walls, metres.
        gaps: Share of the rows that have a passage.
    """
    longest = max(sides(room), key=lambda side: float(side.length))
    a, b = shapely.get_coordinates(longest)
    along = (b - a) / np.hypot(*(b - a))
    across = np.array([-along[1], along[0]])
    degrees = _degrees(longest)
    inner = room.buffer(-border, join_style="mitre")
    if inner.is_empty:
        return
    rows = shapely.get_coordinates(inner) @ across
    position = float(rows.min()) + 0.5 * depth
    while position + 0.5 * depth <= float(rows.max()) + 1e-9:
        # The part of the row that keeps off the walls over its whole depth.
        spans = []
        for offset in (-0.5 * depth + 1e-6, 0.5 * depth - 1e-6):
            foot = (position + offset) * across
            line = shapely.LineString([foot - 100.0 * along, foot + 100.0 * along])
            points = shapely.get_coordinates(line.intersection(inner)) @ along
            spans.append((points.min(), points.max()) if len(points) else (0.0, 0.0))
        low = float(max(span[0] for span in spans))
        high = float(min(span[1] for span in spans))
        pieces = [(low, high)]
        if high - low > 4.0 + aisle and sampler.happens(gaps):
            middle = sampler.between(low + 2.0, high - 2.0 - aisle)
            pieces = [(low, middle), (middle + aisle, high)]
        for begin, end in pieces:
            if end - begin >= 1.0:
                middle_point = 0.5 * (begin + end) * along + position * across
                place = (float(middle_point[0]), float(middle_point[1]))
                plan.stand(room, rectangle(place, degrees, end - begin, depth))
        position += depth + aisle


def _degrees(side: shapely.LineString) -> float:
    (ax, ay), (bx, by) = shapely.get_coordinates(side)
    return math.degrees(math.atan2(by - ay, bx - ax))
