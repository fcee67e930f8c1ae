"""Buildings drawn from a generator: walls, rooms with doors, corridors at odd angles, racks."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import shapely

from ambinav.config import as_number
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.cells import Doorway, Ring, cut, doorways, is_roomy, long_axis
from ambinav_envs.buildings.furnish import along_walls, freestanding, racks
from ambinav_envs.buildings.plan import WALL, Plan, sides
from ambinav_envs.buildings.plan_sampler import PlanSampler

# A room's least width and side (m), its least area (m2) and its sharpest corner (degrees).
ROOM: Final = (2.6, 1.6, 9.0, 50.0)
# The same of a corridor.
CORRIDOR: Final = (1.0, 1.0, 4.0, 30.0)
# A disc of this radius gets everywhere where it fits, metres.
ROBOT: Final = 0.35
# From this area on a room may be a hall with pillars or racks, square metres.
HALL: Final = 38.0
DOOR: Final = 1.0
# Least wall on both sides of a door together, metres.
POSTS: Final = 0.5
# Within which the ranges of `ProceduralParameters` must lie.
_RANGES: Final = {
    "size": (8.0, 100.0),
    "hall_width": (3.0, 50.0),
    "corridors": (0.0, 10.0),
    "corridor_width": (1.2, 5.0),
    "room_area": (6.0, 10_000.0),
    "tilt": (0.0, 45.0),
}
_TRIES: Final = 8
_DRAWINGS: Final = 100


@dataclass(frozen=True, kw_only=True)
class ProceduralParameters:
    """Parameters of procedural buildings; ranges are (least, greatest).

    Attributes:
        size: Length of each side of the outline, metres.
        great_halls: Share of the buildings with a hall that is wider than a short range.
        hall_width: Length of each of its sides, metres.
        corridors: How many corridors, whole numbers.
        corridor_width: Metres.
        room_area: Rooms larger than a number drawn from this are parted, square metres.
        halls: Share of the floors that are left large: parted at five times the area.
        tilted: Share of the walls and corridors that are at an odd angle.
        tilt: Angle of these, degrees.
        furniture: Share of the rooms' walls that things stand at.
        more_doors: Share of the walls that get a door although there is another path already.

    Raises:
        InputError: a value makes no sense.
    """

    size: tuple[float, float] = (14.0, 23.0)
    great_halls: float = 0.4
    hall_width: tuple[float, float] = (10.5, 14.0)
    corridors: tuple[int, int] = (1, 2)
    corridor_width: tuple[float, float] = (1.7, 2.5)
    room_area: tuple[float, float] = (14.0, 32.0)
    halls: float = 0.4
    tilted: float = 0.4
    tilt: tuple[float, float] = (8.0, 32.0)
    furniture: float = 0.5
    more_doors: float = 0.3

    def __post_init__(self) -> None:
        """Check every value and convert it to its type."""
        for field in fields(self):
            name, value = field.name, getattr(self, field.name)
            if name not in _RANGES:
                share = as_number(value, name)
                if not 0.0 <= share <= 1.0:
                    raise InputError(f"{name} is {share:g}; give a share from 0 to 1.")
                object.__setattr__(self, name, share)
                continue
            if not isinstance(value, tuple | list) or len(value) != 2:
                raise InputError(f"{name} is {value!r}; give a range: the least, the greatest.")
            low, high = (as_number(part, name) for part in value)
            least, most = _RANGES[name]
            if not least <= low <= high <= most:
                raise InputError(
                    f"{name} is {value!r}; give a rising range from {least:g} to {most:g}."
                )
            is_integer = name == "corridors"
            if is_integer and not (low.is_integer() and high.is_integer()):
                raise InputError(f"{name} is {value!r}; give whole numbers.")
            object.__setattr__(self, name, (int(low), int(high)) if is_integer else (low, high))


def procedural_building(
    rng: np.random.Generator,
    parameters: ProceduralParameters | None = None,
    *,
    name: str = "procedural",
) -> Environment:
    """Draw a building; the same generator draws the same one in any process.

    The floor is cut into convex rooms by straight walls; one door leads to every room, more to
    some. A disc of up to `ROBOT` metres of radius gets from anywhere to anywhere that it fits.
    """
    chosen = ProceduralParameters() if parameters is None else parameters
    sampler = PlanSampler(rng)
    for _ in range(_DRAWINGS):
        plan = procedural_plan(sampler, chosen)
        if plan is not None:
            building = plan.environment(name)
            if shapely.get_num_geometries(building.free.buffer(-ROBOT, quad_segs=4)) == 1:
                return building
    raise InputError(f"{name}: no building can be drawn with {chosen}; allow larger rooms.")


def procedural_plan(sampler: PlanSampler, parameters: ProceduralParameters) -> Plan | None:
    """Try once to draw a building; return None if its rooms cannot be connected."""
    width, height = sampler.between(*parameters.size), sampler.between(*parameters.size)
    floors = [np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])]
    halls: list[Ring] = []
    if sampler.happens(parameters.great_halls):
        floors, halls = _with_hall(sampler, parameters, floors[0])
    corridors: list[Ring] = []
    for _ in range(sampler.count(*parameters.corridors)):
        floors, strips = _with_corridor(sampler, parameters, floors)
        corridors += strips
    cells = halls + [part for floor in floors for part in _parted(sampler, parameters, floor)]
    # Half a wall off every room: what two rooms share becomes a wall of full thickness.
    inner = [
        shapely.buffer(shapely.Polygon(ring), -0.5 * WALL, join_style="mitre", mitre_limit=100.0)
        for ring in (*corridors, *cells)
    ]
    chosen = _doors(sampler, parameters, inner)
    reached = {0} | {room for doorway in chosen for room in doorway.rooms}
    plan = Plan()
    for k in sorted(reached):
        plan.room(inner[k])
    for doorway in chosen:
        plan.door(doorway.at(sampler.between(0.0, 1.0), DOOR + POSTS), doorway.degrees, DOOR)
    if sum(room.area for room in plan.rooms) < 0.75 * width * height:
        return None
    for k in sorted(reached - set(range(len(corridors)))):
        _furnish(plan, sampler, parameters, inner[k])
    return plan


def _angle(sampler: PlanSampler, parameters: ProceduralParameters, degrees: float) -> float:
    """Return this angle, or draw an odd one near it."""
    if not sampler.happens(parameters.tilted):
        return degrees
    return degrees + sampler.one_of((-1.0, 1.0)) * sampler.between(*parameters.tilt)


def _with_hall(
    sampler: PlanSampler, parameters: ProceduralParameters, floor: Ring
) -> tuple[list[Ring], list[Ring]]:
    """Cut a large hall from a corner of the floor; return the remaining floor and the hall."""
    rooms: list[Ring] = []
    hall = floor
    corner = floor[sampler.count(0, 3)]
    for degrees in sampler.shuffled((0.0, 90.0)):
        across = math.radians(degrees + 90.0)
        normal = np.array([math.cos(across), math.sin(across)])
        inwards = normal if (floor.mean(axis=0) - corner) @ normal > 0.0 else -normal
        x, y = corner + sampler.between(*parameters.hall_width) * inwards
        parts = cut(hall, (float(x), float(y)), degrees)
        near, far = parts if inwards is not normal else parts[::-1]
        if is_roomy(far, *ROOM):
            hall, rooms = near, [*rooms, far]
    return (rooms, [hall]) if rooms else ([floor], [])


def _with_corridor(
    sampler: PlanSampler, parameters: ProceduralParameters, floors: list[Ring]
) -> tuple[list[Ring], list[Ring]]:
    """Cut a corridor across the largest floor; return the remaining floors and the corridor."""
    floors = sorted(floors, key=lambda ring: -float(shapely.Polygon(ring).area))
    for _ in range(_TRIES):
        degrees = _angle(sampler, parameters, long_axis(floors[0]))
        middle = _inside(sampler, floors[0], 0.3, 0.7)
        width = sampler.between(*parameters.corridor_width) + WALL
        offset = math.radians(degrees + 90.0)
        opposite = middle[0] + width * math.cos(offset), middle[1] + width * math.sin(offset)
        above, below = cut(floors[0], middle, degrees)
        if not is_roomy(below, *ROOM):
            continue
        above, strip = cut(above, opposite, degrees)
        if is_roomy(above, *ROOM) and is_roomy(strip, *CORRIDOR):
            return [*floors[1:], below, above], [strip]
    return floors, []


def _parted(sampler: PlanSampler, parameters: ProceduralParameters, ring: Ring) -> list[Ring]:
    """Cut a floor into rooms."""
    limit = sampler.between(*parameters.room_area) * (
        5.0 if sampler.happens(parameters.halls) else 1.0
    )
    if shapely.Polygon(ring).area <= limit:
        return [ring]
    for _ in range(_TRIES):
        degrees = _angle(sampler, parameters, long_axis(ring) + 90.0)
        parts = cut(ring, _inside(sampler, ring, 0.3, 0.7), degrees)
        if all(is_roomy(part, *ROOM) for part in parts):
            return [room for part in parts for room in _parted(sampler, parameters, part)]
    return [ring]


def _inside(sampler: PlanSampler, ring: Ring, low: float, high: float) -> tuple[float, float]:
    """Draw a point in the middle part of a polygon's bounding box."""
    lower, upper = ring.min(axis=0), ring.max(axis=0)
    x, y = lower + (upper - lower) * (sampler.between(low, high), sampler.between(low, high))
    return float(x), float(y)


