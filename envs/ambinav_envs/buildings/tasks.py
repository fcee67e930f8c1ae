"""Start and goal of an episode: a goal is drawn, and a start at a given distance from it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.geometry.collision.sweep import line_free
from ambinav.localization.random import uniform
from ambinav.runtime.array_types import Floats, Floats32, UInts
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav_envs.buildings.free_space import MARGIN, FreeSpaceArrays, FreeSpaceLattice
from ambinav_envs.buildings.geodesic import REACH, distance_at, follow, geodesic, heading_of

# How many goals are drawn before those at the far ends are tried, and how many of these.
_DRAWN, _FAR_ENDS = 32, 8
# Number of starts tried before all suitable ones are counted.
_GUESSES = 32
# A goal is joined to the cells within `REACH` cells of it, fewer than these, that the robot gets to
# in a straight line: near a goal every direction is then as long as it is.
_SEEDS = 32


class CostToGo(NamedTuple):
    """Cost of the best path to a goal from every cell, and its direction.

    Attributes:
        costs: See `geodesic`, float32, shape (rows, columns).
        towards: See `follow`, int8, shape (rows, columns).
    """

    costs: Floats32
    towards: NDArray[np.int8]

    @classmethod
    def of(cls, costs: Floats32, table: FreeSpaceArrays) -> CostToGo:
        """Add directions to costs computed at the prices of the table."""
        towards = np.empty(costs.shape, dtype=np.int8)
        follow(table.moves, table.prices, table.spacing, costs, towards)
        return cls(costs, towards)


@dataclass(frozen=True, eq=False)
class Task:
    """A start and a goal.

    Attributes:
        start: x, y, theta, metres and radians, map frame, shape (3,).
        goal: x, y, shape (2,).
        distance: Length of the shortest path from start to goal, metres.
        cost_to_go: Along the path that the robot is led on, see `Goals`.
        cost: Cost of the path from the start.
        door: A box that closes a door which the map calls open, see `doors.close_door`: x and y of
            its middle and of the vectors to the middles of two sides, the farther one first,
            shape (6,); None: there is none. Costs and distance are then those of the world, the
            directions those of the map.
    """

    start: Floats
    goal: Floats
    distance: float
    cost_to_go: CostToGo
    cost: float
    door: Floats | None = None

    @classmethod
    def shortest(cls, numbers: Floats, cost_to_go: CostToGo) -> Task:
        """Build a task on the shortest path; the six numbers are start, goal and distance."""
        distance = float(numbers[5])
        return cls(numbers[:3].copy(), numbers[3:5].copy(), distance, cost_to_go, distance)


def draw_task(
    lattice: FreeSpaceLattice,
    state: UInts,
    shortest: float,
    longest: float,
    *,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
) -> Task:
    """Draw a start and a goal, or the one of them that is not given.

    A goal is drawn evenly from where the robot can stand with `MARGIN` to spare, the start from
    what of that lies at the right distance from it; its heading is any.

    Args:
        lattice: Lattice of the building.
        state: State of the random numbers, uint64, shape (4,); advanced in place.
        shortest: Least length of the shortest path between the two, metres.
        longest: Greatest length of it, metres; inf for any.
        start: x, y, theta; None to draw it.
        goal: x, y; None to draw it. If both are given, their distance is what it is.

    Raises:
        InputError: the robot does not fit at a given point, there is no path from the one to
            the other, or there are no two places at such a distance.
    """
    if not 0.0 <= shortest < longest:
        raise InputError(
            f"the distance from start to goal is to be from {shortest:g} to {longest:g} m; give "
            "two numbers from 0 on, the second the greater one."
        )
    table = lattice.table
    field = np.empty(lattice.room.shape, dtype=np.float32)
    task = np.empty(6)
    if start is None and goal is None:
        if not draw_into(state, float(shortest), float(longest), table, field, task):
            raise InputError(_no_task_text(lattice, shortest, longest, "any place", float(task[5])))
        return Task.shortest(task, CostToGo.of(field, table))
    task[3:5] = (np.nan, np.nan) if goal is None else _place(lattice, goal, "goal", 2)
    task[:3] = np.nan if start is None else _place(lattice, start, "start", 3)
    end = task[:2] if goal is None else task[3:5]
    label = spread_from(end[0], end[1], table, field)
    if label < 0:
        raise InputError(_cornered_text(lattice, "start" if goal is None else "goal", end))
    if start is None or goal is None:
        cell, farthest, _ = _pick(state, float(shortest), float(longest), label, table, field)
        if cell < 0:
            start_text = f"({end[0]:g}, {end[1]:g})"
            raise InputError(_no_task_text(lattice, shortest, longest, start_text, farthest))
        if goal is None:
            task[3:5] = beside(state, cell, table)
            spread_from(task[3], task[4], table, field)
        else:
            task[:2] = beside(state, cell, table)
            task[2] = math.pi * (2.0 * uniform(state) - 1.0)
    elif not _same_part(lattice, task):
        raise InputError(
            f"there is no path for a robot of {lattice.checker.footprint.outer:g} m of radius in "
            f"{lattice.name} from the start ({task[0]:g}, {task[1]:g}) to the goal ({task[3]:g}, "
            f"{task[4]:g}); move one of them."
        )
    task[5] = lattice.distance(field, float(task[0]), float(task[1]))
    drawn = Task.shortest(task, CostToGo.of(field, table))
    return replace(drawn, distance=path_length(lattice, task[:2], task[3:5], drawn.distance))


def path_length(lattice: FreeSpaceLattice, start: Floats, goal: Floats, read: float) -> float:
    """Return the length of the path from a start to a goal, metres.

    Read from costs to go, which are linear between cells, it is up to a cell's half diagonal too
    long right at the goal, where they have the tip of a cone. The cost to go stays as it is read:
    rewards are its differences.

    Args:
        lattice: Lattice that the costs are for.
        start: x, y, shape (2,).
        goal: x, y, shape (2,).
        read: The length by `FreeSpaceLattice.distance`.
    """
    x, y = float(start[0]), float(start[1])
    goal_x, goal_y = float(goal[0]), float(goal[1])
    straight = math.hypot(goal_x - x, goal_y - y)
    near = straight <= REACH * lattice.spacing
    if near and line_free(x, y, goal_x, goal_y, *lattice.checker.arrays):
        return straight
    return read


def _place(lattice: FreeSpaceLattice, value: ArrayLike, name: str, size: int) -> Floats:
    """Return a point or pose given by a user, checked."""
    try:
        if np.iscomplexobj(value):
            raise TypeError("complex numbers")
        place = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is {value!r}; give {size} numbers.") from error
    if place.shape != (size,) or not np.isfinite(place).all():
        raise InputError(
            f"{name} is {value!r}; give {'x, y and theta' if size == 3 else 'x and y'}: {size} "
            "finite numbers, metres and radians in the map frame."
        )
    why = lattice.checker.why_not(float(place[0]), float(place[1]))
    if why is not None:
        raise InputError(
            f"{name} ({place[0]:g}, {place[1]:g}) in {lattice.name} is {why}; move it."
        )
    return place


def _same_part(lattice: FreeSpaceLattice, task: Floats) -> bool:
    """Return whether the free space connects a given start with a given goal."""
    parts = []
    for name, x, y in (("start", task[0], task[1]), ("goal", task[3], task[4])):
        seeds, first = np.empty(_SEEDS, dtype=np.int64), np.empty(_SEEDS)
        count = _joined(x, y, lattice.table, seeds, first)
        if count == 0:
            raise InputError(_cornered_text(lattice, name, np.array([x, y])))
        parts.append(lattice.labels.ravel()[seeds[:count]])
    return bool(np.isin(parts[0], parts[1]).any())


def _cornered_text(lattice: FreeSpaceLattice, name: str, place: Floats) -> str:
    """Explain why a point is not usable although the robot fits there."""
    return (
        f"{name} ({place[0]:g}, {place[1]:g}) in {lattice.name} is in a corner so tight that a "
        f"lattice of {lattice.spacing:g} m shows no path out of it; move it."
    )


def _no_task_text(
    lattice: FreeSpaceLattice, shortest: float, longest: float, end: str, farthest: float
) -> str:
    """Explain why there is no task."""
    reach = f"at most {farthest:.1f} m" if farthest > 0.0 else "nowhere"
    return (
        f"{lattice.name}: no start and goal are {shortest:g} to {longest:g} m apart for a robot of "
        f"{lattice.checker.footprint.outer:g} m of radius, which gets from {end} {reach}; ask for "
        "another distance, or take another map."
    )


@kernel
def draw_into(state, shortest, longest, table, field, task):
    """Draw a start and a goal.

    Args:
        state: State of the random numbers, uint64, shape (4,); advanced in place.
        shortest: Least length of the shortest path between them, metres.
        longest: Greatest length of it.
        table: `FreeSpaceLattice.table`.
        field: Becomes the distances to the goal, float32, shape (rows, columns).
        task: Becomes start x, y, theta, goal x, y and their distance, shape (6,). If there is no
            task, the last is the greatest distance that was met.

    Returns:
        Whether there is a task.
    """
    task[:] = 0.0
    far_end, farthest = -1, 0.0
    for attempt in range(_DRAWN + _FAR_ENDS if table.standing.size > 0 else 0):
        goal = table.standing[int(uniform(state) * table.standing.size)]
        if attempt >= _DRAWN and far_end >= 0:
            goal = far_end
        task[3], task[4] = beside(state, goal, table)
        label = spread_from(task[3], task[4], table, field)
        has_start, away, far_end = start_for(state, shortest, longest, label, table, field, task)
        if has_start:
            return True
        farthest = max(farthest, away)
    task[5] = farthest
    return False


@kernel
def start_for(state, shortest, longest, label, table, field, task):
    """Draw a start for a goal whose field and label are known.

    Args:
        state: See `draw_into`, as the next two, table and field.
        shortest: See there.
        longest: See there.
        label: See `spread_from`.
        table: See there.
        field: Only read.
        task: x, y and theta of the start become its first three, the distance the last of six.

    Returns:
        Whether there is one; if not, the greatest distance of a cell to stand at, and that cell
        or -1.
    """
    start, away, far_end = _pick(state, shortest, longest, label, table, field)
    if start >= 0:
        task[0], task[1] = beside(state, start, table)
        task[5] = _read(task[0], task[1], table, field)
        if not shortest <= task[5] <= longest:
            task[0], task[1] = _centre(start, table)
            task[5] = field.ravel()[start]
        task[2] = math.pi * (2.0 * uniform(state) - 1.0)
    return start >= 0, away, far_end


@kernel
def draw_places(state, table, points):
    """Draw positions where the robot fits with `MARGIN` to spare into `points`, shape (N, 2)."""
    for k in range(len(points)):
        cell = table.standing[int(uniform(state) * table.standing.size)]
        points[k, 0], points[k, 1] = beside(state, cell, table)


@kernel
def spread_from(x, y, table, field):
    """Write the cost of the path to a free point to `field`; see `geodesic`.

    Returns:
        Label of the cells that the point is joined to; -1 if it is joined to none, which can only
        be in a corner hardly wider than the robot.
    """
    seeds = np.empty(_SEEDS, dtype=np.int64)
    first = np.empty(_SEEDS)
    count = _joined(x, y, table, seeds, first)
    prices = table.prices.reshape(-1, table.prices.shape[2])
    for s in range(count):
        cx, cy = _centre(seeds[s], table)
        first[s] *= prices[seeds[s], heading_of(x - cx, y - cy, prices.shape[1])]
    geodesic(
        seeds[:count], first[:count], table.moves, table.links, table.prices, table.spacing, field
    )
    return table.labels.ravel()[seeds[0]] if count > 0 else -1


@kernel
def _joined(x, y, table, seeds, first):
    """Write the cells connected to a point and their distances, metres; return their number."""
    rows, columns = table.room.shape
    middle_column = int(round((x - table.low_x) / table.spacing))
    middle_row = int(round((y - table.low_y) / table.spacing))
    count = 0
    for row in range(max(middle_row - 3, 0), min(middle_row + 4, rows)):
        for column in range(max(middle_column - 3, 0), min(middle_column + 4, columns)):
            cx, cy = table.low_x + column * table.spacing, table.low_y + row * table.spacing
            away = math.hypot(cx - x, cy - y)
            if (
                away <= REACH * table.spacing
                and table.room[row, column] >= 0.0
                and line_free(x, y, cx, cy, table.walls, table.bound, table.forbidden)
            ):
                seeds[count], first[count] = row * columns + column, away
                count += 1
    return count


@kernel
def _pick(state, shortest, longest, label, table, field):
    """Draw a cell to stand in, with this label and within these distances.

    Returns:
        The cell; or -1, and then the greatest distance of a cell with this label, and that cell
        or -1.
    """
    flat, labels = field.ravel(), table.labels.ravel()
    # Rejection sampling: suitable cells are equally likely, and few draws are needed if many are.
    for _ in range(_GUESSES if table.standing.size > 0 else 0):
        cell = table.standing[int(uniform(state) * table.standing.size)]
        if labels[cell] == label and shortest <= flat[cell] <= longest:
            return cell, 0.0, -1
    count, farthest, far_end = 0, 0.0, -1
    for cell in table.standing:
        if labels[cell] == label:
            count += shortest <= flat[cell] <= longest
            if flat[cell] > farthest:
                farthest, far_end = float(flat[cell]), cell
    rank = int(uniform(state) * count) if count > 0 else -1
    for cell in table.standing:
        if labels[cell] == label and shortest <= flat[cell] <= longest:
            if rank == 0:
                return cell, farthest, far_end
            rank -= 1
    return -1, farthest, far_end


@kernel
def beside(state, cell, table):
    """Draw a point of the disc about a cell's centre that keeps the robot's clearance."""
    x, y = _centre(cell, table)
    radius = min(0.5 * table.spacing, table.room.ravel()[cell] - MARGIN)
    radius *= math.sqrt(uniform(state))
    angle = 2.0 * math.pi * uniform(state)
    return x + radius * math.cos(angle), y + radius * math.sin(angle)


@kernel(inline="always")
def _centre(cell, table):
    columns = table.room.shape[1]
    return (
        table.low_x + cell % columns * table.spacing,
        table.low_y + cell // columns * table.spacing,
    )


@kernel(inline="always")
def _read(x, y, table, field):
    return distance_at(x, y, field, table.links, table.low_x, table.low_y, 1.0 / table.spacing)
