"""Disturbances of a robot that its map, odometry and localizer do not model.

All of it is drawn with the task, from the task's stream, so an episode with and without it has the
same noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

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
    options: Mapping[str, Any],
) -> tuple[Task, Disturbances | None] | None:
    """Draw a task, and the disturbances on it.

    Args:
        site: The building.
        p: Which disturbances there are, and how often.
        stream: State of the random numbers, uint64, shape (4,); advanced in place.
        draw: Draws a task in a site, from a start if one is given.
        tries: How many tasks are drawn until there is one with a door to close, or with aliases.
        options: `start` and `goal` of the episode, None where `draw` draws them. An aliased start
            without a goal is drawn again if neither is given; else that is an error.

    Returns:
        The task and its disturbances, which are None where the parameters ask for none; or
        None where no task has a door to close, or aliases.

    Raises:
        InputError: there is no room for a task.
    """
    if not (p.kidnapped or p.slip or p.closed_door or p.start_aliases):
        return draw(site), None
    closing, kidnapped = uniform(stream) < p.closed_door, uniform(stream) < p.kidnapped
    for attempt in range(tries if closing or p.start_aliases else 1):
        # With fewer hypotheses than the start has only where there is nothing else.
        every = attempt < tries // 2
        task, starts = _attempt(site, p, stream, draw, closing, options, every)
        if task is not None:
            break
    else:
        return None
    step, pose, cost = 0, np.zeros(3), 0.0
    if kidnapped:
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
    options: Mapping[str, Any],
    every: bool,
) -> tuple[Task | None, Floats | None]:
    """Draw a task with a door to close and aliases, as asked for; None where it has none."""
    start = site.aliases.draw(stream) if p.start_aliases else None
    try:
        task = draw(site, start)
    except InputError:
        if start is None or options["start"] is not None or options["goal"] is not None:
            raise
        # No goal is as far from this start as is asked for.
        return None, None
    starts = None
    if p.start_aliases:
        aliased = _with_aliases(site, p, stream, task, options, every)
        if aliased is None:
            return None, None
        task, starts = aliased
    closed = site.goals.close_door(task, stream, p.door_width, p.detour) if closing else task
    return closed, starts


def _with_aliases(
    site: Site,
    p: NavigationParameters,
    stream: UInts,
    task: Task,
    options: Mapping[str, Any],
    every: bool,
) -> tuple[Task, Floats] | None:
    """Return a task that starts at one of several poses, and these with their probabilities.

    Nothing about the start and the goal tells which of them is the true one: where the path from
    the start has a given length, those from the others have it too, and a start that is not given
    is drawn among them all, since only that which was drawn first lies on a point of the map.

    Args:
        site: See `draw_disturbances`, as p, stream and given.
        p: See there.
        stream: See there.
        task: From one of the poses.
        options: See there.
        every: Whether none of its aliases may be left out.

    Returns:
        The task and `aliases.hypotheses`; None where the start has no such aliases.
    """
    poses = site.aliases.among(task.start, task.goal)
    if poses is None:
        return None
    fits = np.ones(len(poses), dtype=np.bool_)
    if options["goal"] is None:
        lengths = site.goals.lengths(task)
        metres = np.array([site.lattice.distance(lengths, x, y) for x, y, _ in poses.tolist()])
        fits = (metres >= p.shortest) & (metres <= p.longest)
    tasks: list[Task | None] = [task] * len(poses)
    if options["start"] is None:
        tasks = [site.goals.restarted(task, pose) for pose in poses]
        fits &= [restarted is not None for restarted in tasks]
    else:
        # A given start is as far from its goal as it is.
        fits[0] = True
    if not fits[0] or fits.sum() < (len(poses) if every else 2):
        return None
    fitting = np.flatnonzero(fits)
    if options["start"] is None:
        first = int(uniform(stream) * len(fitting))
        fitting[[0, first]] = fitting[[first, 0]]
    chosen = tasks[fitting[0]]
    assert chosen is not None
    return chosen, hypotheses(poses[fitting], p.start_prior, stream)


def no_task(site: Site, p: NavigationParameters) -> InputError:
    """Return the error for a building without a door to close, or aliased starts."""
    if p.start_aliases:
        return InputError(
            f"start_aliases: in {site.building.environment.name!r} no start and goal are "
            f"{p.shortest:g} to {p.longest:g} m apart where another pose at least {APART:g} m away "
            "gives the same scan, has the robot's clearance, is as far from the goal and leads to "
            "another one; give another building or distance, or a scanner of shorter range."
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