def _doors(
    sampler: PlanSampler, parameters: ProceduralParameters, rooms: list[shapely.Polygon]
) -> list[Doorway]:
    """Choose doorways that connect every reachable room with the first, and some more."""
    possible = sampler.shuffled(doorways(rooms, WALL, DOOR + POSTS))
    group = list(range(len(rooms)))
    chosen = []
    for doorway in possible:
        first, second = (group[room] for room in doorway.rooms)
        if first != second or sampler.happens(parameters.more_doors):
            chosen.append(doorway)
            group = [first if label == second else label for label in group]
    return [doorway for doorway in chosen if group[doorway.rooms[0]] == group[0]]


def _furnish(
    plan: Plan, sampler: PlanSampler, parameters: ProceduralParameters, room: shapely.Polygon
) -> None:
    """Place furniture in a room according to its size."""
    if parameters.furniture == 0.0:
        return
    if room.area < HALL:
        if sampler.happens(0.85):
            along_walls(plan, sampler, room, parameters.furniture)
            freestanding(plan, sampler, room, sampler.count(0, 1 + int(room.area / 15.0)))
    elif sampler.happens(0.5):
        racks(
            plan, sampler, room, depth=sampler.between(0.8, 1.1), aisle=sampler.between(1.5, 2.2),
            border=sampler.between(1.4, 2.0), gaps=0.4,
        )  # fmt: skip
    else:
        chosen_sides = sampler.shuffled(range(len(sides(room))))[: sampler.count(1, 2)]
        along_walls(plan, sampler, room, parameters.furniture, walls=tuple(chosen_sides))
        freestanding(plan, sampler, room, sampler.count(0, 3), sizes=(0.4, 0.6), round_share=0.5)
