"""Doors that the map shows open and that are closed in the world, where a detour exists.

The map, and with it the robot's route, the window and the localizer, know nothing of it. In the
world it is a thin box across a narrow passage (see `simulation.obstacles`).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ambinav.geometry.collision.gaps import near_line
from ambinav.localization.random import uniform
from ambinav.runtime.array_types import Floats, Floats32, UInts
from ambinav.runtime.kernels import kernel
from ambinav_envs.buildings.free_space import FreeSpaceArrays, FreeSpaceLattice
from ambinav_envs.buildings.geodesic import LENGTHS, REACH, SIDES, STEPS
from ambinav_envs.buildings.tasks import CostToGo, Task, spread_from

THICK = 0.1
"""Thickness of a closed door, metres."""
# How far it reaches into the walls on both sides, metres.
_OVERLAP = 0.1
# A door is at least so far from the start and the goal, metres along the path.
_APART = 1.2
# Directions in which a passage's width is measured: its error is below half a percent.
_CROSSINGS = 16
# Points looked at for each step of the path from cell to cell.
_BETWEEN = 4


def close_door(
    lattice: FreeSpaceLattice,
    priced: FreeSpaceArrays | None,
    world: tuple[FreeSpaceLattice, FreeSpaceArrays | None],
    task: Task,
    stream: UInts,
    width: float,
    detour: tuple[float, float],
) -> Task | None:
    """Return the task with a door on its route closed, or None where no door fits.

    Of the narrow passages on the shortest path one is drawn, of those whose closing makes that
    path longer by no less and no more than `detour`: the same one whatever the route's prices.

    Args:
        lattice: Lattice of the cells where the robot fits.
        priced: Its table at the prices of the route; None: a metre costs 1.
        world: The same two as things truly are.
        task: With the map's directions.
        stream: State of the random numbers, uint64, shape (4,); advanced in place.
        width: Largest width of a passage that counts as a door, metres.
        detour: How many times as long the other way is, least and most.

    Returns:
        The task with the distance and the costs of the world, and the map's directions; `door` is
        the box in the doorway.
    """
    radius = lattice.checker.footprint.outer
    true, true_priced = world
    doors = _passages(lattice, priced, task, width)
    while len(doors):
        drawn = doors[int(uniform(stream) * len(doors))]
        # Neighbours on the path belong to the same passage; the door is at its narrowest point.
        same = np.hypot(*(doors[:, :2] - drawn[:2]).T) <= width
        door = doors[same][np.hypot(*doors[same, 2:4].T).argmin()]
        doors = doors[~same]
        lengths = _costs(closed_table(true.table, door, radius), task)
        distance = true.distance(lengths, float(task.start[0]), float(task.start[1]))
        if not detour[0] * task.distance <= distance <= detour[1] * task.distance:
            continue
        costs, cost = lengths, distance
        if true_priced is not None:
            costs = _costs(closed_table(true_priced, door, radius), task)
            cost = true.distance(costs, float(task.start[0]), float(task.start[1]))
        around = CostToGo(costs, task.cost_to_go.towards)
        return replace(task, distance=distance, cost_to_go=around, cost=cost, door=door)
    return None


def closed_table(table: FreeSpaceArrays, door: Floats, radius: float) -> FreeSpaceArrays:
    """Return a building's table without the moves and links that a closed door blocks.

    Args:
        table: Table of the building.
        door: A box whose longer half edge comes first, shape (6,), see `Task`.
        radius: Radius of the robot, metres.
    """
    moves, links = table.moves.copy(), table.links.copy()
    _remove_blocked(table, door, radius + 0.5 * THICK, moves, links)
    return table._replace(moves=moves, links=links)


def shortest_path(lattice: FreeSpaceLattice, priced: FreeSpaceArrays | None, task: Task) -> Floats:
    """Return the cell centres along the map's shortest path to the goal, shape (K, 2), metres."""
    towards = task.cost_to_go.towards
    if priced is not None:
        towards = CostToGo.of(_costs(lattice.table, task), lattice.table).towards
    rows, columns = lattice.room.shape
    low_x, low_y, inverse = lattice.frame
    column = int(math.floor((task.start[0] - low_x) * inverse + 0.5))
    row = int(math.floor((task.start[1] - low_y) * inverse + 0.5))
    cells = [(column, row)]
    while 0 <= row < rows and 0 <= column < columns:
        step = int(towards[row, column])
        if step < 0:
            break
        column, row = column - int(STEPS[step, 0]), row - int(STEPS[step, 1])
        cells.append((column, row))
    return np.array([low_x, low_y]) + lattice.spacing * np.array(cells, dtype=np.float64)


