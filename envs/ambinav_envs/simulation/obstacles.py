"""Unmapped boxes, and people: occlusion of beams, and collisions.

A box is its middle and two vectors at right angles from there to the middles of two sides.
"""

from __future__ import annotations

import math

from ambinav.drive.people import KEEP, strolled
from ambinav.drive.world import BISECTIONS
from ambinav.geometry.collision.disc_sweep import place
from ambinav.geometry.collision.gaps import near_arc, near_line
from ambinav.geometry.collision.obstacles import in_triangles, nearest_gap
from ambinav.geometry.footprint import ROUNDING
from ambinav.localization.random import uniform
from ambinav.runtime.kernels import kernel

# How often a position is drawn for a box or a person before it is left out.
TRIES = 200
# Room beside a box, beyond what the robot needs to pass it, metres.
SPARE = 0.1


@kernel
def shade(x, y, theta, people, radius, boxes, count, row, origin, start, work, reach):
    """Shorten rays, already cast, that hit a person or a box before the wall.

    A person who stands on a sensor is not seen.

    Args:
        x: The robot, metres, map frame.
        y: The same.
        theta: Its heading, radians.
        people: `Memory.people`.
        radius: Radius of a person, metres.
        boxes: `Memory.boxes`.
        count: Number of boxes in use.
        row: Which robot's they are.
        origin: See `ambinav.localization.casting.CastTables`.
        start: See there; of the rays in `work`.
        work: As `cast_rays` left it; distances are shortened, edges made -1.
        reach: Range of the scanner, metres: what is farther than that is not looked at.
    """
    ux, uy, distance, hit, _ = work
    co, si = math.cos(theta), math.sin(theta)
    swing = 0.0
    for g in range(origin.shape[0]):
        swing = max(swing, math.hypot(origin[g, 0], origin[g, 1]))
    for k in range(people.shape[1]):
        cx, cy = people[row, k, 0], people[row, k, 1]
        if math.hypot(cx - x, cy - y) > reach + swing + radius:
            continue
        for j in range(distance.size):
            wx = cx - x - co * start[j, 0] + si * start[j, 1]
            wy = cy - y - si * start[j, 0] - co * start[j, 1]
            along, across = wx * ux[j] + wy * uy[j], wx * uy[j] - wy * ux[j]
            inside = radius * radius - across * across
            if along > 0.0 and inside > 0.0 and wx * wx + wy * wy > radius * radius:
                d = along - math.sqrt(inside)
                if d < distance[j]:
                    distance[j], hit[j] = d, -1
    for k in range(count):
        cx, cy = boxes[row, k, 0], boxes[row, k, 1]
        ax, ay, bx, by = boxes[row, k, 2], boxes[row, k, 3], boxes[row, k, 4], boxes[row, k, 5]
        a2, b2 = ax * ax + ay * ay, bx * bx + by * by
        if math.hypot(cx - x, cy - y) > reach + swing + math.sqrt(a2 + b2):
            continue
        for j in range(distance.size):
            wx = cx - x - co * start[j, 0] + si * start[j, 1]
            wy = cy - y - si * start[j, 0] - co * start[j, 1]
            across = wx * uy[j] - wy * ux[j]
            if across * across > a2 + b2:
                continue
            # Between the two pairs of parallel sides: shares of the half edges along the ray.
            va, vb = (ux[j] * ax + uy[j] * ay) / a2, (ux[j] * bx + uy[j] * by) / b2
            oa, ob = (wx * ax + wy * ay) / a2, (wx * bx + wy * by) / b2
            into, out = -math.inf, math.inf
            if va != 0.0:
                into = max(into, oa / va - 1.0 / abs(va))
                out = min(out, oa / va + 1.0 / abs(va))
            elif abs(oa) > 1.0:
                continue
            if vb != 0.0:
                into = max(into, ob / vb - 1.0 / abs(vb))
                out = min(out, ob / vb + 1.0 / abs(vb))
            elif abs(ob) > 1.0:
                continue
            if 0.0 < into <= out and into < distance[j]:
                distance[j], hit[j] = into, -1


@kernel
def _clear_of_boxes(x, y, ux, uy, bend, length, reach, boxes, count, row):
    """Return whether a disc touches no box along a path; see `ambinav.drive.world.path`."""
    qx, qy = place(x, y, ux, uy, bend, length)
    mx, my = place(x, y, ux, uy, bend, 0.5 * length)
    cx = cy = radius = cosine = 0.0
    if bend != 0.0:
        cx, cy, radius = x - uy / bend, y + ux / bend, 1.0 / abs(bend)
        cosine = math.cos(0.5 * length * abs(bend))
    for k in range(count):
        ax, ay, bx, by = boxes[row, k, 2], boxes[row, k, 3], boxes[row, k, 4], boxes[row, k, 5]
        around = math.sqrt(ax * ax + ay * ay + bx * bx + by * by)
        if math.hypot(boxes[row, k, 0] - x, boxes[row, k, 1] - y) > length + reach + around:
            continue
        # From corner to corner, once around.
        for _ in range(4):
            px, py = boxes[row, k, 0] + ax - bx, boxes[row, k, 1] + ay - by
            ex, ey = 2.0 * bx, 2.0 * by
            if bend == 0.0:
                if near_line(px, py, ex, ey, x, y, ux, uy, length, reach):
                    return False
            elif near_arc(
                px, py, ex, ey, cx, cy, radius, (mx - cx) / radius, (my - cy) / radius, cosine,
                x, y, qx, qy, reach,
            ):  # fmt: skip
                return False
            ax, ay, bx, by = bx, by, -ax, -ay
    return True


