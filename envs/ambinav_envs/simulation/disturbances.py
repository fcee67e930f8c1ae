"""Disturbances of a robot that its map, odometry and localizer do not model.

All of it is drawn with the task, from the task's stream, so an episode with and without it has the
same noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ambinav.localization.random import uniform
from ambinav.runtime.array_types import Floats, UInts
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.aliases import APART, hypotheses
from ambinav_envs.buildings.free_space import MARGIN
from ambinav_envs.buildings.tasks import Task, beside
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.site import Site

# How many buildings, and tasks in each, are drawn before it is said that there is none.
BUILDINGS, TASKS = 16, 32
# Distance of a kidnapped robot from a closed door, beyond its radius, metres.
_OFF = 0.5


class Disturbances(NamedTuple):
    """Disturbances of an episode; see `layout.STATE` for the first four.

    `hypotheses` are where the localizer starts, see `aliases.hypotheses`.
    """

    kidnap_step: int
    kidnap_pose: Floats
    kidnap_cost: float
    slippery: Floats
    door: Floats | None
    hypotheses: Floats | None


def draw_disturbances(
    site: Site,
    p: NavigationParameters,
    stream: UInts,
    draw: Callable[..., Task],
    tries: int,
    whole: bool,
) -> tuple[Task, Disturbances | None] | None:
    """Draw a task, and the disturbances on it.

    Args:
        site: The building.
        p: Which disturbances there are, and how often.
        stream: State of the random numbers, uint64, shape (4,); advanced in place.
        draw: Draws a task in a site, from a start if one is given.
        tries: How many tasks are drawn until there is one with a door to close, or with aliases.
        whole: Whether neither start nor goal is given. An aliased start without a goal is then
            drawn again; else that is an error.

    Returns:
        The task and its disturbances, which are None where the parameters ask for none; or
        None where no task has a door to close, or aliases.

    Raises:
        InputError: there is no room for a task.
    """
    if not (p.kidnapped or p.slip or p.closed_door or p.start_aliases):
        return draw(site), None
    closing, taken = uniform(stream) < p.closed_door, uniform(stream) < p.kidnapped
    for _ in range(tries if closing or p.start_aliases else 1):
        task, starts = _attempt(site, p, stream, draw, closing, whole)
        if task is not None:
            break
    else:
        return None
    step, pose, cost = 0, np.zeros(3), 0.0
    if taken:
        low, high = p.kidnap_seconds
        step = max(int((low + uniform(stream) * (high - low)) / p.dt), 1)
        pose = _draw_kidnap_pose(site, task, stream)
        costs = task.cost_to_go.costs
        cost = site.world.lattice.distance(costs, float(pose[0]), float(pose[1]))
    slippery = np.zeros(2)
    if p.slip > 0.0:
        path = site.goals.shortest_path(task)
        # Away from both ends, so that the robot meets it on the path.
        slippery = path[int((0.25 + 0.5 * uniform(stream)) * len(path))]
    return task, Disturbances(step, pose, cost, slippery, task.door, starts)


def _attempt(
    site: Site,
    p: NavigationParameters,
    stream: UInts,
    draw: Callable[..., Task],
    closing: bool,
    whole: bool,
) -> tuple[Task | None, Floats | None]:
    """Draw a task with a door to close and aliases, as asked for; None where it has none."""
    start = site.aliases.draw(stream) if p.start_aliases else None
    try:
        task = draw(site, start)
    except InputError:
        if start is None or not whole:
            raise
        # No goal is as far from this start as is asked for.
        return None, None
    closed = site.goals.close_door(task, stream, p.door_width, p.detour) if closing else task
    if closed is None or not p.start_aliases:
        return closed, None
    poses = site.aliases.among(task.start, task.goal)
    if poses is None:
        return None, None
    return closed, hypotheses(poses, p.start_prior, stream)


def no_task(site: Site, p: NavigationParameters) -> InputError:
    """Return the error for a building without a door to close, or aliased starts."""
    if p.start_aliases:
        return InputError(
            f"start_aliases: in {site.building.environment.name!r} no start and goal are "
            f"{p.shortest:g} to {p.longest:g} m apart where another pose at least {APART:g} m away "
            "gives the same scan and leads to another goal; give another building or distance, or "
            "a scanner of shorter range."
        )
    return InputError(
        f"closed_door: the paths drawn in {site.building.environment.name!r} lead through no "
        f"passage of at most {p.door_width:g} m with another way around it that is "
        f"{p.detour[0]:g} to {p.detour[1]:g} times as long; give another building, door_width or "
        "detour."
    )


def _draw_kidnap_pose(site: Site, task: Task, stream: UInts) -> Floats:
    """Draw a pose anywhere with a path to the goal, away from a closed door."""
    lattice, table, costs = site.lattice, site.table, task.cost_to_go.costs.ravel()
    cells = table.standing[np.isfinite(costs[table.standing])]
    if task.door is not None:
        x = table.low_x + table.spacing * (cells % lattice.room.shape[1])
        y = table.low_y + table.spacing * (cells // lattice.room.shape[1])
        off = math.hypot(*task.door[2:4]) + lattice.checker.footprint.outer + MARGIN + _OFF
        cells = cells[np.hypot(x - task.door[0], y - task.door[1]) > off]
    if not len(cells):
        raise InputError(
            f"kidnapped: there is nowhere else to put the robot in {lattice.name}; take another "
            "building."
        )
    cell = int(cells[int(uniform(stream) * len(cells))])
    return np.array([*beside(stream, cell, table), math.pi * (2.0 * uniform(stream) - 1.0)])