def _passages(
    lattice: FreeSpaceLattice, priced: FreeSpaceArrays | None, task: Task, width: float
) -> Floats:
    """Return boxes across the shortest path wherever it is narrow, shape (K, 6)."""
    cells = shortest_path(lattice, priced, task)
    # Cells may miss the inside of a doorway through a thin wall.
    along = np.arange(_BETWEEN * (len(cells) - 1) + 1) / _BETWEEN
    points = np.stack([np.interp(along, np.arange(len(cells)), axis) for axis in cells.T], axis=1)
    ends = np.stack([task.start[:2], task.goal])
    distance = np.hypot(*(points[:, np.newaxis] - ends).transpose(2, 0, 1)).min(axis=1)
    points = points[distance > _APART]
    if not len(points):
        return np.empty((0, 6))
    angle = np.arange(_CROSSINGS) * math.pi / _CROSSINGS
    x, y = points[:, :1], points[:, 1:]
    cast = lattice.checker.environment.cast
    ahead = np.asarray(cast(x, y, angle, width))
    behind = np.asarray(cast(x, y, angle + math.pi, width))
    across = ahead + behind
    best = across.argmin(axis=1)
    each = np.arange(len(points))
    span = across[each, best]
    narrow = (span <= width) & (ahead[each, best] < width) & (behind[each, best] < width)
    direction = np.stack([np.cos(angle[best]), np.sin(angle[best])], axis=1)
    middle = points + 0.5 * (ahead - behind)[each, best][:, np.newaxis] * direction
    half = (0.5 * span + _OVERLAP)[:, np.newaxis] * direction
    thick = 0.5 * THICK * np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    boxes: Floats = np.hstack([middle, half, thick])[narrow]
    return boxes


def _costs(table: FreeSpaceArrays, task: Task) -> Floats32:
    costs = np.empty(table.room.shape, dtype=np.float32)
    spread_from(task.goal[0], task.goal[1], table, costs)
    return costs


@kernel
def _remove_blocked(table, door, reach, moves, links):
    """Remove the moves that come nearer than `reach` to a door, and the links across it."""
    rows, columns = moves.shape
    ax, ay = door[0] - door[2], door[1] - door[3]
    ex, ey = 2.0 * door[2], 2.0 * door[3]
    spacing = table.spacing
    around = math.hypot(door[2], door[3]) + reach + REACH * spacing
    for row in range(rows):
        y = table.low_y + row * spacing
        if abs(y - door[1]) > around:
            continue
        for column in range(columns):
            x = table.low_x + column * spacing
            if abs(x - door[0]) > around:
                continue
            for k in range(LENGTHS.size):
                ux, uy, length = STEPS[k, 0] / LENGTHS[k], STEPS[k, 1] / LENGTHS[k], LENGTHS[k]
                length *= spacing
                if near_line(ax, ay, ex, ey, x, y, ux, uy, length, reach):
                    moves[row, column] &= ~np.uint16(1 << k)
                if k < SIDES and near_line(ax, ay, ex, ey, x, y, ux, uy, length, 0.0):
                    links[row, column] &= ~np.uint8(1 << k)