@kernel
def free_share_of_boxes(x, y, ux, uy, bend, length, reach, boxes, count, row):
    """Return the share of a path that a disc drives before it touches a box; 1 for all.

    As `ambinav.drive.world.free_share`; boxes, count and row as for `shade`.
    """
    reach = max(reach - ROUNDING, ROUNDING)
    if length == 0.0 or _clear_of_boxes(x, y, ux, uy, bend, length, reach, boxes, count, row):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        share = 0.5 * (low + high)
        is_clear = _clear_of_boxes(x, y, ux, uy, bend, share * length, reach, boxes, count, row)
        low, high = (share, high) if is_clear else (low, share)
    return low


@kernel
def walk(people, row, x, y, settings, table, bound, state):
    """Move the people of one robot, which is at (x, y), by a time step."""
    apart = settings.radius + settings.person_radius + KEEP
    length = settings.person_speed * settings.dt
    for k in range(people.shape[1]):
        # Drawn whether it is needed or not, so that the draws do not depend on the robot.
        other = 2.0 * math.pi * uniform(state)
        px, py, t = people[row, k, 0], people[row, k, 1], people[row, k, 2]
        px, py, t = strolled(
            px, py, t, x, y, apart, length, settings.person_radius, other, table, bound
        )
        people[row, k, 0], people[row, k, 1], people[row, k, 2] = px, py, t


@kernel(inline="always")
def _fits(x, y, radius, table):
    """Return whether a disc is in the free space."""
    return in_triangles(x, y, table) and nearest_gap(x, y, radius, table) >= radius


@kernel
def gather(people, row, x, y, bounds, settings, table, state):
    """Draw a pose for every person, away from the robot at (x, y); False if there is no room.

    Args:
        people: `Memory.people`, written.
        row: Which robot's they are.
        x: The robot, metres, map frame.
        y: The same.
        bounds: Left, lower, right and upper end of the building, metres.
        settings: See `SETTINGS`.
        table: The first of `CollisionChecker.arrays`.
        state: State of the random numbers.
    """
    apart = settings.radius + settings.person_radius + KEEP
    for k in range(people.shape[1]):
        has_room = False
        for _ in range(TRIES * TRIES):
            px = bounds[0] + uniform(state) * (bounds[2] - bounds[0])
            py = bounds[1] + uniform(state) * (bounds[3] - bounds[1])
            if math.hypot(px - x, py - y) > apart and _fits(px, py, settings.person_radius, table):
                has_room = True
                break
        if not has_room:
            return False
        people[row, k, 0], people[row, k, 1] = px, py
        people[row, k, 2] = 2.0 * math.pi * uniform(state)
    return True


@kernel
def clutter(
    boxes, row, count, x, y, goal_x, goal_y, later_x, later_y, bounds, settings, table, state
):  # fmt: skip
    """Draw boxes that the robot can pass on any side; return how many there are then.

    Each stands free: the robot gets through between it and any wall, any other box, its own start,
    its goal and where it is carried to, so what could be reached still can.

    Args:
        boxes: `Memory.boxes`, written.
        row: Which robot's they are.
        count: Number of boxes already placed.
        x: The robot, metres, map frame.
        y: The same.
        goal_x: Its goal.
        goal_y: The same.
        later_x: Where it is carried to; anywhere that it is already, for nowhere.
        later_y: The same.
        bounds: Left, lower, right and upper end of the building, metres.
        settings: See `SETTINGS`.
        table: The first of `CollisionChecker.arrays`.
        state: State of the random numbers.
    """
    beside = 2.0 * settings.radius + SPARE
    for _ in range(settings.obstacles):
        for _ in range(TRIES):
            cx = bounds[0] + uniform(state) * (bounds[2] - bounds[0])
            cy = bounds[1] + uniform(state) * (bounds[3] - bounds[1])
            span = 0.5 * (settings.box_most - settings.box_least)
            length = 0.5 * settings.box_least + span * uniform(state)
            width = 0.5 * settings.box_least + span * uniform(state)
            turn = math.pi * uniform(state)
            apart = math.hypot(length, width) + beside
            good = math.hypot(cx - x, cy - y) > apart
            good &= math.hypot(cx - goal_x, cy - goal_y) > apart
            good &= math.hypot(cx - later_x, cy - later_y) > apart
            for k in range(count):
                ax, ay, bx, by = (
                    boxes[row, k, 2],
                    boxes[row, k, 3],
                    boxes[row, k, 4],
                    boxes[row, k, 5],
                )
                other = math.sqrt(ax * ax + ay * ay + bx * bx + by * by)
                gap = math.hypot(cx - boxes[row, k, 0], cy - boxes[row, k, 1])
                good &= gap > apart + other
            if good and _fits(cx, cy, apart, table):
                co, si = math.cos(turn), math.sin(turn)
                boxes[row, count, 0], boxes[row, count, 1] = cx, cy
                boxes[row, count, 2], boxes[row, count, 3] = length * co, length * si
                boxes[row, count, 4], boxes[row, count, 5] = -width * si, width * co
                count += 1
                break
    return count
